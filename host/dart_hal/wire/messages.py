"""The wire protocol: the definitions of all messages between Nano and host.

This file is the specification. The C++ header of the firmware, the tables in
``docs/reference/wire.md`` and the golden vectors are generated from these definitions, and the
decoders use them. A test fails if one of them is not current.

The initial value of a message's CRC is the hash of its definition. Two programs with different
definitions of a message therefore cannot misread each other: the CRC of every such frame is wrong.
A changed message gets a new id.
"""

from __future__ import annotations

import struct
from binascii import crc32
from dataclasses import dataclass, field
from functools import cached_property
from typing import TypedDict

# Version of the wire rules (framing, handshake), sent in HELLO.
PROTO = 1

# CRC seed of HELLO and HELLO_REQ: programs of all versions can identify each other.
SEED_FOREVER = 0xFFFF

# Timer1 of the ATmega328P at 16 MHz / 8: the unit "ck" is 0.5 us.
TICKS_PER_SECOND = 2_000_000

TYPES = {"u8": "B", "u16": "H", "u32": "I", "i16": "h", "text": "s"}


@dataclass(frozen=True)
class MessageField:
    """One field of a payload, little-endian.

    Value in ``unit`` = ``scale`` x raw integer; ``count`` > 1: an array.
    """

    name: str
    type: str
    doc: str
    count: int = 1
    scale: float = 1.0
    unit: str = ""

    @property
    def text(self) -> str:
        """Canonical text of the field, the input of the hash (without the doc string)."""
        return f"{self.name}:{self.type}:{self.count}:{self.scale!r}:{self.unit}"

    @property
    def format(self) -> str:
        return TYPES[self.type] if self.count == 1 else f"{self.count}{TYPES[self.type]}"


@dataclass(frozen=True)
class Message:
    """One message: id, direction ("up" = Nano to host), rate and fields."""

    name: str
    id: int
    dir: str
    rate: str
    doc: str
    fields: tuple[MessageField, ...] = field(repr=False)

    @cached_property
    def text(self) -> str:
        body = "; ".join(f.text for f in self.fields)
        return f"{self.name} {self.id:#04x} {self.dir}; {body}"

    @cached_property
    def seed(self) -> int:
        """Initial value of this message's CRC-16 (16-bit hash of its definition)."""
        if self.name in ("HELLO", "HELLO_REQ"):
            return SEED_FOREVER
        return crc32(self.text.encode("ascii")) & 0xFFFF

    @cached_property
    def struct(self) -> struct.Struct:
        return struct.Struct("<" + "".join(f.format for f in self.fields))

    @cached_property
    def size(self) -> int:
        """Payload bytes (LOG: its maximum)."""
        return self.struct.size

    @cached_property
    def variable(self) -> bool:
        """Whether the length is that of the frame: only of LOG."""
        return any(f.type == "text" for f in self.fields)

    @property
    def wire_size(self) -> int:
        """Bytes of the frame: the payload, type 1, seq 1, crc 2, COBS 1 and delimiter 1."""
        return self.size + 6


def _m(name: str, id: int, dir: str, rate: str, doc: str, *fields: MessageField) -> Message:
    return Message(name, id, dir, rate, doc, fields)


_F = MessageField


class _Unit(TypedDict):
    scale: float
    unit: str


_CK: _Unit = {"scale": 0.5e-6, "unit": "s"}

