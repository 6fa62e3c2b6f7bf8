"""Acceptance of a car: a fixed list of measurements, the same on a real and on an emulated car.

Each ``AcceptanceStep`` calls a calibration procedure or reads the telemetry, and writes nothing to
the car's files. The throttle is live only with the wheels off the ground. What the car cannot
measure itself is a ``MeterValue`` of an instrument, which may be missing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dart_hal.car import Car
from dart_hal.core.config import Quantity
from dart_hal.core.errors import CalibrationFailed, DartHalError, NotArmed
from dart_hal.core.ports import Workshop
from dart_hal.core.types import FloatArray
from dart_hal.devices.actuation.quantiser import COUNTS_PER_FRAME, counter_of
from dart_hal.estimation.gyro import GYRO_QUANTUM

from .clock import calibrate_clock
from .esc import calibrate_esc
from .imu import take_samples
from .imu_fit import MeasuredTurn, fit_axis, measure_rest
from .latency import arrival_delay, step_throttle
from .latency_fit import fit_wheel
from .latency_log import PwmGrid, TrafficLog, assume_grid, measure_grid
from .measured import QUANTITY_UNITS, Measured
from .procedure import Bench, Progress, silent
from .runner import driving
from .sensor_log import ImuSamples, SensorLog
from .spin import PulseSpan, spinning

# s of telemetry at rest: 2000 frames, which give the clock within 1e-5.
REST_DURATION = 20.0
# s from the first State until the clock of the Nano has been fitted; the fit takes 0.3 s.
CLOCK_FIT_TIME = 2.0
# s after the wheels were turned by hand: they come to rest.
HAND_DURATION = 2.0
# Edges of one turn by hand below which the encoder counts nothing.
MIN_HAND_EDGES = 5
# us beyond the first motion of the two levels of the throttle: 1 and 3 m/s at the tread.
LOW_LEVEL = 15.0
HIGH_LEVEL = 45.0
# s of constant throttle for the times of the edges, and s of it until the speed is constant.
CONSTANT_DURATION = 5.0
SPEED_SETTLING = 2.0
# Full turns of the car by hand to each side: 0.5 deg of 1080.
HAND_TURNS = 3
# s: arming ends at one of the STATE frames, with a pulse each 20 ms.
ARMING_TIME_STD = 0.05
# One sigma of turns that are counted by hand, by a mark on the tyre.
COUNTED_TURNS_STD = 0.05
# s within which the turns by hand are finished, and rad/s below which the car is at rest again.
MAX_HAND_TURN_TIME = 60.0
MAX_REST_RATE = 0.05
# s at rest after the turns.
REST_AFTER_TURN = 1.0
# Standard errors, and share of the prediction, by which values that agree may differ.
AGREEMENT_SIGMAS = 3.0
AGREEMENT_SHARE = 0.05
# By how much sound parts differ from the nominal ones of the emulated car, in the value's unit:
# ceramic resonator +- 0.5 %; zero rate of the BNO055 +- 1 deg/s, its noise up to 0.3 deg/s, each by
# its data sheet; a board that is screwed on by hand within 3 deg; stamps of 10 ms within 1 %.
PART_SCATTER = {"clock_error": 5000.0, "gyro_bias": 0.018, "gyro_noise": 0.006,
                "imu.mount_pitch": 0.053, "imu.mount_roll": 0.053, "stamp_std": 0.1}


class Inspector(Workshop, Protocol):
    """A Workshop that also turns the car by hand and reads instruments."""

    def wheel_turns(self) -> float:
        """Return the turns of a driven wheel since the car was lifted, forward positive."""

    def rotate(self, turns: int) -> None:
        """Turn the car on the spot by full turns, left positive, and leave it at rest."""

    def read_instrument(self, key: str, question: str) -> float | None:
        """Return the reading in the unit of the question; None: there is no instrument."""


@dataclass(frozen=True, slots=True)
class Measurand:
    """One value: number or text; None: no instrument. std: one sigma, None if not known."""

    key: str
    title: str
    value: float | str | None
    unit: str = ""
    std: float | None = None


@dataclass(frozen=True, slots=True)
class MeterValue:
    """A value that needs an instrument, in ``unit``."""

    key: str
    title: str
    unit: str
    question: str


@dataclass
class AcceptanceBench:
    """An open car, its operator, and the PWM frames that an earlier step has measured."""

    car: Car
    inspector: Inspector
    progress: Progress = silent
    grid: PwmGrid | None = None

    def procedure_bench(self) -> Bench:
        """Return the bench of a calibration procedure."""
        return Bench(self.car, self.inspector, self.progress, source=self.car.url)


@dataclass(frozen=True, slots=True)
class AcceptanceStep:
    """One step. ``task``: what the operator does and what moves; shown before it starts.

    measure: None if the step has readings only.
    """

    name: str
    title: str
    task: str
    measure: Callable[[AcceptanceBench], Sequence[Measurand]] | None = None
    readings: tuple[MeterValue, ...] = ()


@dataclass(frozen=True, slots=True)
class AcceptanceOutcome:
    """Outcome of a step. status: measured, failed or skipped; reason, remedy: why and what to do.

    seconds: of the car's clock.
    """

    step: AcceptanceStep
    status: str
    findings: tuple[Measurand, ...] = ()
    reason: str = ""
    remedy: str = ""
    seconds: float = 0.0


def run_step(step: AcceptanceStep, bench: AcceptanceBench) -> AcceptanceOutcome:
    """Run one step; an error of the car or of the measurement is its outcome.

    The readings are taken in any case. The throttle is neutral at the end, also on Ctrl-C.
    """
    findings: list[Measurand] = []
    error: DartHalError | None = None
    before = bench.car.now
    try:
        if step.measure is not None:
            findings += step.measure(bench)
    except DartHalError as raised:
        error = raised
    finally:
        # Neutral before the operator takes readings, which may last minutes.
        bench.car.stop()
    findings += [Measurand(r.key, r.title, bench.inspector.read_instrument(r.key, r.question),
                           r.unit) for r in step.readings]
    seconds = bench.car.now - before
    if error is None:
        return AcceptanceOutcome(step, "measured", tuple(findings), seconds=seconds)
    reason = f"{error.what}: {error.found}" if error.found else error.what
    return AcceptanceOutcome(step, "failed", tuple(findings), reason, error.remedy, seconds)


def skip_step(step: AcceptanceStep, reason: str) -> AcceptanceOutcome:
    """Return the outcome of a step that was not run."""
    return AcceptanceOutcome(step, "skipped", reason=reason)


def agrees(measured: Measurand, predicted: Measurand) -> bool | None:
    """Return whether a value is as predicted; None if one of them is missing."""
    value = measured.value
    expected = predicted.value
    if value is None or expected is None:
        return None
    if isinstance(value, str) or isinstance(expected, str):
        return value == expected
    # Both values have errors: the standard error of the difference, and a share for tolerances.
    limit = (AGREEMENT_SIGMAS * math.hypot(measured.std or 0.0, predicted.std or 0.0)
             + PART_SCATTER.get(measured.key, 0.0))
    return abs(value - expected) <= limit + AGREEMENT_SHARE * abs(expected)


# -- at rest -----------------------------------------------------------------------


def _measure_rest(bench: AcceptanceBench) -> list[Measurand]:
    """Measure rates, clocks, supply and the noise of the IMU."""
    car = bench.car
    log = SensorLog(car)
    bench.progress(0.0, "listening")
    # The first stamps are by the nominal clock of the Nano, until the first fit of the clock.
    for _ in car.states(duration=CLOCK_FIT_TIME):
        pass
    log.pairs()
    states = list(car.states(duration=REST_DURATION))
    rate = log.device_rate()
    last = states[-1]
    seconds = last.t - states[0].t
    lost = last.health.lost - states[0].health.lost
    # The rate is the slope between two time stamps: each has the error t_std.
    std = math.sqrt(2.0) * last.health.t_std / seconds
    found = [
        Measurand("frame_rate", "frames of the Nano", (len(states) - 1) / seconds,
                  "1/s"),
        Measurand("lost_frames", "frames lost", float(lost)),
        Measurand("clock_error", "clock of the Nano against the computer's",
                  1e6 * (1.0 / rate - 1.0), "ppm", 1e6 * std),
        Measurand("stamp_std", "standard deviation of the time stamps", 1e3 * last.health.t_std,
                  "ms"),
    ]
    # Only firmware that measures its own supply reports it.
    volts = [s.health.vcc for s in states if s.health.vcc is not None]
    if volts:
        found.append(Measurand("nano_supply", "supply of the Nano, measured by itself",
                               float(np.mean(volts)), "V", float(np.std(volts))))
    samples = take_samples(log)
    still = measure_rest(samples)
    found += [
        Measurand("imu_rate", "samples of the IMU", _sample_rate(samples), "1/s"),
        Measurand("gyro_bias", "yaw rate of the gyro at rest", float(still.bias[2]), "rad/s",
                  float(still.std[2])),
        Measurand("gyro_noise", "noise of the gyro", _noise(samples.gyro), "rad/s"),
        Measurand("accel_noise", "noise of the accelerometer", _noise(samples.acc), "m/s2"),
    ]
    return found


def _sample_rate(samples: ImuSamples) -> float:
    """Return the samples per second that differ from the one before.

    A chip that is read more often than it measures repeats its samples. With less noise than the
    resolution, as in an emulated car without noise, equal samples are no repetition, and all count.
    """
    rows = np.column_stack([samples.gyro, samples.acc])
    new = np.any(np.diff(rows, axis=0) != 0.0, axis=1)
    counted = new if _noise(samples.gyro) > GYRO_QUANTUM else np.ones(len(new))
    return float(counted.sum() / samples.duration)


def _noise(samples: FloatArray) -> float:
    """Root mean square over the axes of the standard deviation of samples (n, 3)."""
    return float(np.sqrt(np.mean(np.var(samples, axis=0))))


# -- pulses ------------------------------------------------------------------------


def _measure_pwm(bench: AcceptanceBench) -> list[Measurand]:
    """Measure the oscillator of the PCA9685, and compute the PWM frequency."""
    measured = calibrate_clock.measure(bench.procedure_bench())
    hertz = measured.quantities["pwm.oscillator_hz"]
    assert isinstance(hertz, Quantity)
    counts = COUNTS_PER_FRAME * (counter_of(bench.car.files)[0] + 1)
    return [*_quantities(measured),
            Measurand("pwm_frequency", "PWM frequency", hertz.value / counts, "Hz",
                      hertz.std / counts)]


def _measure_delay(bench: AcceptanceBench) -> list[Measurand]:
    """Measure the delays from a command to its pulse, and from a sensor to the computer."""
    log = TrafficLog(bench.car)
    with driving(bench.car):
        bench.grid = measure_grid(bench.car, log)
    arrival, arrival_std = arrival_delay(log.take())
    pulse, pulse_std = bench.grid.to_pulse
    return [Measurand("capture_wire", "pulses arrive at D8 of the Nano",
                      "yes" if bench.grid.measured else "no"),
            Measurand("latency.command_to_pulse", "from a command to the end of its pulse",
                      1e3 * pulse, "ms", 1e3 * pulse_std),
            Measurand("latency.sensor_to_host", "from a sample to its arrival", 1e3 * arrival, "ms",
                      1e3 * arrival_std)]


def _measure_cutoff(bench: AcceptanceBench) -> list[Measurand]:
    """Arm once at neutral, which tests the cut-off and the ESC's neutral time."""
    car = bench.car
    before = car.now
    refusals: tuple[str, ...] = ()
    try:
        car.arm()
    except NotArmed:
        refusals = car.refusals()
    seconds = car.now - before
    kind = car.hello.cutoff
    outcome = "passed"
    if kind == "none":
        outcome = "not fitted"
    elif "CUTOFF_TEST_FAILED" in refusals:
        outcome = "failed"
    elif any(c.name == "CUTOFF_UNPROVEN" for c in car.cautions):
        outcome = "no capture wire"
    car.stop()
    return [Measurand("cutoff", "hardware cut-off", kind),
            Measurand("cutoff_test", "self-test of the cut-off", outcome),
            Measurand("arming", "arm() at neutral", ", ".join(refusals) or "arms"),
            Measurand("arming_time", "time until armed", seconds, "s", ARMING_TIME_STD)]


