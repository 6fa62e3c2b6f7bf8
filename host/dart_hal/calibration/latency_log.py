"""Times of commands at the pins, of encoder edges and of yaw rates, on the clock of the car.

Stamps of the Nano are converted by the clock fit. A write of pulses is logged with the heartbeat
that follows it. The time of a sample of the IMU comes from the reads of its gyro (``imu_clock``).

``PwmGrid`` describes when the frames of the PCA9685 begin. The counter of the chip runs freely, and
a written pulse begins with the next frame. To find the frames, the Nano times the pulses of the
spare channel while one write makes them longer:

1. The number of long pulses gives the first long one, and its delay after the write.
2. A line through the first rises of all captures gives period and phase of the frames.
3. The delay minus the wait for the next frame is the delay of bus and chip.

On average a command waits for half a frame.
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
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.messages import DIAG, HEARTBEAT, STATE, TICKS_PER_SECOND
from dart_hal.wire.plausible import Gates

from .runner import CalibrationRunner

MIN_TRAFFIC_FRAMES = 50
STAMP_WRAP = 1 << 32
# Captures, and PWM periods of each: a quarter of a second.
CAPTURE_TRIALS = 12
CAPTURE_PERIODS = 12
# s for one capture: timeout of the Nano, and transfer of the answer.
CAPTURE_WAIT = 0.1 + 0.025 * CAPTURE_PERIODS + 0.3
# us by which the pulse of the spare channel becomes longer: 16 counts.
LONGER_US = 80.0
# s; servo and ESC know a pulse at its end.
PULSE_DURATION = 1.5e-3
# s, one sigma of the mean wait without the wire: bus, and the frame in which the chip acts.
UNMEASURED_WAIT_STD = 1.5e-3
# s from a command until the chip has latched it: ten bytes are 0.9 ms at 100 kHz, 0.2 at 400.
LATCH_DELAY = 0.9e-3
LATCH_DELAY_STD = 0.3e-3
# s around the begin of a frame in which a write may act in this frame or in the next.
AMBIGUOUS_WRITE = 0.8e-3
# s, lower limit of the standard error: stamps and the clock fit.
PULSE_STAMP_STD = 0.5e-3


class PulseWrite(NamedTuple):
    """Pulses [us] that were written to the chip at t [s]."""

    t: float
    steering_us: float
    throttle_us: float


class TrafficFrame(NamedTuple):
    """One STATE frame.

    t, arrival [s]: when it was latched and received; t_dev [s]: its device time. ticks, edge_t [s]:
    count of edges, time of the last one. yaw_rate [rad/s] of this sample (nan = none); yaw_t [s]:
    begin of a read that finds the sample at its mean age; age_std [s]: one sigma of that age.
    speed [m/s]. t_std [s]: one sigma of t.
    """

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
    """Traffic of one time span: writes (n, 3) and frames (m, 10), columns as named above.

    slot [s]: longest loop of the firmware, with its read of the IMU, by the latest DIAG; nan = none
    was received.
    """

    written: FloatArray
    frames: FloatArray
    slot: float

    def column(self, name: str) -> FloatArray:
        """Return one column of the frames (m,)."""
        return np.asarray(self.frames[:, TrafficFrame._fields.index(name)])

    @property
    def read_delay(self) -> tuple[float, float]:
        """(s from the begin of a read of the IMU to the yaw rate, one sigma)."""
        return gyro_read_delay(self.slot)

    @property
    def edges(self) -> tuple[FloatArray, FloatArray]:
        """(time [s], count) (k,) of the edges that were the last when a frame was made."""
        t = self.column("edge_t")
        ticks = self.column("ticks")
        fresh = np.diff(ticks, prepend=ticks[0] - 1) > 0
        return t[fresh], ticks[fresh]


class TrafficLog:
    """Logs the traffic of one car from now on.

    A State holds the yaw rate of a sample that jumps back until the next one (``single_samples``).
    At the begin of a turn that rate would be too late. So the raw samples are logged, minus the
    bias that the States subtract.
    """

    def __init__(self, car: Car) -> None:
        self._up = FrameDecoder(UP, Gates())
        self._down = FrameDecoder(DOWN)
        self._reader = FrameReader(compose_mounting(car.files))
        self._imu_clock = ImuClock()
        self._reader.set_capabilities(car.hello.caps)
        self._waiting: deque[tuple[Sample, float]] = deque(maxlen=64)
        self._written: list[PulseWrite] = []
        self._frames: list[TrafficFrame] = []
        self._biases: list[float] = []
        self._slot = math.nan
        car.on_bytes(self._bytes)
        car.on_state(self._state)

    def take(self) -> Traffic:
        """Return the traffic since the last call. Raises CalibrationFailed for too little."""
        written = self._written
        self._written = []
        frames = self._frames
        self._frames = []
        biases = self._biases
        self._biases = []
        if len(frames) < MIN_TRAFFIC_FRAMES or not written:
            raise CalibrationFailed(
                "too little telemetry", found=f"{len(frames)} frames, {len(written)} writes",
                expected=f"at least {MIN_TRAFFIC_FRAMES} frames (100 per second), 1 write",
                remedy="dart-hal doctor")
        rows = np.array(frames)
        if biases:  # most samples do not jump
            rows[:, TrafficFrame._fields.index("yaw_rate")] -= median(biases)
        return Traffic(np.array(written), rows, self._slot)

    @property
    def age_std(self) -> float | None:
        """One sigma [s] of the age of the latest sample of the gyro; None: nothing is known."""
        std = self._imu_clock.std
        return std if std < AGE_STD else None

    def host_time(self, ck: int) -> float:
        """Convert a raw stamp of the Nano to car time [s], by the latest frame."""
        last = self._frames[-1]
        now = round(last.t_dev * TICKS_PER_SECOND)
        past = (now - ck) % STAMP_WRAP
        past -= STAMP_WRAP if past >= STAMP_WRAP // 2 else 0
        return last.t - past / TICKS_PER_SECOND * self._rate()

    def _rate(self) -> float:
        """Seconds of the car's clock per second of the Nano's clock, over the latest frames."""
        first = self._frames[max(len(self._frames) - 500, 0)]
        last = self._frames[-1]
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
                    self._written.append(PulseWrite(t, 0.1 * beat["steering"],
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
        self._frames.append(TrafficFrame(
            state.t, arrival, sample.t_dev, sample.ticks, state.t - (sample.t_dev - sample.edge_t),
            rate, state.t - (sample.t_dev - read) if math.isfinite(read) else math.nan,
            self._imu_clock.std, state.speed, state.health.t_std))


def no_response(quantity: str, command: str, found: float, least: float, unit: str, likely: str,
                remedy: str) -> CalibrationFailed:
    """Make the error for a quantity that does not follow the steps of a command."""
    return CalibrationFailed(f"the {quantity} does not follow the {command}",
                             found=f"a change of {found:.3f} {unit} in each step",
                             expected=f"more than {least} {unit}", likely=likely, remedy=remedy)


@dataclass(frozen=True, slots=True)
class PwmGrid:
    """Times at which the PWM frames begin: ``first`` [s] and every ``period`` [s].

    latch_delay [s] with std: from a write to the earliest frame in which it can act. phase_std [s]:
    one sigma of the begin of a frame. measured: by the wire; without it the phase is unknown, and
    its distribution is uniform.
    """

    first: float
    period: float
    latch_delay: float
    latch_delay_std: float
    phase_std: float
    measured: bool

    def pulses(self, t: FloatArray, width_us: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(end [s], width [us]) of the first pulses that carry the writes at t (n,) [s].

        Of two writes within one frame the second counts.
        """
        earliest = t + self.latch_delay
        if not self.measured:
            return earliest + 0.5 * self.period + 1e-6 * width_us, width_us
        frames = np.ceil((earliest - self.first) / self.period - 1e-6)
        last = np.append(np.diff(frames) > 0.0, True)
        return self.first + frames[last] * self.period + 1e-6 * width_us[last], width_us[last]

    def is_ambiguous(self, t: FloatArray) -> BoolArray:
        """Return for writes at t (n,) [s] whether they may act in this frame or in the next."""
        if not self.measured:
            return np.zeros(len(t), dtype=bool)
        phase = ((t + self.latch_delay - self.first) / self.period + 0.5) % 1.0 - 0.5
        return np.asarray(np.abs(phase) * self.period < AMBIGUOUS_WRITE)

    @property
    def to_pulse(self) -> tuple[float, float]:
        """(mean, one sigma) [s] from a command to the end of the first pulse that carries it."""
        return (0.5 * self.period + self.latch_delay + PULSE_DURATION,
                math.hypot(self.latch_delay_std, PULSE_STAMP_STD))


