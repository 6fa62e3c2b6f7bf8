"""``calibrate throttle``: the pulse that keeps a speed, straight ahead.

1. The speed loop brings the car to one speed after the other.
2. The pulse is then constant, so that the unevenness of the ring has no effect.
3. The acceleration that remains is subtracted with the force of the paper's motor.
4. On a straight floor it then measures the brake (``brake``).

The car drives along a straight line as far as the floor allows. On a short floor it drives circles,
where the drag of the tyres is subtracted too. That makes the result less accurate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dart_hal.car import Car
from dart_hal.core.config import CarFiles, DriveTable, Quantity
from dart_hal.core.errors import CalibrationFailed, UsageError
from dart_hal.core.ports import Workshop
from dart_hal.core.types import INTERVAL_90, FloatArray, State
from dart_hal.vehicle.parameters import Body, PaperTyres
from dart_hal.vehicle.sets import PAPER
from dart_hal.vehicle.sizes import body_of

from . import brake
from .by_hand import check_wheels_by_hand, explain_standstill
from .clock import UNMEASURED_CLOCK_STD
from .measured import Measured
from .procedure import Bench, Option, Procedure, ProcedurePlan, Progress, scale_floor
from .runner import (
    CalibrationRunner,
    NoMotion,
    backward_error,
    driving,
    no_imu_error,
    yaw_rates,
)
from .sensor_log import SensorLog
from .spin import edge_distances
from .straight import LineKeeper, rest

# m/s, as many as the floor allows.
STRAIGHT_SPEEDS = (0.3, 0.5, 0.75, 1.0, 1.3, 1.6, 2.0, 2.5)
# m/s on a radius of 1 m: at most 1.2 m/s2 of lateral acceleration.
CIRCLE_TARGETS = (0.3, 0.5, 0.7, 0.9, 1.1)
# Steering command of the circle: 0.17 rad of road wheel by the paper's map, a radius of 1 m.
CIRCLE_COMMAND = 0.3
# m of straight floor: default, and the length below which a circle gives more.
DEFAULT_ROOM = 4.0
MIN_ROOM = 2.5
# m: a circle of 1 m radius, car and margin included.
CIRCLE_FLOOR = (3.5, 3.5)
# s at a new speed of a circle, also when it slows down: twice the integral time of 1 s.
CIRCLE_SETTLING = 2.5
THROTTLE_RUNS = 2
# s, and s per m/s, until a speed is reached.
ACCELERATION_TIME = (0.3, 0.35)
# s until the loop is steady.
LOOP_SETTLING = 0.8
# m (at least s) and at most s of a measurement on a straight line; s of one in a circle.
MEASURED_LENGTH = 0.8
MAX_MEASURED_TIME = 2.0
CIRCLE_MEASURED_TIME = 2.5
# m/s2 of coasting, at least; m of floor beyond it.
MIN_FRICTION = 1.05
FLOOR_MARGIN = 0.2
# m/s, and s at most, of the first drive, which shows the direction of the car.
FIRST_DRIVE_SPEED = 0.4
MAX_FIRST_DRIVE_TIME = 4.0
# m/s2 above which a constant pulse did not follow a steady speed: 25 us of pulse.
MAX_REMAINING_ACCELERATION = 0.8
# Share of the change of speed that the accelerometer has to measure: mount, tilt, filter.
MIN_INERTIAL_SHARE = 0.5
# Relative errors of the paper's motor (of the part subtracted for the acceleration) and of its
# tyres in a circle.
MOTOR_MODEL_STD = 0.1
# Power of the mass, over the paper's, with which the floor of a straight run grows: the speed loop
# overshoots with a heavier car. One of 1.98 times the mass needed 1.45 times the floor: power .54.
MASS_EXPONENT = 0.6
# us between two trials from which their accelerations show the slope of the motor: 0.2 m/s2 for the
# paper's car. With less, the errors of the accelerations decide.
MIN_PULSE_CHANGE = 4.0
# Ratio of that slope to the paper's, or the reverse, beyond which it is taken for an error.
MAX_SLOPE_RATIO = 5.0
TYRE_DRAG_STD = 0.3
# Frames of the steady loop whose mean is the constant pulse.
STEADY_FRAMES = 40
# s of a pulse that shows the correction it needs; edges of a measurement, at least.
TRIAL_TIME = 0.3
# s of a braking run, with the rest before it and the roll-out: its drive takes 3 s.
BRAKING_RUN_TIME = 6.0
MIN_MEASURED_EDGES = 8
# s until a pulse acts: two PWM frames, and the delay of the ESC.
PULSE_DELAY = 0.08

HoldSpeed = Callable[[float, float | None], list[State]]
"""(seconds, pulse [us] or None) -> States: holds the speed, or the pulse instead."""


@dataclass(frozen=True, slots=True)
class HeldSpeed:
    """Measurement at one target speed.

    speed [m/s]: mean; pulse_us: pulse without acceleration and turning; model_std_us: one sigma of
    what was subtracted for them.
    """

    target: float
    speed: float
    pulse_us: float
    model_std_us: float


def _acceleration_time(speed: float) -> float:
    """Time [s] until ``speed`` [m/s] is reached."""
    return ACCELERATION_TIME[0] + ACCELERATION_TIME[1] * speed


def floor_for(speed: float, mass: float = PAPER.body.mass) -> float:
    """Length of straight floor [m] for one speed [m/s], from rest to rest; mass [kg] of the car."""
    measured = min(max(MEASURED_LENGTH / speed, MEASURED_LENGTH), MAX_MEASURED_TIME)
    duration = (_acceleration_time(speed) + LOOP_SETTLING + TRIAL_TIME + 2.0 * PULSE_DELAY
                + measured)
    length = speed * duration + speed**2 / (2.0 * MIN_FRICTION) + FLOOR_MARGIN
    return length * _overshoot_ratio(mass)


def _overshoot_ratio(mass: float) -> float:
    """Return how many times the floor of the paper's car a car of this mass [kg] needs."""
    return float(max(mass / PAPER.body.mass, 1.0)**MASS_EXPONENT)


