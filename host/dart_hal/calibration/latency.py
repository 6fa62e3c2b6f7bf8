"""``calibrate latency``: delays and lags of the control loop, in seconds of the car's clock.

1. At rest, the Nano times pulses of the spare channel: from command to pulse.
2. In a circle, the throttle steps up and down: from pulse to the force of the wheels.
3. At low speed, the steering moves in stairs and back, on the left: from pulse to the road wheels,
   and the slew rate of the servo.

The age of each State at its arrival is measured throughout.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from dart_hal.car import Car
from dart_hal.core.config import CarFiles, Quantity
from dart_hal.core.config.quantity import Quantities
from dart_hal.core.types import FloatArray, State
from dart_hal.devices.actuation.quantiser import counter_of

from .by_hand import explain_standstill
from .latency_fit import MIN_SERVO_LAG, WheelDelay, YawDelay, fit_wheel, fit_yaw, load_linkage
from .latency_log import (
    CAPTURE_TRIALS,
    CAPTURE_WAIT,
    PwmGrid,
    Traffic,
    TrafficLog,
    measure_grid,
)
from .measured import Measured
from .procedure import Bench, Procedure, ProcedurePlan, scale_floor
from .runner import CalibrationRunner, check_turning, driving, encoder_doubt
from .steering import estimate_bias

# Steps up and down of the throttle: twice the fewest whose spread gives a standard error.
THROTTLE_REPEATS = 12
# s at rest for the gyro bias: 300 frames.
BIAS_DURATION = 3.0
# m, m/s: circle of the steps of the throttle.
CIRCLE_RADIUS = 1.1
CRUISE_SPEED = 0.9
# Throttle above and below the one that keeps the speed: 1.8 m/s2, and half of coasting.
STEP_UP = 0.12
STEP_DOWN = 0.04
# s of each step.
UP_DURATION = 0.25
DOWN_DURATION = 0.55
# m/s during the steps of the steering, and how often all of ``STAIRS`` are driven.
STAIRS_SPEED = 0.5
STAIRS_ROUNDS = 3
# Steering commands in order, starting after the last one: bends to the left inside that circle.
# Eight steps that continue in the direction of the previous one, four large steps back.
STAIRS = (0.7, 0.5, 0.3, 0.1, -0.1, 0.9, -0.1, 0.1, 0.3, 0.5, 0.7, 0.9, -0.1, 0.9)
# A larger step lasts longer [s]: servo, tyres and gyro come to rest.
LARGE_STEP = 0.5
LARGE_STEP_DURATION = 0.5
SMALL_STEP_DURATION = 0.3
# m: the circle, its growth by slip and by an unmeasured steering map, and the car.
LATENCY_FLOOR = (4.0, 4.0)
# s by which the steps of a repetition last longer, so that they meet all phases of the frames.
PHASE_SHIFTS = (0.0, 0.02, 0.01, 0.03)
# s, one sigma of the age of the gyro's samples that is waited for, and the longest wait. Within a
# minute, clocks that differ by 0.01 % pass one of the two ages at which it can be observed.
AGE_STD_TARGET = 1.0e-3
MAX_AGE_WAIT = 60.0
AGE_WAIT_STEP = 1.0
# s, one sigma of the steering delay above which the age counts as not observed: twice the usual.
MAX_YAW_DELAY_STD = 1.5e-3
# s, lower limit of the standard error of the arrival: what pings cannot measure.
ARRIVAL_STD_FLOOR = 0.3e-3


def plan(files: CarFiles) -> ProcedurePlan:
    """Describe what ``measure`` does."""
    still = CAPTURE_TRIALS * (CAPTURE_WAIT + 0.2)
    seconds = (still + THROTTLE_REPEATS * (UP_DURATION + DOWN_DURATION) + STAIRS_ROUNDS * 5.5
               + 12.0)
    floor = scale_floor(LATENCY_FLOOR, files)
    return ProcedurePlan(
        f"rests for {still:.0f} s, then circles to the left on {CIRCLE_RADIUS:g} m with "
        f"{THROTTLE_REPEATS} steps of the throttle (0.5 to 1.5 m/s) and slowly with "
        f"{STAIRS_ROUNDS * len(STAIRS)} steps of the steering, to measure the delays of the car: "
        f"about {seconds:.0f} s, or a minute more at rest in between, a floor of "
        f"{floor[0]:g} m x {floor[1]:g} m, mostly to its left, no tools; a wire "
        f"from channel {files.config.pwm.clock_channel} to the Nano's D8 shows the pulses",
        seconds, floor)


def measure(bench: Bench) -> Measured:
    """Measure delays and lags [s]; the operator turns a wheel if the car does not move.

    Raises CalibrationFailed (with the likely cause), LinkLost, NotArmed.
    """
    car = bench.car
    files = bench.files
    progress = bench.progress
    log = TrafficLog(car)
    edges = files.config.encoder.edges_per_rev
    metres = files.metres_per_edge.value
    with explain_standstill(car, bench.workshop), driving(car):
        progress(0.0, "timing pulses")
        grid = measure_grid(car, log)
        at_rest = log.take()
        progress(0.2, "steps of the throttle")
        still = CalibrationRunner(car).hold(BIAS_DURATION, _circle_pulse(files), 0.0)
        bias = estimate_bias(still).value
        throttle_traffic, starts = _drive_throttle_steps(car, log, bias)
        progress(0.6, "the gyro's clock")
        _await_gyro_age(car, log)
        progress(0.7, "steps of the steering")
        steering_traffic = _drive_stairs(car, log)
    progress(0.95, "fitting")
    throttle = files.neutral_us, files.config.throttle.span_us
    wheel = fit_wheel(grid, throttle_traffic, starts, throttle, metres, edges)
    yaw = fit_yaw(grid, steering_traffic, load_linkage(files), STAIRS_SPEED, metres, edges)
    seconds = steering_traffic.column("t")[-1] - at_rest.column("t")[0]
    return Measured(files.config.name, bench.source, "latency",
                    _quantities(grid, wheel, yaw, at_rest),
                    f"residuals: edges {1e3 * wheel.rms:.2f} mm rms, yaw rate {yaw.rms:.4f} rad/s "
                    "rms", float(seconds), _notes(files, grid, yaw), graph=yaw.graph,
                    absent=() if yaw.lag is not None else ("latency.pulse_to_yaw_lag",))


def _quantities(grid: PwmGrid, wheel: WheelDelay, yaw: YawDelay, at_rest: Traffic
                ) -> dict[str, Quantity | Quantities]:
    # Without the wire, the begin of a pulse is uncertain by the phase of the PWM frames.
    phase_std = 0.0 if grid.measured else grid.phase_std
    suffix = "" if grid.measured else ", PWM frames not measured"
    steps, turns = (f"{n} steps{suffix}" for n in (THROTTLE_REPEATS, STAIRS_ROUNDS * len(STAIRS)))
    found = {
        "latency.command_to_pulse": (
            *grid.to_pulse, f"{CAPTURE_TRIALS} pulses at D8" if grid.measured else
            "derived: half a PWM frame, the bus and a pulse"),
        "latency.pulse_to_wheel": (wheel.delay[0], math.hypot(wheel.delay[1], phase_std), steps),
        "latency.pulse_to_wheel_lag": (*wheel.lag, steps),
        "latency.pulse_to_yaw": (yaw.delay[0], math.hypot(yaw.delay[1], phase_std), turns),
        "latency.sensor_to_host": (*arrival_delay(at_rest), "arrivals by the clock fit"),
        "steering.slew_us_s": (*yaw.slew, turns),
    }
    if yaw.lag is not None:
        found["latency.pulse_to_yaw_lag"] = (*yaw.lag, turns)
    return {name: Quantity(float(value), float(std), method)
            for name, (value, std, method) in found.items()}


def _notes(files: CarFiles, grid: PwmGrid, yaw: YawDelay) -> tuple[str, ...]:
    notes = []
    if not grid.measured:
        notes.append("caution: D8 received no pulse, so the begin of a pulse is known only to half "
                     "a PWM frame: connect the wire from the spare channel and run it again")
    if files.calibration is None or files.calibration.steering.map is None:
        notes.append("caution: the steering map is not measured, so the slew rate is known only to "
                     "some per cent: dart-hal calibrate steering, then this again")
    if yaw.delay[1] > MAX_YAW_DELAY_STD:
        notes.append("caution: the age of the gyro's samples could not be measured, so "
                     "pulse_to_yaw is known only to some ms (the clocks of gyro and Nano were in "
                     "step: run it again; or the firmware does not measure it: dart-hal flash)")
    if yaw.lag is None:
        notes.append(f"the servo has no lag above {MIN_SERVO_LAG} s: its slew rate limits the "
                     "steps")
    return (*notes, "drive_speed uses these values from the next start on")


def arrival_delay(traffic: Traffic) -> tuple[float, float]:
    """(median, one sigma) [s] from the latch of a State to its arrival."""
    delay = traffic.column("arrival") - traffic.column("t")
    spread = float(np.std(delay) / math.sqrt(len(delay)))
    return float(np.median(delay)), math.hypot(
        spread, float(np.median(traffic.column("t_std"))), ARRIVAL_STD_FLOOR)


def _command_pulse(files: CarFiles, command: float) -> float:
    """Steering pulse [us] of a command, as a whole number of counts, so that nothing dithers."""
    steering = files.config.steering
    return _round_to_count(files, steering.center_us
                           + steering.span_us * steering.direction * command)


def _circle_pulse(files: CarFiles) -> float:
    """Steering pulse [us] of the circle to the left, by the car's map."""
    return _round_to_count(files, load_linkage(files).map.pulse(
        math.atan(files.config.geometry.wheelbase / CIRCLE_RADIUS)))


