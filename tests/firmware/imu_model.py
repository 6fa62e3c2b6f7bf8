"""BNO055 registers and its bus behind the callbacks of firmware/test/native_api.cpp."""

from __future__ import annotations

import ctypes as c
from typing import NamedTuple

MS = 2000
BUSY = 0
DONE = 1
ADDRESS_NACK = 2
DATA_NACK = 3
ARBITRATION = 4
(PROBE, SETUP, RUN, SAVE, RESET, RESET_WAIT, AFTER_RESET, POWER_OFF, BACKOFF) = range(9)
CHIP_ID = 0x00
LIA = 0x28
GYR = 0x14
CALIB = 0x35
SYS_STATUS = 0x39
UNIT = 0x3B
MODE = 0x3D
TRIGGER = 0x3F
OFFSETS = 0x55
LEG_LIMIT = 6 * MS
SCRIPT_LEG_LIMIT = 8 * MS

_START = c.CFUNCTYPE(c.c_int32, c.c_int32, c.c_int32, c.c_int32, c.POINTER(c.c_uint8), c.c_int32)
_INT = c.CFUNCTYPE(c.c_int32)
_VOID = c.CFUNCTYPE(None)
_ON = c.CFUNCTYPE(None, c.c_int32)


class Calls(c.Structure):
    _fields_ = [("start", _START), ("poll", _INT), ("abort", _VOID), ("lines_low", _INT),
                ("restart", _VOID), ("clear", _VOID), ("power", _ON)]


class View(NamedTuple):
    state: int
    valid: int
    stuck: int
    absent: int
    has_sample: int
    calib: int
    factory: int
    resting: int
    nack: int
    timeout: int
    recover: int
    reinit: int
    start: int
    acc: tuple[int, ...]
    gyro: tuple[int, ...]
    changed: int


class Part:
    """The machine in the library, and the part that it talks to; time in ticks."""

    def __init__(self, core: c.CDLL, plan: int = 0, stretch: int = 360, start: int = 0,
                 address: int = 0x28) -> None:
        self.core = core
        self.now = start
        self.stretch = stretch
        self.address = address
        self.edges = 0
        self.quiet = False
        self.level = 0
        self.fault = "ok"  # ok, nack, hang, sda, scl
        self.frozen = False
        self.updates: tuple[int, ...] = (0,)  # ticks into the slot, multiples of 0.5 ms
        self.deaf_to_power = False
        self.offsets_stick = True
        self.reserved_mode = 0  # bits 7 to 4 as they read
        self.calib = 0xFF
        self.reads: list[int] = []  # registers
        self.log: list[tuple[str, int, int]] = []
        self.max_leg = 0
        self.busy_since: int | None = None
        self.result = DONE
        self.clears = 0
        self.powered = True
        self.reg = bytearray(128)
        self.boot(400 * MS)
        self.calls = Calls(_START(self.start), _INT(self.poll), _VOID(self.abort),
                           _INT(self.lines_low), _VOID(self.restart), _VOID(self.clear),
                           _ON(self.power))
        core.imu_new(c.byref(self.calls), self._u32(), plan)

    def _u32(self) -> c.c_uint32:
        return c.c_uint32(self.now & 0xFFFFFFFF)

    # --- the part -----------------------------------------------------------

    def boot(self, ticks: int) -> None:
        self.ready_at = self.now + ticks
        self.reg[:] = bytes(128)
        self.reg[CHIP_ID] = 0xA0
        self.reg[0x1] = 0xFB
        self.reg[UNIT] = 0x80

    @property
    def awake(self) -> bool:
        return self.powered and self.now >= self.ready_at

    def sample(self) -> None:
        self.reg[CALIB] = self.calib
        fused = self.reg[MODE] & 0x0F == 8
        self.reg[SYS_STATUS] = 5 if fused else 0
        if fused and not self.frozen:
            self.level = self.level % 1000 + 1
            for i in range(3):
                for base in (LIA, GYR):
                    word = self.level + 10 * i
                    self.reg[base + 2 * i:base + 2 * i + 2] = word.to_bytes(2, "little")

    def write(self, reg: int, data: bytes) -> None:
        self.log.append(("w", reg, data[0]))
        for i, value in enumerate(data):
            if reg + i in (CHIP_ID, CALIB, SYS_STATUS):
                continue
            if reg + i >= OFFSETS and not self.offsets_stick:
                continue
            self.reg[reg + i] = value
            if reg + i == MODE:
                self.reg[MODE] |= self.reserved_mode
        if reg == TRIGGER and data[0] & 0x20:
            self.boot(650 * MS)

    # --- the bus ------------------------------------------------------------

    def start(self, reading: int, address: int, reg: int, data: object, size: int) -> int:
        self.busy_since = self.now
        if reading:
            self.reads.append(reg)
        self.transfer = (reading, reg, data, size)
        refused = self.fault == "nack" or not self.awake or address != self.address
        self.result = ADDRESS_NACK if refused else DONE
        self.hangs = self.fault in ("hang", "sda", "scl")
        self.ends = self.now + (45 if refused else (3 + size) * (45 + self.stretch))
        return 0

    def poll(self) -> int:
        if self.busy_since is None:
            return self.result
        if self.hangs or self.now < self.ends:
            return BUSY
        reading, reg, data, size = self.transfer
        if self.result == DONE and reading:
            for i in range(size):
                data[i] = self.reg[reg + i]
        elif self.result == DONE:
            self.write(reg, bytes(data[i] for i in range(size)))
        self._leg_over()
        return self.result

    def _leg_over(self) -> None:
        if self.busy_since is not None:
            self.max_leg = max(self.max_leg, self.now - self.busy_since)
        self.busy_since = None

    def abort(self) -> None:
        self._leg_over()

    def lines_low(self) -> int:
        return int(self.fault in ("sda", "scl"))

    def restart(self) -> None: ...

    def clear(self) -> None:
        self.clears += 1
        if self.fault == "sda":
            self.fault = "ok"

    def power(self, on: int) -> None:
        if on and not self.powered and not self.deaf_to_power:
            self.boot(400 * MS)
            if self.fault in ("hang", "scl"):
                self.fault = "ok"
        self.powered = bool(on)

    # --- time ---------------------------------------------------------------

    def view(self) -> View:
        out = (c.c_int64 * 20)()
        self.core.imu_get(out)
        return View(*out[:13], tuple(out[13:16]), tuple(out[16:19]),  # type: ignore[arg-type]
                    out[19])

    def slots(self, n: int, moving: bool = True) -> View:
        """n slots of 10 ms: look at 0.5 ms, read at 3.5 ms, wakes by the bus each 0.5 ms."""
        for _ in range(n):
            self.edges += moving
            for tick in range(0, 10 * MS, MS // 2):
                if tick in self.updates:
                    self.sample()
                if tick == MS // 2:
                    self.core.imu_look(self._u32())
                if tick == 7 * MS // 2:
                    self.core.imu_slot(self._u32(), self.edges, int(self.quiet))
                self.core.imu_step(self._u32())
                self.now += MS // 2
        return self.view()

    def until(self, state: int, limit_ms: int) -> int:
        """ms until the machine is in a state; AssertionError after limit_ms."""
        for n in range(limit_ms // 10 + 1):
            if self.view().state == state:
                return 10 * n
            self.slots(1)
        raise AssertionError(f"state {self.view().state} after {limit_ms} ms")