def select_speeds(room: float, files: CarFiles) -> tuple[float, ...]:
    """Speeds [m/s] that fit on a straight floor of length ``room`` [m]; () if fewer than two do.

    Raises UsageError if the car's ``max_speed`` leaves fewer than two.
    """
    mass = files.config.geometry.mass
    fitting = tuple(v for v in STRAIGHT_SPEEDS if floor_for(v, mass) <= room)
    if room < MIN_ROOM or len(fitting) < 2:
        return ()
    max_speed = files.config.limits.max_speed
    _check_max_speed(max_speed, STRAIGHT_SPEEDS[1])
    return tuple(v for v in fitting if v <= max_speed)


def _check_max_speed(max_speed: float, needed: float) -> None:
    """Raise UsageError if the car's limit is below the speed [m/s] that is needed."""
    if max_speed < needed:
        raise UsageError("the car may not drive as fast as this needs",
                         found=f"max_speed = {max_speed:g} under [limits] of car.toml",
                         expected=f"{needed:g} m/s or more",
                         remedy="raise it for the calibration")


def select_brake_speed(room: float, files: CarFiles) -> float:
    """Speed [m/s] from which the car brakes on a straight floor of length ``room`` [m].

    The floor is long enough for a car without a brake.
    """
    longer = _overshoot_ratio(files.config.geometry.mass)
    fastest = min(brake.MAX_START_SPEED, files.config.limits.max_speed)
    fitting = [v for v in STRAIGHT_SPEEDS if v <= fastest
               and longer * (v * (_acceleration_time(v) + LOOP_SETTLING + PULSE_DELAY)
                             + v**2 / (2.0 * MIN_FRICTION) + FLOOR_MARGIN) <= room]
    return fitting[-1]


