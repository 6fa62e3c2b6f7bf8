"""``calibrate imu``: bias, scale and mounting of the gyro, on a car that can drive.

The car is at rest for the bias. It drives full turns to the left and to the right, and the operator
enters the angle. Straight accelerations give the mounting yaw. ``imu_fit`` does the fit.
"""

from __future__ import annotations

import math

from dart_hal.car import Car
from dart_hal.core.config import CarFiles, Quantity
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import State

from .by_hand import explain_standstill
from .imu_fit import (
    GyroRest,
    MeasuredTurn,
    fit_axis,
    fit_mount_yaw,
    graph_pulls,
    measure_rest,
    yaw_bias,
)
from .measured import Measured, list_outdated
from .procedure import Bench, Option, Procedure, ProcedurePlan, scale_floor
from .runner import CalibrationRunner, driving, no_imu_error
from .sensor_log import ImuSamples, SensorLog
from .steering import estimate_bias
from .straight import rest, roll

# s: the gyro's noise of 2.5e-4 rad/s/sqrt(Hz) leaves 8e-5 rad/s.
REST_TIME = 10.0
# Turns to each side, and m/s: 0.5 deg of 1080 are 0.05 %.
DEFAULT_TURNS = 3
TURN_SPEED = 0.35
# Steering command of the turns: less than the end of the servo.
TURN_COMMAND = 0.9
# Straight accelerations, m and m/s: +-1 m/s2 for half a second each.
PULLS = 3
PULL_DISTANCE = 1.5
PULL_SPEED = 0.8
# s without a sample of the IMU, twenty of them; the integral over a turn would miss them.
MAX_IMU_AGE = 0.2
# Relative change of the gyro scale that outdates a steering map: 0.07 deg of 0.4 rad.
MAX_SCALE_CHANGE = 0.003
# m: an acceleration and its distance to stop; two circles at full lock side by side.
IMU_FLOOR = (3.0, 2.5)
# s for one turn; at 0.35 m/s it takes 9 s at full lock.
MAX_TURN_TIME = 40.0


def plan(files: CarFiles, turns: int = DEFAULT_TURNS) -> ProcedurePlan:
    """Describe what ``measure`` does."""
    seconds = REST_TIME + 2 * (turns * 9.0 + 8.0) + PULLS * 10.0
    floor = scale_floor(IMU_FLOOR, files)
    return ProcedurePlan(
        f"rests for {REST_TIME:.0f} s, circles {turns} times to the left and {turns} times to "
        f"the right, then accelerates straight {PULLS} times, each from the start, to measure "
        f"bias, scale and mounting of the gyro: about {seconds:.0f} s without carrying it back, a "
        f"level floor of {floor[0]:g} m x {floor[1]:g} m, chalk and a protractor (or a line to "
        "return to)", seconds, floor)


def measure(bench: Bench, turns: int = DEFAULT_TURNS) -> Measured:
    """Measure gyro bias, scale and mounting; the operator enters the angles of the turns.

    Raises CalibrationFailed (with the likely cause), LinkLost, NotArmed.
    """
    car = bench.car
    files = bench.files
    workshop = bench.workshop
    progress = bench.progress
    log = SensorLog(car)
    progress(0.0, "at rest")
    still = _measure_rest(car, log)
    done: list[MeasuredTurn] = []
    for k, left in enumerate((True, False)):
        progress(0.1 + 0.35 * k, f"{turns} turns to the {'left' if left else 'right'}")
        workshop.mark()
        with explain_standstill(car, workshop):
            samples = _drive_turns(car, log, turns, left)
        done.append(MeasuredTurn(samples, workshop.turns()))
    mounting = fit_axis(done, still)
    pulls = []
    for k in range(PULLS):
        progress(0.8 + 0.2 * k / PULLS, f"straight acceleration {k + 1} of {PULLS}")
        workshop.mark()
        with explain_standstill(car, workshop):
            pulls.append(_drive_pull(car, log))
    bias = yaw_bias(still, mounting.axis)
    yaw = fit_mount_yaw(pulls, mounting, bias.value, files.config.imu.x)
    cal = files.calibration
    old = cal.imu.gyro_scale.value if cal and cal.imu.gyro_scale else 1.0
    method = f"{len(done)} x {turns} turns"
    found = {"gyro_bias": (bias, f"standstill of {REST_TIME:.0f} s"),
             "gyro_scale": (mounting.scale, method),
             "mount_yaw": (yaw, f"{PULLS} straight accelerations"),
             "mount_pitch": (mounting.pitch, method), "mount_roll": (mounting.roll, method)}
    return Measured(
        files.config.name, bench.source, "imu",
        {f"imu.{name}": Quantity(e.value, e.std, how) for name, (e, how) in found.items()},
        f"each turn agrees with the common scale within {100 * mounting.max_difference:.2f} %",
        sum(s.duration for s in (*(t.samples for t in done), *pulls)) + REST_TIME,
        ("the bias changes with temperature; at rest the car estimates it again",
         *list_outdated(files, abs(mounting.scale.value / old - 1.0) > MAX_SCALE_CHANGE,
                       f"a gyro scale of {old:.4f}", "steering")),
        graph=graph_pulls(pulls, mounting, bias.value, files.config.imu.x, yaw))