# -- wheels off the ground ---------------------------------------------------------


def _measure_rotation(bench: AcceptanceBench) -> list[Measurand]:
    """Count the edges of turns by hand."""
    car = bench.car
    inspector = bench.inspector
    inspector.lift()
    try:
        before = next(iter(car.states())).ticks
        inspector.push()
        edges = [state.ticks for state in car.states(duration=HAND_DURATION)][-1] - before
        turns = abs(inspector.wheel_turns())
    finally:
        inspector.set_down()
    # An encoder that misses all edges must not pass as one with few edges per turn.
    if edges < MIN_HAND_EDGES or turns <= 0.0:
        raise CalibrationFailed("the encoder does not count", found=f"{edges} edges in {turns:g} "
                                "turns by hand", expected="some 70 edges per turn of a wheel",
                                likely="unplugged, or its sensor too far from the ring",
                                remedy="turn a wheel by hand and watch dart-hal doctor")
    return [Measurand("edges_per_turn", "edges per turn of a driven wheel", edges / turns, "",
                      edges / turns * math.hypot(COUNTED_TURNS_STD / turns, 1.0 / edges))]


def _measure_esc(bench: AcceptanceBench) -> list[Measurand]:
    """Measure neutral, dead bands, end of the throttle, reverse and loss of signal."""
    measured = calibrate_esc.measure(bench.procedure_bench())
    return [*_quantities(measured),
            Measurand("throttle.reverse", "reverse", str(measured.others["throttle.reverse"]))]