def plan(files: CarFiles, room: float = DEFAULT_ROOM) -> ProcedurePlan:
    """Describe what ``measure`` does."""
    speeds = select_speeds(room, files)
    if not speeds:
        _check_max_speed(files.config.limits.max_speed, CIRCLE_TARGETS[-1])
        floor = scale_floor(CIRCLE_FLOOR, files)
        seconds = 2 * len(CIRCLE_TARGETS) * (CIRCLE_SETTLING + LOOP_SETTLING + TRIAL_TIME
                                             + CIRCLE_MEASURED_TIME) + 15.0
        return ProcedurePlan(
            f"circles at {CIRCLE_TARGETS[0]} to {CIRCLE_TARGETS[-1]} m/s to measure the pulse "
            f"that keeps each speed: about {seconds:.0f} s, a level floor of "
            f"{floor[0]:g} m x {floor[1]:g} m; no tools", seconds, floor)
    braking = len(brake.choose_parts(files))
    seconds = (THROTTLE_RUNS * sum(floor_for(v) / v + 3.0 for v in speeds) + 10.0
               + braking * BRAKING_RUN_TIME)
    return ProcedurePlan(
        f"drives straight {THROTTLE_RUNS * len(speeds)} times at {speeds[0]} to {speeds[-1]} m/s "
        f"to measure the pulse that keeps each speed, brakes {braking} times from "
        f"{select_brake_speed(room, files)} m/s: about {seconds:.0f} s without carrying it "
        f"back, a level floor of {room:.1f} m x 1 m; chalk for the start", seconds, (room, 1.0))


def measure(bench: Bench, room: float = DEFAULT_ROOM) -> Measured:
    """Measure the pulse of each speed on ``room`` [m] of straight floor; in circles below 2.5 m.

    Raises CalibrationFailed (with the likely cause), LinkLost, NotArmed.
    """
    car = bench.car
    files = bench.files
    speeds = select_speeds(room, files)
    workshop = bench.workshop
    progress = bench.progress
    log = SensorLog(car)
    start = next(iter(car.states())).t
    try:
        progress(0.0, "pushing the car by hand")
        check_wheels_by_hand(car, workshop)
        with explain_standstill(car, workshop):
            progress(0.05, "checking the direction")
            _check_direction(car)
            if speeds:
                held = _drive_straight(car, workshop, log, room, progress)
                found, note = _brake_straight(car, workshop, log, room, progress)
            else:
                held = _drive_circles(car, log, progress)
                found, note = None, f"the brake needs {MIN_ROOM:g} m of straight floor"
    finally:
        car.stop()
    table, residual = make_table(held, files)
    where = f"{room:.1f} m straight" if speeds else "circles of 1 m"
    return Measured(
        files.config.name, bench.source, "throttle",
        {"throttle.brake": found} if found else {}, residual,
        next(iter(car.states())).t - start,
        (f"measured with the present charge of the battery and on this floor, {where}",
         f"90 % interval of a pulse: at most +- {INTERVAL_90 * max(table.std_us):.2f} us", note),
        others={"throttle.drive": table})


# -- driving -----------------------------------------------------------------------


def _check_direction(car: Car) -> None:
    """Drive for a moment and compare wheels and accelerometer.

    Raises CalibrationFailed if the car goes backward or stays where it is.
    """
    center = car.files.config.steering.center_us
    with driving(car) as runner:
        still = [s for s in runner.hold(0.3, center, 0.0) if s.accel_x is not None]
        if not still:
            raise no_imu_error("no acceleration in 0.3 s")
        offset = float(np.mean([s.accel_x or 0.0 for s in still]))
        inertial = 0.0
        states = still[-1:]
        while (states[-1].t - states[0].t < MAX_FIRST_DRIVE_TIME
               and abs(states[-1].speed) < FIRST_DRIVE_SPEED):
            states += runner.hold(0.0, center, FIRST_DRIVE_SPEED)
            # Speed by the accelerometer [m/s], at 100 frames per second.
            inertial += 0.01 * ((states[-1].accel_x or 0.0) - offset)
        if states[-1].ticks == states[0].ticks:
            raise NoMotion("the car does not move", found="0 edges with throttle",
                           expected="motion")
    speed = abs(states[-1].speed)
    if inertial < -MIN_INERTIAL_SHARE * speed:
        raise backward_error(f"{inertial:+.2f} m/s by the accelerometer, wheels at {speed:.2f} m/s")
    if inertial < MIN_INERTIAL_SHARE * speed:
        raise CalibrationFailed(
            "the wheels turn but the car does not move",
            found=f"{inertial:+.2f} m/s by the accelerometer, wheels at {speed:.2f} m/s",
            expected=f"at least {MIN_INERTIAL_SHARE * speed:.2f} m/s",
            likely="the wheels are off the ground or spin, or the accelerometer is stuck",
            remedy="put the car on the floor; dart-hal doctor")