def _round_to_count(files: CarFiles, pulse_us: float) -> float:
    count = counter_of(files)[1]
    return round(pulse_us / count) * count


def _drive_throttle_steps(car: Car, log: TrafficLog, bias: float) -> tuple[Traffic, FloatArray]:
    """Drive steps of the throttle in a circle; return the traffic and the starts [s].

    The level of the steps comes from the mean pulse that kept the speed for a second.
    """
    files = car.files
    runner = CalibrationRunner(car)
    bend = _circle_pulse(files)
    runner.start_moving(bend, CRUISE_SPEED, bias, True)
    runner.hold(1.0, bend, CRUISE_SPEED)
    log.take()
    runner.hold(1.0, bend, CRUISE_SPEED)
    level = float(np.mean(log.take().written[:, 2]))
    span = files.config.throttle.span_us
    up, down = (_round_to_count(files, level + span * part) for part in (STEP_UP, -STEP_DOWN))
    starts = step_throttle(car, bend, up, down)
    return log.take(), starts


def step_throttle(car: Car, steering_us: float, up: float, down: float, lifted: bool = False
                  ) -> FloatArray:
    """Step between two throttle pulses [us]; return the start of each repetition [s].

    lifted: the wheels are off the ground, where the IMU rightly disagrees with their speed.
    Raises CalibrationFailed if the speed becomes doubtful.
    """
    starts = []
    states = iter(car.states())
    t = _hold_pulses(car, states, steering_us, down, 2 * DOWN_DURATION, lifted)
    for k in range(THROTTLE_REPEATS + 1):
        starts.append(t)
        t = _hold_pulses(car, states, steering_us, up, UP_DURATION + PHASE_SHIFTS[k % 4], lifted)
        t = _hold_pulses(car, states, steering_us, down,
                         DOWN_DURATION + PHASE_SHIFTS[(k + k // 4) % 4], lifted)
    return np.array(starts)


def _hold_pulses(car: Car, states: Iterator[State], steering_us: float, throttle_us: float,
                 seconds: float, lifted: bool) -> float:
    """Hold both pulses for a time; return the time at the end [s].

    Raises CalibrationFailed if the speed becomes doubtful and the car is not lifted.
    """
    start: float | None = None
    for state in states:
        start = state.t if start is None else start
        if state.health.speed_doubted and not lifted:
            raise encoder_doubt(state)
        car.pulses(steering_us=steering_us, throttle_us=throttle_us)
        if state.t - start >= seconds:
            return state.t
    raise AssertionError("states() ended by itself")


def _await_gyro_age(car: Car, log: TrafficLog) -> None:
    """Wait at rest until the age of the gyro's samples is known, if the firmware measures it."""
    runner = CalibrationRunner(car)
    waited = 0.0
    while (log.age_std or 0.0) > AGE_STD_TARGET and waited < MAX_AGE_WAIT:
        runner.hold(AGE_WAIT_STEP, _circle_pulse(car.files), 0.0)
        waited += AGE_WAIT_STEP


def _drive_stairs(car: Car, log: TrafficLog) -> Traffic:
    """Drive the stairs of the steering at a constant speed, and back."""
    runner = CalibrationRunner(car)
    files = car.files
    last = STAIRS[-1]
    states = runner.hold(2.5, _command_pulse(files, last), STAIRS_SPEED)
    check_turning(states[-40:], 0.0, True)
    log.take()
    for k, command in enumerate((*STAIRS * STAIRS_ROUNDS, STAIRS[0])):
        large = abs(command - last) > LARGE_STEP
        duration = LARGE_STEP_DURATION if large else SMALL_STEP_DURATION
        runner.hold(duration + PHASE_SHIFTS[(k + k // 4) % 4], _command_pulse(files, command),
                    STAIRS_SPEED)
        last = command
    return log.take()


calibrate_latency = Procedure(
    name="latency",
    help="""Delays of the car: command to pulse, pulse to wheels, sensor to host.

    The car rests while the Nano times pulses (wire to its D8), then circles to the left with steps
    of throttle and steering. drive_speed uses the result. Measure clock, encoder and steering
    first.
    """,
    plan=plan, measure=measure,
    keys=("latency.pulse_to_wheel", "latency.pulse_to_yaw", "latency.sensor_to_host"),
    after=("clock", "esc", "encoder", "imu", "steering"))