def _measure_wheel(bench: AcceptanceBench) -> list[Measurand]:
    """Measure the times of the edges at a constant pulse, and the delay from pulse to wheel."""
    car = bench.car
    files = car.files
    inspector = bench.inspector
    log = SensorLog(car)
    traffic = TrafficLog(car)
    edges = files.config.encoder.edges_per_rev
    inspector.lift()
    try:
        with spinning(car, inspector, log) as spin:
            bench.progress(0.1, "looking for the first motion")
            first = spin.first_motion(1.0)
            # Both levels are whole counts of the PWM chip, so that the steps are exact.
            low, high = (spin.round_to_count(first + level) for level in (LOW_LEVEL, HIGH_LEVEL))
            bench.progress(0.3, "at a constant throttle")
            constant = spin.hold(CONSTANT_DURATION, high, turns=True)
            bench.progress(0.6, "steps of the throttle")
            traffic.take()
            starts = step_throttle(car, files.config.steering.center_us, high, low, lifted=True)
            steps = traffic.take()
    finally:
        car.stop()
        inspector.set_down()
    grid = bench.grid or assume_grid(files)
    wheel = fit_wheel(grid, steps, starts, (files.neutral_us, files.config.throttle.span_us),
                      files.metres_per_edge.value, edges)
    phase_std = 0.0 if grid.measured else grid.phase_std
    return [Measurand("first_motion", "pulse of the first motion", first, "us", spin.count),
            Measurand("tread_speed", f"speed of the tread {HIGH_LEVEL:.0f} us above it",
                      constant.speed(CONSTANT_DURATION - SPEED_SETTLING), "m/s"),
            Measurand("turn_jitter", "variation of the time of one turn of the ring, by edge times",
                      1e2 * _turn_jitter(constant.without_start(SPEED_SETTLING), edges), "%"),
            Measurand("latency.pulse_to_wheel", "from a pulse to the wheel", 1e3 * wheel.delay[0],
                      "ms", 1e3 * math.hypot(wheel.delay[1], phase_std)),
            Measurand("latency.pulse_to_wheel_lag", "lag of the motor", 1e3 * wheel.lag[0], "ms",
                      1e3 * wheel.lag[1])]