def pwm_period(files: CarFiles) -> float:
    """Duration of one PWM frame [s] by the car's clock."""
    return COUNTS_PER_FRAME * counter_of(files)[1] * 1e-6


def measure_grid(car: Car, log: TrafficLog, trials: int = CAPTURE_TRIALS) -> PwmGrid:
    """Measure the PWM frames by captures at a standstill, inside ``raw()``.

    Without the wire the result is that of ``assume_grid``. Raises CalibrationFailed if the wire
    works only some of the time.
    """
    runner = CalibrationRunner(car)
    center = car.files.config.steering.center_us
    rows: list[tuple[float, float, float, float]] = []
    try:
        for k in range(trials):
            # Each trial writes a little later in its frame, so that all phases occur.
            row = _capture_change(car, runner, log, center, 0.03 + 0.013 * k)
            if row is None and not rows:
                return assume_grid(car.files)
            if row is not None:
                rows.append(row)
    finally:
        car.clock_pulse(False)
    if len(rows) < max(trials // 2, 2):
        raise CalibrationFailed(
            "the Nano captured only some of the PCA9685's pulses",
            found=f"{len(rows)} of {trials} captures", expected=f"{trials}",
            likely="a loose wire from the spare channel to D8",
            remedy="repair or remove the wire: without it the wait is derived")
    return _fit_grid(np.array(rows), pwm_period(car.files))


def assume_grid(files: CarFiles) -> PwmGrid:
    """Return what is known without the wire: the period."""
    period = pwm_period(files)
    return PwmGrid(0.0, period, LATCH_DELAY, UNMEASURED_WAIT_STD, period / math.sqrt(12.0),
                   measured=False)


def _capture_change(car: Car, runner: CalibrationRunner, log: TrafficLog, center: float, wait: float
                    ) -> tuple[float, float, float, float] | None:
    """Capture pulses and make them longer after ``wait`` [s].

    Returns (write, first long rise, first rise, period) [s]; None without pulses.
    """
    car.clock_pulse(True)
    runner.hold(0.06, center, 0.0)
    car.answers("CAPTURE")
    car.request("CAPTURE_REQ", frames=CAPTURE_PERIODS)
    runner.hold(wait, center, 0.0)
    written = car.clock_pulse(True, LONGER_US)
    runner.hold(CAPTURE_WAIT, center, 0.0)
    answers = car.answers("CAPTURE")
    return None if not answers else _read_capture(answers[-1], log, written)


def _read_capture(captured: dict[str, Any], log: TrafficLog, written: float
                  ) -> tuple[float, float, float, float] | None:
    """Convert a CAPTURE to times; None if it lacks frames or the change of the pulse."""
    if captured["frames"] < CAPTURE_PERIODS:
        return None
    ticks = (captured["last_rise"] - captured["first_rise"]) % (1 << 32)
    short = captured["high_min"]
    long = captured["high_max"]
    if long - short < 0.5e-6 * LONGER_US * TICKS_PER_SECOND:
        return None
    n = captured["frames"]
    # The Nano reports the sum of the high times: sum = n short + long_pulses (long - short).
    long_pulses = round((captured["high_sum"] - n * short) / (long - short))
    first, last = (log.host_time(captured[name]) for name in ("first_rise", "last_rise"))
    period = (last - first) / n
    if not 0 < long_pulses < n or ticks <= 0:
        return None
    return written, first + (n - long_pulses) * period, first, period


def _fit_grid(rows: FloatArray, nominal: float) -> PwmGrid:
    """Fit one line through the frames of all captures, and the delay beyond it.

    nominal [s]: period by the car's clock. Raises CalibrationFailed for another period.
    """
    written, risen, first, periods = rows.T
    period = float(np.median(periods))
    # Number the frames and fit their times; a better period makes the numbers more reliable.
    for _ in range(3):
        frames = np.round((first - first[0]) / period)
        period, start = np.polyfit(frames, first, 1)
    spread = float(np.std(first - (start + period * frames)))
    if abs(period / nominal - 1.0) > 0.01:
        raise CalibrationFailed(
            "the PWM period of the PCA9685 does not fit its clock",
            found=f"{1e3 * period:.3f} ms", expected=f"{1e3 * nominal:.3f} ms within 1 %",
            likely="the clock in the car's files is of another board, or another signal is at D8",
            remedy="dart-hal calibrate clock first")
    next_frame = start + period * np.ceil((written + LATCH_DELAY - start) / period)
    extra_frames = float(np.median(np.round((risen - next_frame) / period)))
    return PwmGrid(float(start), float(period), LATCH_DELAY + extra_frames * period,
                   LATCH_DELAY_STD, spread + 1e-4, measured=True)
