"""MockNano: the Nano's messages without the Nano, for machines without simavr.

It sends the same generated messages from the same world, marked by the flag MOCK and bit 2 of the
build. It has no interrupts, no bus timing, and of a bootloader only the wait. Results with it do
not hold for the firmware.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Sequence
from typing import Any

from dart_hal.core.errors import UsageError
from dart_hal.devices.links.boot import BootWait
from dart_hal.wire import messages as m
from dart_hal.wire.codec import DOWN, encode
from dart_hal.wire.crc import crc16
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.frame import WireFrame
from dart_lab.sim.eeprom import encode_params, parse_eeprom
from dart_lab.sim.mock_capture import MockCapture
from dart_lab.sim.mock_encoder import MockEncoder
from dart_lab.sim.mock_imu import IMU_START, MockImu
from dart_lab.sim.mock_inputs import BATTERY_SLOTS, MockReceiver, measure_divider
from dart_lab.sim.mock_pins import MockPins
from dart_lab.sim.mock_supervisor import MockSupervisor, OutputState
from dart_lab.sim.mock_uart import MockUart
from dart_lab.sim.rc import RECEIVER_PINS
from dart_lab.sim.ring import RING_A, RING_B, even_ring

SLOT_CK = 20_000
# Time from the latch to the first byte of STATE [s], as in the emulated firmware.
LATCH_TO_UART = 255e-6
# Time from the start of the IMU read to the slot that sends it [s].
IMU_READ = 6.5e-3
# Time from the read of the acceleration to that of the gyro [s]: 12 bytes, each stretched by
# 180 us, as in the emulated firmware.
GYRO_READ = 2.43e-3
# Time from the look at the gyro to its read [s], as in the emulated firmware.
LOOK_TO_READ = 4.8e-3
# Longest turn of the loop of the emulated firmware [s], with its read of the IMU.
MAX_LOOP_TIME = 5268e-6
# Time for which a sample stays valid [s]: one sample of all zeros, which is dropped, is bridged.
SAMPLE_VALIDITY = 0.015
# Restart time of the BNO055 [s].
IMU_RESET = 0.650
# Threshold of the brown-out detector [V], extended fuse FD.
BROWN_OUT_VOLT = 2.7
# Number of equal samples in motion after which an IMU is reported as stuck.
STUCK_SAMPLES = 20
RESET_CAUSES = {"power": 0x01, "external": 0x02, "brownout": 0x04, "watchdog": 0x08 | 0x10}
_FLAG = {name: 1 << k for k, name in enumerate(m.STATE_FLAGS)}


class MockNano:
    """A model of the Nano's protocol; see the module for its limits.

    clock_error: the MCU counts 16e6 (1 + e) cycles per world second;
    slot_phase [ck]: the first slot; timer_start [s]: from reset to ck = 0;
    boot: what lies between a reset (also the first) and the program.
    """

    def __init__(self, clock_error: float = 0.0, eeprom: bytes | None = None,
                 host_baud: int = 500_000, slot_phase: int = 2000,
                 timer_start: float = 0.0, boot: BootWait | None = None) -> None:
        self.now = 0.0
        self.eeprom = eeprom
        self._out: list[tuple[bytes, float]] = []
        board_id, params = parse_eeprom(eeprom) if eeprom else (None, {})
        self.board_id = 0xDA27DA27 if board_id is None else board_id
        self.boot_count = 0
        self.params = {p.id: p.default for p in m.PARAMS} | params
        self._stored = bool(params)
        self.imu = MockImu()
        self._capture_gate = ""
        self._pins = MockPins(0, 0.0, 0.0, [])
        self.rings = (MockEncoder(even_ring(RING_A).edges), MockEncoder(even_ring(RING_B).edges))
        self._rate = 2e6 * (1.0 + clock_error)
        self._byte = 10.0 / host_baud
        self._phase = slot_phase
        self._timer_start = timer_start
        self._wait = boot or BootWait()
        self._dead = False
        self._vcc = 5.0
        self._divider: tuple[float | None, float] = (None, 0.0)
        self._rc_levels = 0
        self._imu_from = 0.0
        self._boot("external" if boot and any(boot) else "power")

    # -- the Nano protocol -------------------------------------------------

    def run(self, until: float) -> bool:
        """Advance to ``until``; True = stopped right after a frame left the UART."""
        uart = self._uart
        while True:
            t = min(until, self._slot_at, uart.tx_at, uart.rx_at)
            booting = self.now < self._starts
            t = min(t, self._starts) if booting else t
            for ring in self.rings:
                if ring.due <= t:
                    ring.run(t, self._ck, 2 * self.params[4])
                if booting:
                    ring.clear()
            self.now = t
            if t == self._slot_at:
                self._slot()
            if t == uart.rx_at:
                block = uart.take_received()
                if t >= self._starts:
                    self._receive(block)
                uart = self._uart
            if t == uart.tx_at:
                self._out.append((uart.take_sent(), t))
                return True
            if t >= until:
                return False

    def read(self) -> list[tuple[bytes, float]]:
        """Frames that have left since the last call, with the times of their stop bits."""
        out = self._out
        self._out = []
        return out

    def write(self, data: bytes) -> None:
        """Bytes from the host; they start on the line now."""
        self._uart.arrive(data, self.now)

    def set_baud(self, host_baud: float) -> None:
        """Do nothing: the line carries bytes at any rate."""

    def set_ring(self, ring: int, marks: Sequence[float]) -> None:
        self.rings[ring].set_marks(marks, self.now)

    def set_wheel(self, rev_per_s: float) -> None:
        self.rings[0].set_rate(rev_per_s, self.now)
        if self.params[3]:
            self.rings[1].set_rate(rev_per_s, self.now)

    def set_imu(self, gyro: Sequence[float], lin_acc: Sequence[float]) -> None:
        self.imu.set(self.now, gyro, lin_acc)

    def set_i2c(self, fault: str, p: float = 1.0, stretch_us: float = 180.0) -> None:
        """Set a fault of the IMU bus: any but "ok" stops the samples."""
        self.imu.fault = "ok" if fault == "ok" else "off"

    def set_imu_fault(self, fault: str = "ok", value: float = 1.0) -> None:
        """Set a fault of the IMU, one of those of `EmulatedNano.set_imu_fault`."""
        self.imu.fault = fault
        self.imu.value = value

    def reset_imu(self) -> None:
        """Restart the IMU, which answers again after its start and the first read."""
        self._imu_from = self.now + IMU_RESET + IMU_START - 0.40

    def set_chatter(self, ring: int, rate: float, irregular: bool = True) -> None:
        """Add random edges; raises UsageError for a chatter that starves interrupts."""
        if rate and not irregular:
            raise UsageError("MockNano has no interrupts to starve", remedy="use nano=avr")
        self.rings[ring].set_noise(rate, self.now)

    def set_power(self, on: bool) -> None:
        """Switch the supply; without it no pin is driven."""
        self._dead = not on
        self._boot("power")

    def set_vcc(self, volt: float) -> None:
        """Set the supply [V]; below 2.7 the brown-out detector keeps the MCU in reset."""
        low = self._vcc < BROWN_OUT_VOLT
        self._vcc = volt
        if (volt < BROWN_OUT_VOLT) != low:
            self._dead = volt < BROWN_OUT_VOLT
            self._boot("brownout")

    def set_pin(self, name: str, level: bool) -> None:
        """Set the level of an input pin; D8 is the input capture."""
        if name == "D8":
            self._capture.edge(self._pins.board_edge(level, self.now), self._ck(self.now))
        elif name in RECEIVER_PINS:
            bit = 1 << RECEIVER_PINS.index(name)
            self._rc_levels = self._rc_levels & ~bit | (bit if level else 0)
            if self._requested & m.BEAT_REQUESTS["RC"]:
                self._receiver.edge(self._ck(self.now), self._rc_levels)

    def set_divider(self, volt: float | None, ohm: float = 7500.0) -> None:
        """Set the voltage [V] at A0 behind a resistance; None: nothing is connected."""
        self._divider = (volt, ohm)

    def gate_capture(self, pin: str) -> None:
        """Connect D8 through a cut-off: low unless "D5" or "D6" is high; "": always."""
        self._capture_gate = self._pins.capture_gate = pin

    def pins(self) -> dict[str, int | None]:
        """Return the levels of the option pins D5, D6, D9; None = released."""
        booting = self.now < self._starts
        return dict.fromkeys(self._pins.levels) if booting else dict(self._pins.levels)

    def pin_log(self) -> list[tuple[float, str, int | None]]:
        """Return edges (t, pin, level) of the option pins since the last call."""
        return self._pins.take(self.now)

    def reset(self, cause: str = "external") -> None:
        self._boot(cause)

    def close(self) -> None:
        """Do nothing: there is nothing to release."""

    # -- boot and slots ------------------------------------------------------

    def _boot(self, cause: str, restart: bool = False) -> None:
        """Start the program; ``restart``: by the program itself, without bootloader."""
        self.boot_count += not self._dead
        wait = self._wait
        hidden = wait.clears and not restart and cause != "power"
        self._cause = RESET_CAUSES["external" if hidden else cause]
        duration = wait.startup + (wait.external if cause == "external" else wait.other)
        if self._dead or (cause == "watchdog" and wait.other and not restart):
            # ATmegaBOOT never leaves the reset of a watchdog.
            duration = float("inf")
        self._starts = self.now if restart else self.now + duration
        self._boot_at = self._starts + self._timer_start
        self.nonce = crc16(struct.pack("<IH", self.board_id, self.boot_count & 0xFFFF))
        self.supervisor = MockSupervisor(self.nonce, self.params[10] * 1e-3)
        for ring in self.rings:
            ring.clear()
        self._slots = self._seq = self._events = 0
        self._sample: tuple[int, ...] | None = None
        self._look = 0
        self._sample_at = float("-inf")
        self._equal = self._edges_at_change = 0
        self._out = []
        self._uart = MockUart(self._byte, self.now)
        self._capture = MockCapture()
        self._queue: deque[tuple[m.Message, Any]] = deque()
        self._edges: list[int] = []
        self._requested = self._battery_slots = 0
        self._receiver = MockReceiver(0)
        self._decoder = FrameDecoder(DOWN)
        before = self._pins.take(self.now)
        self._pins = MockPins(self.params[7], self.now, self._starts, before)
        self._pins.capture_gate = self._capture_gate
        self._slot_at = self._time(self._phase)
        self._hello_slots = {1, 11, 21}
        self._event(1, self._cause)

    def _ck(self, t: float) -> int:
        return int((t - self._boot_at) * self._rate) & 0xFFFFFFFF if t > self._boot_at else 0

    def _time(self, ck: int) -> float:
        return self._boot_at + ck / self._rate

    def _slot(self) -> None:
        ck = self._phase + self._slots * SLOT_CK
        self._slots += 1
        self._slot_at = self._time(ck + SLOT_CK)
        self.supervisor.check(self.now)
        self._report_changes()
        self._send(m.STATE, self._state(ck & 0xFFFFFFFF), self.now + LATCH_TO_UART)
        if self.supervisor.age(self.now) > self.supervisor.timeout:
            self._requested = 0
        self._battery_slots += 1
        if self._requested & m.BEAT_REQUESTS["BATTERY"] \
                and self._battery_slots % BATTERY_SLOTS == 0:
            values = measure_divider(ck & 0xFFFFFFFF, *self._divider, self._vcc)
            self._queue.append((m.BATTERY, values))
        if self._requested & m.BEAT_REQUESTS["RC"] and self._slots % 2:
            self._send(m.RC, self._receiver.frame(ck & 0xFFFFFFFF))
        elif self._slots in self._hello_slots:
            self._send(m.HELLO, self._hello(0))
        elif self._slots % 50 == 0:
            self._send(m.DIAG, self._diag(ck & 0xFFFFFFFF))
        elif self._queue:
            self._send(*self._queue.popleft())
        elif self._capture.done(ck):
            self._send(m.CAPTURE, self._capture.take())
        elif self._edges:
            self._send_edges()

    def _state(self, ck: int) -> tuple[int, ...]:
        a, b = self.rings
        flags = _FLAG["MOCK"] | self._imu_flags()
        flags |= 0 if self._stored else _FLAG["PARAM_DEFAULTS"]
        age = self.supervisor.age(self.now)
        live = self.supervisor.state
        flags |= _FLAG["BEAT_OK"] if age <= self.supervisor.timeout else 0
        flags |= _FLAG["OUTPUT_LIVE"] if live is OutputState.LIVE else 0
        flags |= _FLAG["TRIPPED"] if live in (OutputState.TRIPPED, OutputState.LOCKED) else 0
        second = (b.count & 0xFFFF, b.last_ck) if self.params[3] else (0, 0)
        flags |= _FLAG["ENC2_PRESENT"] if self.params[3] else 0
        return (ck, a.count, a.last_ck, a.interval_ck, *second,
                *(self._sample or (0,) * 6), self._imu_age(),
                0xF0 | self._look if self._sample else 0,
                flags, min(255, int(age * 1e3)) if age < 1.0 else 255)

    def _imu_flags(self) -> int:
        """Take the IMU sample that was read before this slot, and return the flags of STATE."""
        t = self.now - IMU_READ
        started = self.now - self._boot_at >= IMU_START and self.now >= self._imu_from
        sample = self._read_imu(t) if started else None
        look = self.imu.sample(t + GYRO_READ - LOOK_TO_READ) if sample else None
        self._look = self._compare_look(sample, look) if sample else 0
        if sample is not None and not any(sample):
            return _FLAG["IMU_VALID"] if t - self._sample_at < SAMPLE_VALIDITY else 0
        if sample is not None:
            self._equal = self._equal + 1 if sample == self._sample else 0
            self._sample = sample
            self._sample_at = t
            stuck = self._equal >= STUCK_SAMPLES and self.rings[0].count != self._edges_at_change
            self._edges_at_change = self._edges_at_change if self._equal else self.rings[0].count
            return _FLAG["IMU_STUCK"] if stuck else _FLAG["IMU_VALID"]
        age = self.now - max(self._sample_at, self._boot_at)
        stale = _FLAG["IMU_STALE"] if self._sample is not None and age > 0.020 else 0
        return stale | (_FLAG["IMU_ABSENT"] if age > 6.0 else 0)

    def _read_imu(self, t: float) -> tuple[int, ...] | None:
        """Read the acceleration at t and the gyro after it; None = no answer."""
        first = self.imu.sample(t)
        second = self.imu.sample(t + GYRO_READ) if first else None
        return (*first[:3], *second[3:]) if first and second else None

    def _compare_look(self, sample: tuple[int, ...], look: tuple[int, ...] | None) -> int:
        """Return when the gyro's words changed: 1 before the look, 2 after it, 3 both."""
        if look is None or self._sample is None:
            return 0
        return (look[3:] != self._sample[3:]) | (sample[3:] != look[3:]) << 1

    def _imu_age(self) -> int:
        age = (self.now - self._sample_at) * 250e3
        return round(age) if age < 65535 else 65535

    # -- messages --------------------------------------------------------------

    def _send(self, message: m.Message, values: Any, earliest: float | None = None) -> None:
        data = encode(message, self._seq, values)
        self._seq = (self._seq + 1) & 0xFF
        self._uart.send(data, self.now if earliest is None else earliest)

    def _hello(self, req_seq: int) -> dict[str, Any]:
        caps = 2 | 32 | (1 if self.params[3] else 0) | {0: 0, 1: 4, 2: 8}[self.params[7]]
        return {"proto": m.PROTO, "req_seq": req_seq, "schema": m.SCHEMA,
                "fw_version": (0, 0, 0), "build": 0x04, "git": 0, "board_id": self.board_id,
                "boot_count": self.boot_count & 0xFFFF, "reset_cause": self._cause,
                "bootloader": 2 if self._wait.clears else int(any(self._wait)),
                "boot_nonce": self.nonce,
                "edges_per_rev": (self.params[1], self.params[2]), "caps": caps,
                "clock_hz": m.TICKS_PER_SECOND, "param_crc": crc16(encode_params(self.params))}

    def _diag(self, ck: int) -> dict[str, int]:
        c = self._decoder.counters
        zero = dict.fromkeys((f.name for f in m.DIAG.fields), 0)
        return zero | {"t_ck": ck, "rx_ok": c.ok & 0xFFFF, "rx_crc": (c.crc + c.cobs) & 0xFFFF,
                       "rx_len": (c.length + c.unknown) & 0xFFFF, "rx_seq_gap": c.gaps & 0xFFFF,
                       "edges_rejected": self.rings[0].rejected & 0xFFFF,
                       "loop_max_us": round(1e6 * MAX_LOOP_TIME), "stack_free": 1000,
                       "vcc_mv": round(1e3 * self._vcc), "boot_count": self.boot_count & 0xFFFF}

    def _event(self, code: int, arg: int) -> None:
        self._events = (self._events + 1) & 0xFF
        values = (self._ck(self.now), code, self._events, arg)
        self._queue.extend([(m.EVENT, values)] * 3)

    def _report_changes(self) -> None:
        for old, new in self.supervisor.changes:
            self._event(2, old << 8 | new)
            self._pins.apply_state(new, self.now)
        self.supervisor.changes.clear()

    def _send_edges(self) -> None:
        """Send eight successive intervals as soon as their last edge has been counted."""
        if self.rings[0].count < self._edges[0]:
            return
        last = self._edges.pop(0)
        chosen = [e for e in self.rings[0].recent if last - 8 < e[0] <= last]
        if len(chosen) == 8:
            self._send(m.EDGES, (chosen[0][0], chosen[-1][1], *(e[2] for e in chosen)))
        else:
            # The edges are too fast for one frame per slot: continue with the present ones.
            lead = self.rings[0].count - last
            self._edges = [last + lead, *(e + lead for e in self._edges)]

    # -- requests ----------------------------------------------------------------

    def _receive(self, block: bytes) -> None:
        for frame in self._decoder.feed(block):
            handler = getattr(self, "_on_" + frame.message.name.lower(), None)
            if handler is not None:
                handler(frame, self.now)

    def _on_hello_req(self, frame: WireFrame, t: float) -> None:
        self._send(m.HELLO, self._hello(frame.seq))
        if frame.as_dict()["flags"] & 1:
            self._queue.append((m.DIAG, self._diag(self._ck(t))))

    def _on_heartbeat(self, frame: WireFrame, t: float) -> None:
        beat = frame.as_dict()
        self.supervisor.beat(t, beat["arm_token"], beat["mode"])
        requested = beat["flags"] & sum(m.BEAT_REQUESTS.values())
        if (requested ^ self._requested) & m.BEAT_REQUESTS["RC"]:
            self._receiver = MockReceiver(self._ck(t), self._rc_levels)
        if (requested ^ self._requested) & m.BEAT_REQUESTS["BATTERY"]:
            self._battery_slots = 0
        self._requested = requested

    def _on_time_ping(self, frame: WireFrame, t: float) -> None:
        begin = max(self._uart.tx_free, t + LATCH_TO_UART)
        ping_id, host_us = frame.values()
        self._send(m.TIME_PONG, (ping_id, host_us, self._ck(t), self._ck(begin), 0), begin)

    def _on_param_get(self, frame: WireFrame, t: float) -> None:
        (ident,) = frame.values()
        known = ident in self.params
        self._queue.append((m.PARAM_VALUE, (ident, 0 if known else 1, frame.seq,
                                            self.params.get(ident, 0))))

    def _on_param_set(self, frame: WireFrame, t: float) -> None:
        ident, _, value = frame.values()
        spec = next((p for p in m.PARAMS if p.id == ident), None)
        status = 1 if spec is None else 0 if spec.low <= value <= spec.high else 2
        if status == 0 and self.params[ident] != value:
            self.params[ident] = value
            self._stored = True
            self._event(6, ident)
        self._queue.append((m.PARAM_VALUE, (ident, status, frame.seq,
                                            self.params.get(ident, 0))))

    def _on_reboot(self, frame: WireFrame, t: float) -> None:
        magic, kind = frame.values()
        if magic == m.REBOOT_MAGIC and kind in (1, 2):
            self._boot("watchdog", restart=True)

    def _on_edges_req(self, frame: WireFrame, t: float) -> None:
        (n,) = frame.values()
        first = self.rings[0].count
        self._edges = [first + 8 * (k + 1) for k in range(min(n, 4096))]

    def _on_capture_req(self, frame: WireFrame, t: float) -> None:
        (n,) = frame.values()
        self._capture.begin(n, self._ck(t))