HELLO = _m(
    "HELLO", 0x01, "up", "boot x3 (100 ms apart), then on request", "identity and versions",
    _F("proto", "u8", "version of the wire rules"),
    _F("req_seq", "u8", "seq of the HELLO_REQ that is answered; 0 at boot"),
    _F("schema", "u32", "hash of all message definitions of the firmware"),
    _F("fw_version", "u8", "major, minor, patch", count=3),
    _F("build", "u8", "bit 0 dirty tree, 1 emulator test build, 2 mock"),
    _F("git", "u32", "first 32 bits of the source revision"),
    _F("board_id", "u32", "made once, kept in EEPROM: names the car whatever its tty"),
    _F("boot_count", "u16", "boots since the EEPROM was made"),
    _F("reset_cause", "u8", "MCUSR bits, + 0x10 = watchdog mark in .noinit"),
    _F("bootloader", "u8", "0 unknown, 1 ATmegaBOOT (57600), 2 Optiboot (115200)"),
    _F("boot_nonce", "u16", "crc16(board_id, boot_count): the arm token of this boot"),
    _F("edges_per_rev", "u8", "edges per main-gear revolution of ring A and B", count=2),
    _F("caps", "u16", "bit 0 ring B, 1 capture, 2 /OE, 3 multiplexer, 4 watchdog reset, "
       "5 calib tells of looks at the gyro"),
    _F("clock_hz", "u32", "ticks per second of all *_ck fields", unit="Hz"),
    _F("param_crc", "u16", "CRC of the parameter block in EEPROM"),
)
HELLO_REQ = _m(
    "HELLO_REQ", 0x02, "down", "until answered, each 100 ms", "asks for HELLO",
    _F("proto", "u8", "version of the wire rules of the host"),
    _F("schema", "u32", "hash of all message definitions of the host"),
    _F("flags", "u8", "bit 0: send DIAG at once"),
)
STATE = _m(
    "STATE", 0x10, "up", "100 Hz", "encoder, IMU, flags: the loop clock",
    _F("t_ck", "u32", "time at which the encoder fields were latched", **_CK),
    _F("enc_count", "u32", "edges of ring A since boot, never cleared"),
    _F("enc_t_ck", "u32", "time of the last edge of ring A", **_CK),
    _F("enc_dt_ck", "u16", "interval before it; 65535 = longer than 32.8 ms, "
       "0 = fewer than two edges", **_CK),
    _F("enc2_count", "u16", "edges of ring B; 0 if not fitted"),
    _F("enc2_t_ck", "u32", "time of the last edge of ring B", **_CK),
    _F("lin_acc", "i16", "acceleration without gravity, sensor axes", 3, 0.01, "m/s2"),
    _F("gyro", "i16", "angular rate, sensor axes", 3, 1 / 900, "rad/s"),
    _F("imu_age", "u16", "t minus start of the IMU read; 65535 = no sample or "
       "older than 262 ms", scale=4e-6, unit="s"),
    _F("calib", "u8", "BNO055 CALIB_STAT: sys, gyr, acc, mag, 2 bits each from the top; with "
       "GYRO_LOOK, for mag: the gyro's data changed 1 before, 2 after the look, 3 both"),
    _F("flags", "u16", "STATE_FLAGS"),
    _F("beat_age", "u8", "age of the last valid HEARTBEAT, saturates at 255",
       scale=1e-3, unit="s"),
)
DIAG = _m(
    "DIAG", 0x11, "up", "2 Hz", "counters; they wrap and are differenced on the host",
    _F("t_ck", "u32", "time of the snapshot", **_CK),
    _F("rx_ok", "u16", "frames accepted from the host"),
    _F("rx_crc", "u16", "frames with a wrong CRC or COBS"),
    _F("rx_len", "u16", "frames of a wrong length or type"),
    _F("rx_seq_gap", "u16", "frames missing by their sequence number"),
    _F("uart_fe", "u8", "framing errors"),
    _F("uart_overrun", "u8", "receive overruns (hardware or ring)"),
    _F("i2c_nack", "u16", "address or data not acknowledged"),
    _F("i2c_timeout", "u16", "legs that missed their deadline, arbitration, stuck lines"),
    _F("i2c_recover", "u8", "bus recoveries"),
    _F("imu_reinit", "u8", "re-initialisations of the IMU"),
    _F("edges_rejected", "u16", "edges refused by the glitch rule"),
    _F("loop_max_us", "u16", "longest main cycle since the last DIAG", scale=1e-6, unit="s"),
    _F("loop_overruns", "u16", "slots that began late"),
    _F("stack_free", "u16", "bytes never touched by the stack", unit="B"),
    _F("vcc_mv", "u16", "supply voltage; 0 = not measured", scale=1e-3, unit="V"),
    _F("boot_count", "u16", "as in HELLO"),
)
TIME_PONG = _m(
    "TIME_PONG", 0x12, "up", "2 Hz", "answer to TIME_PING",
    _F("ping_id", "u16", "echo"),
    _F("host_us", "u32", "echo"),
    _F("rx_ck", "u32", "the ping's delimiter, stamped in the receive interrupt", **_CK),
    _F("tx_ck", "u32", "first byte of this frame enters an idle UART", **_CK),
    _F("reserved", "u16", "0"),
)
EVENT = _m(
    "EVENT", 0x13, "up", "on change, sent 3 times", "same count = same event",
    _F("t_ck", "u32", "time of the event", **_CK),
    _F("code", "u8", "EVENT_CODES"),
    _F("count", "u8", "number of the event, wraps"),
    _F("arg", "u32", "meaning depends on the code"),
)
EDGES = _m(
    "EDGES", 0x14, "up", "on request", "eight successive edge intervals: ring learning",
    _F("first_count", "u32", "enc_count at the edge that ends the first interval"),
    _F("t_ck", "u32", "time of the last edge", **_CK),
    _F("interval", "u16", "intervals, oldest first; 65535 = longer than 32.8 ms", 8,
       0.5e-6, "s"),
)
LOG = _m(
    "LOG", 0x15, "up", "rare", "a sentence; never raw text in the stream",
    _F("level", "u8", "0 debug, 1 info, 2 warning, 3 error"),
    _F("text", "text", "4 to 49 ASCII characters", 49),
)
PARAM_VALUE = _m(
    "PARAM_VALUE", 0x16, "up", "reply", "answer to PARAM_GET and PARAM_SET",
    _F("id", "u16", "PARAMS"),
    _F("status", "u8", "0 ok, 1 unknown id, 2 out of range, 3 EEPROM busy"),
    _F("req_seq", "u8", "seq of the request"),
    _F("value", "u32", "value now in force"),
)
CAPTURE = _m(
    "CAPTURE", 0x17, "up", "reply", "PCA9685 pulses measured on ICP1",
    _F("first_rise", "u32", "first rising edge", **_CK),
    _F("last_rise", "u32", "last rising edge", **_CK),
    _F("high_sum", "u32", "sum of the high times", **_CK),
    _F("frames", "u16", "periods between first and last rise"),
    _F("high_min", "u16", "shortest high time", **_CK),
    _F("high_max", "u16", "longest high time", **_CK),
)
RC = _m(
    "RC", 0x18, "up", "50 Hz while a HEARTBEAT requests it", "pulses of an RC receiver",
    _F("t_ck", "u32", "time at which the ages were computed", **_CK),
    _F("pulse", "u16", "newest good pulse of steering (D10), throttle (D11), mode (D12); "
       "0 = no signal", 3, 0.5e-6, "s"),
    _F("age", "u8", "age of these pulses, saturates at 255", 3, 1e-3, "s"),
    _F("refused", "u8", "pulses refused: length, period or missed edges; wraps"),
)
BATTERY = _m(
    "BATTERY", 0x19, "up", "8 Hz while a HEARTBEAT requests it", "divider of the battery on A0",
    _F("t_ck", "u32", "time of the last conversion", **_CK),
    _F("pin", "u16", "sum of four conversions of A0; 4092 = supply of the Nano"),
    _F("reference", "u16", "sum of four conversions of the 1.1 V band gap; 4092 = supply"),
    _F("pulled", "u16", "one conversion of A0 with its pull-up; 1023 = supply"),
)
HEARTBEAT = _m(
    "HEARTBEAT", 0x40, "down", "50 Hz", "feeds the watchdog, gives the direction sign",
    _F("host_id", "u16", "random per open; virtual time: crc16(url)"),
    _F("throttle", "u16", "pulse as written to the PCA9685", scale=1e-7, unit="s"),
    _F("steering", "u16", "pulse as written to the PCA9685", scale=1e-7, unit="s"),
    _F("arm_token", "u16", "boot_nonce of this boot, else the beat never arms"),
    _F("mode", "u8", "0 disarmed, 1 armed, 2 raw, 3 stop"),
    _F("flags", "u8", "bit 0-1 direction: 0 unknown, 1 forward, 2 reverse"),
)
TIME_PING = _m(
    "TIME_PING", 0x41, "down", "2 Hz (10 Hz for the first 3 s)", "asks for TIME_PONG",
    _F("ping_id", "u16", "number of the ping"),
    _F("host_us", "u32", "host time, wraps", scale=1e-6, unit="s"),
)
PARAM_GET = _m(
    "PARAM_GET", 0x42, "down", "", "reads a parameter",
    _F("id", "u16", "PARAMS"),
)
PARAM_SET = _m(
    "PARAM_SET", 0x43, "down", "", "writes a parameter; idempotent",
    _F("id", "u16", "PARAMS"),
    _F("reserved", "u16", "0"),
    _F("value", "u32", "new value"),
)
REBOOT = _m(
    "REBOOT", 0x44, "down", "", "restarts the Nano",
    _F("magic", "u32", "0x44415254"),
    _F("kind", "u16", "1 application, 2 bootloader"),
)
EDGES_REQ = _m(
    "EDGES_REQ", 0x45, "down", "", "asks for EDGES frames",
    _F("frames", "u16", "how many"),
)
CAPTURE_REQ = _m(
    "CAPTURE_REQ", 0x46, "down", "", "asks for CAPTURE",
    _F("frames", "u16", "periods to measure"),
)