def _measure_rest(car: Car, log: SensorLog) -> GyroRest:
    log.take()
    estimate_bias(list(car.states(duration=REST_TIME)))  # raises if the car is not at rest
    return measure_rest(take_samples(log))


def _drive_turns(car: Car, log: SensorLog, turns: int, left: bool) -> ImuSamples:
    """Drive turns from rest to rest."""
    steering = car.files.config.steering
    offset = TURN_COMMAND * steering.span_us * steering.direction
    pulse = steering.center_us + (offset if left else -offset)
    with driving(car) as runner:
        first = rest(runner, pulse)
        log.take()
        states = runner.start_moving(pulse, TURN_SPEED, 0.0, left)
        _hold_until_turned(runner, pulse, first, states[-1], turns)
        rest(runner, pulse)
        return take_samples(log)


def _hold_until_turned(runner: CalibrationRunner, pulse: float, first: State, state: State,
                       turns: int) -> None:
    """Hold the circle until the heading has changed by the turns.

    Raises CalibrationFailed if that takes too long, or samples of the IMU are missing.
    """
    limit = state.t + MAX_TURN_TIME * turns
    while abs(state.pose.yaw - first.pose.yaw) < 2.0 * math.pi * turns:
        state = runner.hold(0.0, pulse, TURN_SPEED)[-1]
        if state.health.imu_age > MAX_IMU_AGE:
            raise no_imu_error(f"the latest sample is {state.health.imu_age:.1f} s old")
        if state.t > limit:
            raise CalibrationFailed(
                "the circle does not close",
                found=f"{math.degrees(state.pose.yaw - first.pose.yaw):+.0f} deg in "
                      f"{MAX_TURN_TIME * turns:.0f} s", expected=f"{360 * turns} deg",
                likely="the servo does not reach its lock, or the gyro dropped out",
                remedy="dart-hal doctor")


def _drive_pull(car: Car, log: SensorLog) -> ImuSamples:
    """Accelerate straight ahead and coast to rest."""
    with driving(car) as runner:
        log.take()
        roll(runner, car.files, PULL_DISTANCE, PULL_SPEED)
        return take_samples(log)


def take_samples(log: SensorLog) -> ImuSamples:
    """Take the samples since the last call. Raises CalibrationFailed for almost none."""
    samples = log.take()
    if samples is None:
        raise no_imu_error("almost no samples")
    return samples


calibrate_imu = Procedure(
    name="imu",
    help="""Bias and scale of the gyro, and mounting angles of the IMU.

    The car rests, circles to both sides and accelerates straight ahead; you chalk its heading and
    type the degrees it has turned. Measure the encoder first.
    """,
    plan=plan, measure=measure,
    options=(Option("turns", "full turns to each side; twice the number halves the error",
                    DEFAULT_TURNS, "", 1, 10),),
    keys=("imu.gyro_scale", "imu.mount_yaw"), after=("clock", "encoder"))