def _drive_straight(car: Car, workshop: Workshop, log: SensorLog, room: float,
                    progress: Progress) -> list[HeldSpeed]:
    held = []
    runs = [v for v in select_speeds(room, car.files) for _ in range(THROTTLE_RUNS)]
    for k, speed in enumerate(runs):
        progress(0.1 + 0.8 * k / len(runs), f"{speed} m/s, run {k + 1} of {len(runs)}")
        with _driving_straight(car, workshop, speed) as hold:
            held.append(_measure_speed(hold, log, speed, car.files, min(
                max(MEASURED_LENGTH / speed, MEASURED_LENGTH), MAX_MEASURED_TIME)))
    return held


def _brake_straight(car: Car, workshop: Workshop, log: SensorLog, room: float,
                    progress: Progress) -> tuple[Quantity | None, str]:
    """Drive at one speed and brake, several times; see ``brake``."""
    speed = select_brake_speed(room, car.files)
    parts = brake.choose_parts(car.files)
    if not parts:
        return None, "no brake is measured: [limits] min_throttle is 0"
    found = []
    for k, part in enumerate(parts):
        progress(0.9 + 0.1 * k / len(parts), f"braking, run {k + 1} of {len(parts)}")
        with _driving_straight(car, workshop, speed) as hold:
            hold(LOOP_SETTLING, None)
            # The pulses of the speeds are kept if the brake cannot be measured.
            try:
                found.append(brake.brake(hold, log, car.files, part))
            except brake.TooFewEdges as failed:
                return None, f"caution: the brake is not measured: {failed.what}; {failed.likely}"
    return brake.fit_brake(parts, found, car.files)


@contextmanager
def _driving_straight(car: Car, workshop: Workshop, speed: float) -> Iterator[HoldSpeed]:
    """Accelerate from the mark to a speed [m/s]; give what holds it. The car stops at the end."""
    workshop.mark()
    with driving(car) as runner:
        here = rest(runner, car.files.config.steering.center_us)
        hold = _hold_on_line(runner, LineKeeper(car.files, here.pose), speed, here)
        hold(_acceleration_time(speed), None)
        yield hold


def _hold_on_line(runner: CalibrationRunner, line: LineKeeper, speed: float, here: State
                  ) -> HoldSpeed:
    """Make the function that holds a speed [m/s] along the line."""
    def hold(seconds: float, pulse_us: float | None) -> list[State]:
        nonlocal here
        states: list[State] = []
        while not states or here.t - states[0].t < seconds:
            here = runner.hold(0.0, line.pulse(here), speed, pulse_us)[-1]
            states.append(here)
        return states

    return hold


def _drive_circles(car: Car, log: SensorLog, progress: Progress) -> list[HeldSpeed]:
    steering = car.files.config.steering
    pulse = steering.center_us + steering.direction * CIRCLE_COMMAND * steering.span_us
    held = []
    order = [*CIRCLE_TARGETS, *CIRCLE_TARGETS[::-1]]
    with driving(car) as runner:
        runner.start_moving(pulse, CIRCLE_TARGETS[0], 0.0, True)
        for k, speed in enumerate(order):
            progress(0.1 + 0.9 * k / len(order), f"{speed} m/s in a circle")
            runner.hold(CIRCLE_SETTLING, pulse, speed)
            held.append(_measure_speed(_hold_in_circle(runner, pulse, speed), log, speed,
                                       car.files, CIRCLE_MEASURED_TIME))
    return held