MESSAGES: tuple[Message, ...] = (
    HELLO, HELLO_REQ, STATE, DIAG, TIME_PONG, EVENT, EDGES, LOG, PARAM_VALUE, CAPTURE,
    RC, BATTERY,
    HEARTBEAT, TIME_PING, PARAM_GET, PARAM_SET, REBOOT, EDGES_REQ, CAPTURE_REQ,
)
BY_ID = {m.id: m for m in MESSAGES}
BY_NAME = {m.name: m for m in MESSAGES}

# 32-bit hash of all definitions, in the order of ids. HELLO contains that of the firmware. The
# texts are part of it: another word in one of them makes the host refuse every flashed Nano.
SCHEMA = crc32("\n".join(m.text for m in sorted(MESSAGES, key=lambda m: m.id)).encode("ascii"))

# Names of the bits of STATE.flags.
STATE_FLAGS = (
    "IMU_VALID", "IMU_STALE", "IMU_STUCK", "IMU_ABSENT", "ENC_REJECT", "ENC_AMBIGUOUS",
    "ENC2_PRESENT", "SLOT_OVERRUN", "TX_DROPPED", "RX_ERROR", "BEAT_OK", "OUTPUT_LIVE",
    "TRIPPED", "PARAM_DEFAULTS", "WATCHDOG_LAST_BOOT", "MOCK",
)

