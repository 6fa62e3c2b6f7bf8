"""From a command to its pulse: the PCA9685's frames, seen by the Nano's capture pin.

The chip's counter runs by itself; a pulse that was written begins with the next frame. While the
Nano times the pulses of the spare channel, one is made longer in the middle: how many of them were
long says which was the first, and how long after the write it rose. What that wait has beyond "the
next frame" is the bus and the chip. On the mean a command waits for half a frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from dart_hal.core.config import CarFiles
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.devices.actuation.quantiser import STEPS, counter_of
from dart_hal.wire.messages import TICKS_PER_SECOND

from .latency_log import LoggedCar, TrafficLog
from .runner import AskingCar, Runner

TRIALS, PERIODS = 12, 12
"""Captures, and PWM periods of each: a quarter of a second."""
WAIT = 0.1 + 0.025 * PERIODS + 0.3
"""s for one capture: what the Nano waits at most, and its turn on the line."""
LONGER_US = 80.0
"""By which the spare channel's pulse is made longer: 16 counts."""
PULSE = 1.5e-3
"""s; servo and ESC know a pulse at its end."""
UNSEEN = 1.5e-3
"""s, one sigma of the mean wait where no wire shows it: bus, and in which frame the chip acts."""
BUS, BUS_STD = 0.9e-3, 0.3e-3
"""s from a command until the chip has latched it: ten bytes are 0.9 ms at 100 kHz, 0.2 at 400."""
CLOSE = 0.8e-3
"""s around the begin of a frame in which nobody knows whether a write still counts."""
STAMP = 0.5e-3
"""s, a floor: stamps and the clock fit."""


class PulseCar(AskingCar, LoggedCar, Protocol):
    """What the procedure needs of a Car."""

    def clock_pulse(self, on: bool, longer_us: float = ...) -> float: ...


@dataclass(frozen=True, slots=True)
class Grid:
    """When the PWM frames begin: ``first`` [s], and their ``period`` [s].

    extra [s] with std: from a write to the earliest frame that it can act in. phase_std [s]: one
    sigma of when a frame begins; without the wire nobody knows, and it is uniform.
    """

    first: float
    period: float
    extra: float
    extra_std: float
    phase_std: float
    seen: bool

    def pulses(self, t: FloatArray, width_us: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(end [s], width [us]) of the first pulses that carry what was written at t (n,) [s].

        Of two writes within one frame the second counts.
        """
        earliest = t + self.extra
        if not self.seen:
            return earliest + 0.5 * self.period + 1e-6 * width_us, width_us
        frames = np.ceil((earliest - self.first) / self.period - 1e-6)
        last = np.append(np.diff(frames) > 0.0, True)
        return self.first + frames[last] * self.period + 1e-6 * width_us[last], width_us[last]

    def doubtful(self, t: FloatArray) -> BoolArray:
        """Which writes at t (n,) [s] came so close to a frame that it may be this or the next."""
        if not self.seen:
            return np.zeros(len(t), dtype=bool)
        phase = ((t + self.extra - self.first) / self.period + 0.5) % 1.0 - 0.5
        return np.asarray(np.abs(phase) * self.period < CLOSE)

    @property
    def to_pulse(self) -> tuple[float, float]:
        """(mean, one sigma) [s] from a command to the end of the first pulse that carries it."""
        return 0.5 * self.period + self.extra + PULSE, math.hypot(self.extra_std, STAMP)


def period_of(files: CarFiles) -> float:
    """One PWM frame [s] by the car's clock."""
    return STEPS * counter_of(files)[1] * 1e-6


def measured_grid(car: PulseCar, log: TrafficLog, trials: int = TRIALS) -> Grid:
    """The frames, by captures at a standstill inside ``raw()``; not ``seen`` without the wire."""
    runner, center = Runner(car), car.files.config.steering.center_us
    rows: list[tuple[float, float, float, float]] = []
    try:
        for k in range(trials):
            row = _trial(car, runner, log, center, 0.03 + 0.013 * k)
            if row is None and not rows:
                return unseen_grid(car.files)
            if row is not None:
                rows.append(row)
    finally:
        car.clock_pulse(False)
    if len(rows) < max(trials // 2, 2):
        raise CalibrationFailed(
            "the Nano sees the PCA9685's pulses now and then", found=f"{len(rows)} of {trials}",
            expected=f"{trials}", likely="a loose wire from the spare channel to D8",
            remedy="mend it or take it off: without it the wait is derived")
    return _fitted(np.array(rows), period_of(car.files))


def unseen_grid(files: CarFiles) -> Grid:
    """What is known without the wire: the period."""
    period = period_of(files)
    return Grid(0.0, period, BUS, UNSEEN, period / math.sqrt(12.0), seen=False)


def _trial(car: PulseCar, runner: Runner, log: TrafficLog, center: float, after: float
           ) -> tuple[float, float, float, float] | None:
    """(write, first long rise, first rise, period) [s]; None: no pulse was seen."""
    car.clock_pulse(True)
    runner.hold(0.06, center, 0.0)
    car.answers("CAPTURE")
    car.request("CAPTURE_REQ", frames=PERIODS)
    runner.hold(after, center, 0.0)
    written = car.clock_pulse(True, LONGER_US)
    runner.hold(WAIT, center, 0.0)
    answers = car.answers("CAPTURE")
    return None if not answers else _read(answers[-1], log, written)


def _read(captured: dict[str, Any], log: TrafficLog, written: float
          ) -> tuple[float, float, float, float] | None:
    if captured["frames"] < PERIODS:
        return None
    ticks = (captured["last_rise"] - captured["first_rise"]) % (1 << 32)
    short, long = captured["high_min"], captured["high_max"]
    if long - short < 0.5e-6 * LONGER_US * TICKS_PER_SECOND:
        return None
    n = captured["frames"]
    many = round((captured["high_sum"] - n * short) / (long - short))
    first, last = (log.host_time(captured[name]) for name in ("first_rise", "last_rise"))
    period = (last - first) / n
    if not 0 < many < n or ticks <= 0:
        return None
    return written, first + (n - many) * period, first, period


def _fitted(rows: FloatArray, nominal: float) -> Grid:
    """One line through the frames of all captures, and what the waits have beyond it."""
    written, risen, first, periods = rows.T
    period = float(np.median(periods))
    for _ in range(3):  # the longer the line, the surer which frame is which
        frames = np.round((first - first[0]) / period)
        period, start = np.polyfit(frames, first, 1)
    spread = float(np.std(first - (start + period * frames)))
    if abs(period / nominal - 1.0) > 0.01:
        raise CalibrationFailed(
            "the PCA9685 has another frame than its clock says",
            found=f"{1e3 * period:.3f} ms", expected=f"{1e3 * nominal:.3f} ms",
            likely="the clock in the car's files is another board's, or something else is at D8",
            remedy="dart-hal calibrate clock first")
    next_frame = start + period * np.ceil((written + BUS - start) / period)
    later = float(np.median(np.round((risen - next_frame) / period)))
    return Grid(float(start), float(period), BUS + later * period, BUS_STD, spread + 1e-4,
                seen=True)