def _hold_in_circle(runner: CalibrationRunner, steering_us: float, speed: float) -> HoldSpeed:
    """Make the function that holds a speed [m/s] in a circle."""
    return lambda seconds, pulse_us: runner.hold(seconds, steering_us, speed, pulse_us)


def _measure_speed(hold: HoldSpeed, log: SensorLog, target: float, files: CarFiles,
                   seconds: float) -> HeldSpeed:
    """Measure the pulse at one speed.

    1. Average the pulse of the steady loop, and hold it for a moment.
    2. Correct it by the acceleration that it caused, by the slope of the paper's motor.
    3. Hold the corrected pulse for ``seconds``, and correct once more: by the slope that the two
       pulses show, if they differ enough, for the motor and mass of this car may be others.
    4. Subtract what the tyres take in a turn.
    """
    body = body_of(files.config.geometry)
    states = hold(LOOP_SETTLING, None)[-STEADY_FRAMES:]
    pulse = float(np.mean([s.applied.throttle_us for s in states]))
    motor = PAPER.duty_motor
    tried: list[tuple[float, float]] = []  # pulse [us], acceleration [m/s2]
    for duration in (TRIAL_TIME, seconds):
        constant = pulse
        hold(PULSE_DELAY, constant)
        log.pairs()
        states = hold(duration, constant)
        speed, acceleration = _fit_motion(log, target, duration, files)
        slope = (motor.d - motor.e * speed) / (files.config.throttle.span_us * body.mass)
        tried.append((constant, acceleration))
        if len(tried) > 1:
            slope = _measure_slope(tried, slope)
        correction = acceleration / slope
        pulse = constant - correction
    rate = float(np.mean(yaw_rates(states) or [0.0]))
    turning = _tyre_drag(speed, rate, body) / (slope * body.mass)
    return HeldSpeed(target, speed, pulse - turning,
                     math.hypot(MOTOR_MODEL_STD * correction, TYRE_DRAG_STD * turning))


def _measure_slope(tried: Sequence[tuple[float, float]], expected: float) -> float:
    """Return the acceleration per pulse [m/s2/us] by two trials, or the expected one.

    The latter if the pulses hardly differ, or the result is not that of a motor.
    """
    (first, before), (second, after) = tried
    if abs(second - first) < MIN_PULSE_CHANGE:
        return expected
    slope = (after - before) / (second - first)
    return slope if 1.0 / MAX_SLOPE_RATIO < slope / expected < MAX_SLOPE_RATIO else expected


def _fit_motion(log: SensorLog, target: float, seconds: float, files: CarFiles
                ) -> tuple[float, float]:
    """(mean speed [m/s], acceleration [m/s2]) since the last call, by a parabola through the edges.

    Raises NoMotion if the car is much slower than ``target`` [m/s], CalibrationFailed if its speed
    is not constant.
    """
    t, x = edge_distances(log.pairs(), files.metres_per_edge.value)
    if len(t) < MIN_MEASURED_EDGES or x[-1] < 0.5 * target * seconds:
        raise NoMotion(f"the car does not reach {target} m/s",
                       found=f"{x[-1] if len(x) else 0.0:.2f} m in {seconds:.1f} s",
                       expected=f"{target * seconds:.2f} m",
                       likely="battery low, an obstacle, or a loose wire",
                       remedy="charge the battery; dart-hal doctor")
    acceleration, speed, _ = np.polyfit(t - t.mean(), x, 2) * (2.0, 1.0, 1.0)
    if abs(acceleration) > MAX_REMAINING_ACCELERATION:
        raise CalibrationFailed(f"the car does not keep {target} m/s at a constant pulse",
                                found=f"{acceleration:+.2f} m/s2 at {speed:.2f} m/s",
                                expected=f"at most {MAX_REMAINING_ACCELERATION} m/s2",
                                likely="the floor slopes, a wheel spins, or edges are lost",
                                remedy="a level floor with grip; dart-hal doctor")
    return float(speed), float(acceleration)