def _turn_jitter(span: PulseSpan, edges_per_rev: int) -> float:
    """Standard deviation of the time of one turn between the same marks, relative.

    Differences of successive turns, so that neither the spacing of the marks nor a slow change of
    speed counts. Raises CalibrationFailed for fewer than three turns.
    """
    # A span has every second edge.
    per_turn = edges_per_rev // 2
    marks = span.t[::per_turn]
    if len(marks) < 4:
        raise CalibrationFailed("the wheels turned too little", found=f"{len(span.t)} edges",
                                expected=f"{4 * per_turn}", likely="the encoder loses edges",
                                remedy="dart-hal doctor")
    turns = np.diff(marks)
    return float(np.std(np.diff(turns)) / math.sqrt(2.0) / np.mean(turns))


# -- IMU ---------------------------------------------------------------------------


def _measure_gyro(bench: AcceptanceBench) -> list[Measurand]:
    """Measure scale and tilt of the gyro: the car is turned by hand to both sides."""
    car = bench.car
    inspector = bench.inspector
    log = SensorLog(car)
    bench.progress(0.0, "at rest")
    for _ in car.states(duration=0.5 * REST_DURATION):
        pass
    still = measure_rest(take_samples(log))
    turns = []
    for k, sign in enumerate((1, -1)):
        bench.progress(0.2 + 0.4 * k, f"{HAND_TURNS} turns by hand")
        inspector.mark()
        log.take()
        inspector.rotate(sign * HAND_TURNS)
        _await_rest(car)
        turns.append(MeasuredTurn(take_samples(log), inspector.turns()))
    if any(abs(turn.angle) < math.pi for turn in turns):
        raise CalibrationFailed("the car was not turned", found=", ".join(
            f"{math.degrees(turn.angle):.0f} deg" for turn in turns),
            expected=f"{360 * HAND_TURNS} deg to each side",
            remedy="run it again and turn the car by hand")
    mounting = fit_axis(turns, still)
    return [Measurand("imu.gyro_scale", "scale of the gyro", mounting.scale.value, "",
                      mounting.scale.std),
            Measurand("imu.mount_pitch", "pitch of the IMU", mounting.pitch.value, "rad",
                      mounting.pitch.std),
            Measurand("imu.mount_roll", "roll of the IMU", mounting.roll.value, "rad",
                      mounting.roll.std)]