EVENT_CODES = {
    1: "BOOT", 2: "SUPERVISOR", 3: "IMU", 4: "I2C", 5: "REJECT_BURST", 6: "PARAM_WRITTEN",
    7: "LOOP_OVERRUN", 8: "WATCHDOG",
}
BEAT_MODES = {"DISARMED": 0, "ARMED": 1, "RAW": 2, "STOP": 3}
# ASCII "DART".
REBOOT_MAGIC = 0x44415254


@dataclass(frozen=True)
class Param:
    """A parameter of the firmware, stored in EEPROM as u32."""

    name: str
    id: int
    default: int
    low: int
    high: int
    doc: str


PARAMS: tuple[Param, ...] = (
    Param("edges_per_rev_a", 1, 20, 2, 64, "edges per main-gear revolution, ring A"),
    Param("edges_per_rev_b", 2, 10, 2, 64, "edges per main-gear revolution, ring B"),
    Param("ring_b", 3, 0, 0, 1, "1 = ring B (Hall, D3) is fitted"),
    Param("edge_min_us", 4, 100, 0, 5000, "glitch rule: shortest interval; 0 = off"),
    Param("imu_plan", 5, 0, 0, 1, "0 = 6+6 bytes per sample, 1 = 2+4"),
    Param("twi_khz", 6, 400, 100, 400, "I2C clock of the Nano"),
    Param("safety_out", 7, 0, 0, 2, "0 none, 1 /OE, 2 multiplexer"),
    Param("wdt_reset", 8, 0, 0, 1, "1 = the watchdog may reset (Optiboot only)"),
    Param("baud", 9, 500_000, 115_200, 500_000, "line rate after the next boot: 115200 or 500000"),
    Param("beat_timeout_ms", 10, 110, 50, 1000, "heartbeat limit"),
)
PARAM_BY_NAME = {p.name: p for p in PARAMS}

PARAM_STATUS = {"OK": 0, "UNKNOWN_ID": 1, "OUT_OF_RANGE": 2, "EEPROM_BUSY": 3}
# Names of the bits of HELLO.caps.
CAPS = ("RING_B", "CAPTURE", "OUTPUT_ENABLE", "MULTIPLEXER", "WATCHDOG_RESET", "GYRO_LOOK")

# Names of the bits of HELLO.build.
BUILD_FLAGS = ("DIRTY", "EMULATOR_TEST", "MOCK")

REBOOT_KINDS = {"APPLICATION": 1, "BOOTLOADER": 2}
# Bits 0-1 of HEARTBEAT.flags.
DIRECTIONS = {"UNKNOWN": 0, "FORWARD": 1, "REVERSE": 2}
# Bits of HEARTBEAT.flags that request the messages RC and BATTERY; without them none is sent.
BEAT_REQUESTS = {"RC": 4, "BATTERY": 8}

# HELLO.reset_cause: MCUSR bits, and this one if the mark in .noinit was set.
RESET_WATCHDOG_MARK = 0x10

# Length of the shortest text of LOG; shorter ones are padded with spaces.
LOG_TEXT_MIN = 4

# Longest COBS block [B] that a receiver stores. Longer ones are counted and dropped.
MAX_BLOCK = 256

# (canonical text, seed) of definitions of former releases. If a definition changes, its old text is
# added here, and the generator rejects a new definition whose seed an old program would accept.
RETIRED: tuple[tuple[str, int], ...] = ()
