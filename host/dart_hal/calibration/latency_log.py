"""When what happened: commands as they went to the pins, edges and yaw rate as the car made them.

All on the car's own clock. The Nano's stamps come to it by the clock fit; a command stands in the
heartbeat that follows the write of its pulses; when the IMU took a sample tell the looks at its
gyro (``imu_clock``).

``Grid`` is when the PCA9685's frames begin. The chip's counter runs by itself; a pulse that was
written begins with the next frame. While the Nano times the pulses of the spare channel, one is
made longer in the middle: how many of them were long says which was the first, and how long after
the write it rose. What that wait has beyond "the next frame" is the bus and the chip. On the mean a
command waits for half a frame.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from dart_hal.car import Car
from dart_hal.car.telemetry import compose_mounting
from dart_hal.core.config import CarFiles
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import BoolArray, FloatArray, State
from dart_hal.devices.actuation.quantiser import COUNTS_PER_FRAME, counter_of
from dart_hal.estimation.frames import FrameReader, Sample
from dart_hal.estimation.imu_clock import AGE_STD, ImuClock, gyro_read_delay
from dart_hal.wire.codec import DOWN, UP
from dart_hal.wire.decoder import Decoder
from dart_hal.wire.messages import DIAG, HEARTBEAT, STATE, TICKS_PER_SECOND
from dart_hal.wire.plausible import Gates

from .runner import Runner

MIN_FRAMES = 50
"""Frames below which nothing can be said."""
WRAP = 1 << 32
TRIALS, PERIODS = 12, 12
"""Captures, and PWM periods of each: a quarter of a second."""
CAPTURE_WAIT = 0.1 + 0.025 * PERIODS + 0.3
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
STAMP_STD = 0.5e-3
"""s, a floor: stamps and the clock fit."""


class Written(NamedTuple):
    """Pulses [us] that were on the chip at t [s]."""

    t: float
    steering_us: float
    throttle_us: float


class Seen(NamedTuple):
    """One STATE: t of its latch and arrival [s], device time, edges with the time of the last
    [s], yaw rate [rad/s] of this sample (nan = none), begin [s] of a read that finds it at its mean
    age, one sigma of that age [s], speed [m/s], one sigma of t [s]."""

    t: float
    arrival: float
    t_dev: float
    ticks: int
    edge_t: float
    yaw_rate: float
    yaw_t: float
    age_std: float
    speed: float
    t_std: float


@dataclass(frozen=True, slots=True)
class Traffic:
    """What passed in one stretch: writes (n, 3), frames (m, 10), columns as named above.

    slot [s]: the longest turn of the firmware's loop, its read of the IMU included, as the newest
    DIAG said; nan = none came.
    """

    written: FloatArray
    seen: FloatArray
    slot: float

    def column(self, name: str) -> FloatArray:
        """One column of the frames (m,)."""
        return np.asarray(self.seen[:, Seen._fields.index(name)])

    @property
    def read_after(self) -> tuple[float, float]:
        """(s from the begin of a read of the IMU to the yaw rate, one sigma)."""
        return gyro_read_delay(self.slot)

    @property
    def edges(self) -> tuple[FloatArray, FloatArray]:
        """(time [s], count) (k,) of the edges that were the last when a frame was made."""
        t, ticks = self.column("edge_t"), self.column("ticks")
        fresh = np.diff(ticks, prepend=ticks[0] - 1) > 0
        return t[fresh], ticks[fresh]


class TrafficLog:
    """Follows the traffic of one car from now on.

    A State withholds the yaw rate of a sample that jumps until the next one (``single_samples``).
    At the begin of a turn that is a rate too late, so the samples themselves are logged, less the
    bias that the States take off.
    """

    def __init__(self, car: Car) -> None:
        self._up, self._down = Decoder(UP, Gates()), Decoder(DOWN)
        self._reader, self._imu_clock = FrameReader(compose_mounting(car.files)), ImuClock()
        self._reader.set_capabilities(car.hello.caps)
        self._waiting: deque[tuple[Sample, float]] = deque(maxlen=64)
        self._written: list[Written] = []
        self._seen: list[Seen] = []
        self._biases: list[float] = []
        self._slot = math.nan
        car.on_bytes(self._bytes)
        car.on_state(self._state)

    def take(self) -> Traffic:
        """What came since the last call. Errors: CalibrationFailed if it is next to nothing."""
        written, self._written = self._written, []
        seen, self._seen = self._seen, []
        biases, self._biases = self._biases, []
        if len(seen) < MIN_FRAMES or not written:
            raise CalibrationFailed("no telemetry", found=f"{len(seen)} frames",
                                    expected="100 per second", remedy="dart-hal doctor")
        rows = np.array(seen)
        if biases:  # most samples do not jump
            rows[:, Seen._fields.index("yaw_rate")] -= median(biases)
        return Traffic(np.array(written), rows, self._slot)

    @property
    def age_std(self) -> float | None:
        """One sigma [s] of the age of the newest sample of the gyro; None: nothing tells it."""
        std = self._imu_clock.std
        return std if std < AGE_STD else None

    def host_time(self, ck: int) -> float:
        """Car time [s] of a raw stamp of the Nano, by the newest frame."""
        last = self._seen[-1]
        now = round(last.t_dev * TICKS_PER_SECOND)
        past = (now - ck) % WRAP
        past -= WRAP if past >= WRAP // 2 else 0
        return last.t - past / TICKS_PER_SECOND * self._rate()

    def _rate(self) -> float:
        """Seconds of the car's clock per second of the Nano's, over the newest frames."""
        first, last = self._seen[max(len(self._seen) - 500, 0)], self._seen[-1]
        return (last.t - first.t) / (last.t_dev - first.t_dev) if last is not first else 1.0

    def _bytes(self, direction: str, data: bytes, t: float) -> bytes:
        if direction == "rx":
            for frame in self._up.feed(data):
                if frame.message is STATE:
                    self._waiting.append((self._reader.read(frame.values(), t), t))
                elif frame.message is DIAG:
                    self._slot = 1e-6 * frame.as_dict()["loop_max_us"]
        else:
            for frame in self._down.feed(data):
                if frame.message is HEARTBEAT:
                    beat = frame.as_dict()
                    self._written.append(Written(t, 0.1 * beat["steering"],
                                                 0.1 * beat["throttle"]))
        return data

    def _state(self, state: State) -> None:
        if not self._waiting:
            return
        sample, arrival = self._waiting.popleft()
        rate = math.nan
        if state.yaw_rate is not None and sample.gyro is not None:
            rate = sample.gyro[2]
            self._biases.append(rate - state.yaw_rate)
        if sample.restarted:
            self._imu_clock.restart()
        read = self._imu_clock.mean_read(sample.imu_t, sample.look)
        self._seen.append(Seen(
            state.t, arrival, sample.t_dev, sample.ticks, state.t - (sample.t_dev - sample.edge_t),
            rate, state.t - (sample.t_dev - read) if math.isfinite(read) else math.nan,
            self._imu_clock.std, state.speed, state.health.t_std))


def not_following(answer: str, command: str, found: float, least: float, unit: str, likely: str,
                  remedy: str) -> CalibrationFailed:
    """Why a procedure ends whose steps show nothing."""
    return CalibrationFailed(f"the {answer} does not follow the {command}",
                             found=f"{found:.3f} {unit} each step",
                             expected=f"more than {least} {unit}", likely=likely, remedy=remedy)


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
        return 0.5 * self.period + self.extra + PULSE, math.hypot(self.extra_std, STAMP_STD)


def period_of(files: CarFiles) -> float:
    """One PWM frame [s] by the car's clock."""
    return COUNTS_PER_FRAME * counter_of(files)[1] * 1e-6


def measured_grid(car: Car, log: TrafficLog, trials: int = TRIALS) -> Grid:
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


def _trial(car: Car, runner: Runner, log: TrafficLog, center: float, after: float
           ) -> tuple[float, float, float, float] | None:
    """(write, first long rise, first rise, period) [s]; None: no pulse was seen."""
    car.clock_pulse(True)
    runner.hold(0.06, center, 0.0)
    car.answers("CAPTURE")
    car.request("CAPTURE_REQ", frames=PERIODS)
    runner.hold(after, center, 0.0)
    written = car.clock_pulse(True, LONGER_US)
    runner.hold(CAPTURE_WAIT, center, 0.0)
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