def _await_rest(car: Car) -> None:
    """Wait until the car has been at rest for a moment. Raises CalibrationFailed if it is not."""
    moved = -math.inf
    for state in car.states(duration=MAX_HAND_TURN_TIME):
        if state.yaw_rate is None or abs(state.yaw_rate) > MAX_REST_RATE or moved == -math.inf:
            moved = state.t
        if state.t - moved > REST_AFTER_TURN:
            return
    raise CalibrationFailed("the car does not come to rest", found="it still turns after "
                            f"{MAX_HAND_TURN_TIME:.0f} s", expected="a car at rest on the floor",
                            remedy="put it down and run it again")


def _quantities(measured: Measured) -> list[Measurand]:
    """Convert the quantities of a procedure."""
    units = {name: "" if unit == "-" else unit for name, unit in QUANTITY_UNITS.items()}
    return [Measurand(name, STEP_TITLES[name], float(q.value), units[name], float(q.std))
            for name, q in measured.quantities.items() if isinstance(q, Quantity)]


STEP_TITLES = {
    "pwm.oscillator_hz": "oscillator of the PCA9685",
    "throttle.neutral_us": "neutral of the ESC",
    "throttle.deadband_forward_us": "dead band forward",
    "throttle.deadband_reverse_us": "dead band in reverse",
    "throttle.saturation_us": "end of the throttle, from neutral",
    "throttle.reverse_rest": "neutral time between brake and reverse",
    "throttle.signal_loss": "time until the ESC stops without pulses",
}
LIFTED = "The car is on blocks, all four wheels off the ground; fingers and cables away. "
STEPS = (
    AcceptanceStep("rest", "At rest", f"Leave the car at rest for {REST_DURATION:.0f} s. Nothing "
                   "moves.", _measure_rest),
    AcceptanceStep("supply", "Supply", "Read a multimeter. Nothing moves.", readings=(
        MeterValue("battery_volts", "battery", "V", "battery at the ESC [V]"),
        MeterValue("nano_volts", "5 V pin of the Nano", "V", "5V to GND of the Nano [V]"),
        MeterValue("servo_volts", "V+ of the PCA9685", "V", "V+ to GND of the PCA9685 [V]"))),
    AcceptanceStep("pwm", "PWM frequency", "A wire goes from the spare channel of the PCA9685 to "
                   "D8 of the Nano. The throttle stays neutral for 17 s.", _measure_pwm, (
                       MeterValue("pwm_frequency_scope", "PWM frequency by oscilloscope", "Hz",
                                  "PWM frequency of any channel by an oscilloscope [Hz]"),
                       MeterValue("neutral_pulse_scope", "neutral pulse by oscilloscope", "us",
                                  "pulse width of the ESC's channel at neutral [us]"))),
    AcceptanceStep("delay", "Delays of the link", "The same wire. The throttle stays neutral for "
                   "10 s.", _measure_delay),
    AcceptanceStep("cutoff", "Cut-off and arming", "The car arms once at neutral throttle and "
                   "disarms.", _measure_cutoff, (
                       MeterValue("esc_arm_time", "arming time of the ESC by stopwatch", "s",
                                  "switch the ESC off and on: time until its last beep [s]"),)),
    AcceptanceStep("rotation", "Edges of a known rotation", LIFTED + "Turn the wheels by hand; no "
                   "throttle. Mark the tyre first and count its turns.", _measure_rotation),
    AcceptanceStep("esc", "Speed controller", LIFTED + "The wheels spin for about 80 s, up to full "
                   "throttle.", _measure_esc),
    AcceptanceStep("wheel", "From a pulse to the wheel", LIFTED + "The wheels spin for about 25 s.",
                   _measure_wheel),
    AcceptanceStep("gyro", "Scale of the gyro", f"Turn the car on the floor by {HAND_TURNS} full "
                   "turns to each side, by hand; no throttle.", _measure_gyro),
)
STEP_NAMES = tuple(step.name for step in STEPS)
