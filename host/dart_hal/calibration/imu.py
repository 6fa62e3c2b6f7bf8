"""``calibrate imu``: bias, scale and mounting of the gyro, on a car that can drive.

Standstill for the bias; full turns to the left and to the right, of which
somebody says by how much the car has turned; straight pulls for the mounting
about the vertical. ``imu_fit`` makes numbers of them.
"""

from __future__ import annotations

import math

from dart_hal.car import Car
from dart_hal.core.config import CarFiles, Quantity
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import State

from .by_hand import naming
from .imu_fit import Still, Turn, axis_of, bias_of, still_of, yaw_of
from .measured import Measured, map_outdated
from .procedure import Bench, Option, Procedure, ProcedurePlan
from .runner import Runner, driving
from .sensor_log import Sensed, SensorLog
from .steering import standing_bias
from .straight import rest, roll

STANDING = 10.0
"""s: the gyro's noise of 2.5e-4 rad/s/sqrt(Hz) leaves 8e-5 rad/s."""
TURNS, TURNING = 3, 0.35
"""Turns each way, m/s: 0.5 deg of 1080 are 0.05 %."""
LOCK = 0.9
"""Of the steering command: short of the servo's end."""
PULLS, PULL, PULLING = 3, 1.5, 0.8
"""Straight pulls, m and m/s: 1 m/s2 up and down for half a second each."""
SILENT = 0.2
"""s without a sample of the IMU, twenty of them; the integral over a turn would miss them."""
CHANGED = 0.003
"""Relative; of the largest angle of a steering map, 0.4 rad, 0.07 deg."""
FLOOR = (3.0, 2.5)
"""m: a pull and its way to stop; two circles at full lock beside each other."""
LONGEST_TURN = 40.0
"""s for one turn; at walking pace it takes 9 s at full lock."""


def plan(files: CarFiles, turns: int = TURNS) -> ProcedurePlan:
    """Say what ``measure`` will do."""
    seconds = STANDING + 2 * (turns * 9.0 + 8.0) + PULLS * 10.0
    return ProcedurePlan(
        f"stands {STANDING:.0f} s, circles {turns} times to the left and {turns} times to "
        f"the right, then pulls away straight {PULLS} times, to measure bias, scale and "
        f"mounting of the gyro: about {seconds:.0f} s, a level floor of {FLOOR[0]:g} m x "
        f"{FLOOR[1]:g} m, chalk and a protractor (or a line to come back to)", seconds, FLOOR)


def measure(bench: Bench, turns: int = TURNS) -> Measured:
    """Measure gyro bias, scale and mounting; the workshop answers by how much the car has turned.

    Errors: CalibrationFailed (with the likely cause), LinkLost, NotArmed.
    """
    car = bench.car
    files = bench.files
    workshop = bench.workshop
    progress = bench.progress
    log = SensorLog(car)
    progress(0.0, "standing still")
    still = _still(car, log)
    done: list[Turn] = []
    for k, left in enumerate((True, False)):
        progress(0.1 + 0.35 * k, f"{turns} turns to the {'left' if left else 'right'}")
        workshop.mark()
        with naming(car, workshop):
            sensed = _turn(car, log, turns, left)
        done.append(Turn(sensed, workshop.turns()))
    tilted = axis_of(done, still)
    pulls = []
    for k in range(PULLS):
        progress(0.8 + 0.2 * k / PULLS, f"straight pull {k + 1} of {PULLS}")
        with naming(car, workshop):
            pulls.append(_pull(car, log))
    bias = bias_of(still, tilted.axis)
    yaw = yaw_of(pulls, tilted, bias.value, files.config.imu.x)
    cal = files.calibration
    old = cal.imu.gyro_scale.value if cal and cal.imu.gyro_scale else 1.0
    turned = f"{len(done)} x {turns} turns"
    found = {"gyro_bias": (bias, f"standstill of {STANDING:.0f} s"),
             "gyro_scale": (tilted.scale, turned), "mount_yaw": (yaw, f"{PULLS} straight pulls"),
             "mount_pitch": (tilted.pitch, turned), "mount_roll": (tilted.roll, turned)}
    return Measured(
        files.config.name, bench.source, "imu",
        {f"imu.{name}": Quantity(e.value, e.std, how) for name, (e, how) in found.items()},
        f"turns differ from the common scale by {100 * tilted.differs:.2f} % at most",
        sum(s.duration for s in (*(t.sensed for t in done), *pulls)) + STANDING,
        ("the bias changes with temperature; while the car stands it is learnt anew",
         *map_outdated(files, abs(tilted.scale.value / old - 1.0) > CHANGED,
                       f"a gyro scale of {old:.4f}")))


def _still(car: Car, log: SensorLog) -> Still:
    log.take()
    standing_bias(list(car.states(duration=STANDING)))
    return still_of(_sensed(log))


def _turn(car: Car, log: SensorLog, turns: int, left: bool) -> Sensed:
    steering = car.files.config.steering
    side = LOCK * steering.span_us * steering.direction
    pulse = steering.center_us + (side if left else -side)
    with driving(car) as runner:
        first = rest(runner, pulse)
        log.take()
        seen = runner.start_moving(pulse, TURNING, 0.0, left)
        _until_turned(runner, pulse, first, seen[-1], turns)
        rest(runner, pulse)
        return _sensed(log)


def _until_turned(runner: Runner, pulse: float, first: State, state: State, turns: int) -> None:
    limit = state.t + LONGEST_TURN * turns
    while abs(state.pose.yaw - first.pose.yaw) < 2.0 * math.pi * turns:
        state = runner.hold(0.0, pulse, TURNING)[-1]
        if state.health.imu_age > SILENT:
            raise _silent(f"the last is {state.health.imu_age:.1f} s old")
        if state.t > limit:
            raise CalibrationFailed(
                "the circle does not close",
                found=f"{math.degrees(state.pose.yaw - first.pose.yaw):+.0f} deg in "
                      f"{LONGEST_TURN * turns:.0f} s", expected=f"{360 * turns} deg",
                likely="the servo does not reach its lock, or the gyro dropped out",
                remedy="dart-hal doctor")


def _pull(car: Car, log: SensorLog) -> Sensed:
    with driving(car) as runner:
        log.take()
        roll(runner, car.files, PULL, PULLING)
        return _sensed(log)


def _sensed(log: SensorLog) -> Sensed:
    sensed = log.take()
    if sensed is None:
        raise _silent("next to no samples")
    return sensed


def _silent(found: str) -> CalibrationFailed:
    return CalibrationFailed("no data of the IMU", found=found, expected="100 samples per second",
                             likely="IMU unplugged, or reset by a voltage drop",
                             remedy="dart-hal doctor")


calibrate_imu = Procedure(
    name="imu",
    help="""Bias and scale of the gyro, and how the IMU sits in the car.

    The car stands, circles to the left and to the right, and pulls away
    straight; you chalk its heading and type by how many degrees it has turned.
    Measure the encoder first.
    """,
    plan=plan, measure=measure,
    options=(Option("turns", "full turns each way; twice as many are twice as exact", TURNS, "",
                    1, 10),),
    keys=("imu.gyro_scale", "imu.mount_yaw"), after=("clock", "encoder"))
