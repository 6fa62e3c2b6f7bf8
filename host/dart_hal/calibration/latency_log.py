"""When what happened: commands as they went to the pins, edges and yaw rate as the car made them.

All on the car's own clock. The Nano's stamps come to it by the clock fit; a command stands in the
heartbeat that follows the write of its pulses; when the IMU took a sample tell the looks at its
gyro (``imu_clock``).
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from statistics import median
from typing import NamedTuple, Protocol

import numpy as np

from dart_hal.car.identity import Hello
from dart_hal.car.telemetry import compose_mounting
from dart_hal.core.config import CarFiles
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import FloatArray, State
from dart_hal.estimation.frames import FrameReader, Sample
from dart_hal.estimation.imu_clock import AGE_STD, ImuClock, gyro_read_delay
from dart_hal.wire.codec import DOWN, UP
from dart_hal.wire.decoder import Decoder
from dart_hal.wire.messages import DIAG, HEARTBEAT, STATE, TICKS_PER_SECOND
from dart_hal.wire.plausible import Gates

from .sensor_log import WatchedCar

FEW = 50
"""Frames below which nothing can be said."""
WRAP = 1 << 32


class LoggedCar(WatchedCar, Protocol):
    """A car with the capabilities of its firmware and the mounting of its IMU."""

    @property
    def files(self) -> CarFiles: ...

    @property
    def hello(self) -> Hello: ...


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

    def __init__(self, car: LoggedCar) -> None:
        self._up, self._down = Decoder(UP, Gates()), Decoder(DOWN)
        self._reader, self._imu_clock = FrameReader(compose_mounting(car.files)), ImuClock()
        self._reader.identified(car.hello.caps)
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
        if len(seen) < FEW or not written:
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