def _tyre_drag(speed: float, rate: float, body: Body) -> float:
    """Force [N] that a steady turn takes from the motor, by the paper's tyres.

    Its parts are the component of the front tyres' side force along the car, and the slip of the
    body. speed [m/s], rate [rad/s].
    """
    tyres = PAPER.tyres
    assert isinstance(tyres, PaperTyres)
    lateral = speed * rate
    front, rear = (body.mass * lateral * arm / body.wheelbase for arm in (body.l_r, body.l_f))
    v_y = body.l_r * rate - speed * rear / tyres.rear_cornering_stiffness
    return front * body.wheelbase * rate / speed - body.mass * rate * v_y


# -- the table -----------------------------------------------------------------------


def make_table(held: Sequence[HeldSpeed], files: CarFiles) -> tuple[DriveTable, str]:
    """Average the runs at each speed; return the table and a sentence on how well they repeat.

    Raises CalibrationFailed if a higher speed needed a shorter pulse.
    """
    targets = sorted({h.target for h in held})
    groups = [[h for h in held if h.target == v] for v in targets]
    speed = np.array([np.mean([h.speed for h in g]) for g in groups])
    pulse = np.array([np.mean([h.pulse_us for h in g]) for g in groups])
    if not (np.all(np.diff(pulse) > 0.0) and np.all(np.diff(speed) > 0.0)):
        raise CalibrationFailed(
            "a higher speed needed a shorter pulse",
            found=", ".join(f"{v:.2f} m/s {p:.1f} us" for v, p in zip(speed, pulse, strict=True)),
            expected="pulses that increase with the speed",
            likely="a sloping floor, or a battery that recovered between two runs",
            remedy="a level floor, a charged battery; run it again")
    slope = np.gradient(pulse, speed)
    deviation = np.concatenate([
        [h.pulse_us - p - s * (h.speed - v) for h in g]
        for g, v, p, s in zip(groups, speed, pulse, slope, strict=True)])
    freedom = max(len(deviation) - len(groups), 1)
    spread = math.sqrt(float(deviation @ deviation) / freedom / THROTTLE_RUNS)
    model_std = np.array([np.mean([h.model_std_us for h in g]) for g in groups])
    return _table_with_errors(speed, pulse, slope, spread, model_std, files), (
        f"runs at the same speed differ by at most {float(np.max(np.abs(deviation))):.2f} us "
        "from their mean")


def _table_with_errors(speed: FloatArray, pulse: FloatArray, slope: FloatArray, spread: float,
                       model_std: FloatArray, files: CarFiles) -> DriveTable:
    """Add the errors of the clock, of the travel per edge and of the model."""
    clock = files.oscillator_hz
    metres = files.metres_per_edge
    rate = clock.std / clock.value if clock else UNMEASURED_CLOCK_STD
    std = np.sqrt(spread**2 + model_std**2 + (rate * pulse) ** 2
                  + (slope * speed * metres.std / metres.value) ** 2)
    return DriveTable(speed=tuple(round(float(v), 4) for v in speed),
                      pulse_us=tuple(round(float(p), 3) for p in pulse),
                      std_us=tuple(round(float(s), 3) for s in std))


def _plot(result: Measured, files: CarFiles, path: Path) -> None:
    from .plot import plot_throttle

    plot_throttle(result, files, path)


calibrate_throttle = Procedure(
    name="throttle",
    help="""The pulse that keeps each speed, for the feed-forward of drive_speed.

    The car drives from rest to rest at one speed after the other; you put it back
    to the start. Measure esc and encoder first.
    """,
    plan=plan, measure=measure, adapt=lambda floor: {"room": min(DEFAULT_ROOM, max(floor))},
    options=(Option("room", "straight floor; more of it allows higher speeds, below 2.5 m the "
                    "car circles on 3.5 m x 3.5 m", DEFAULT_ROOM, "m", 0.0, 30.0,
                    metavar="METRES"),),
    plot=_plot, plot_help="the measured pulses and those of the model",
    keys=("throttle.drive",), after=("clock", "esc", "encoder"))
