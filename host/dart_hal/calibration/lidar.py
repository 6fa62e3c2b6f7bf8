"""``calibrate lidar``: how the lidar sits on the car, and how true its distances are.

Slow and fast full circles to the left and to the right, in a room of which there is a map.
``lidar_fit`` makes numbers of what wheels, gyro and scans told. Scans that turn against the gyro
are named first: nothing else that they say would be right.
"""

from __future__ import annotations

import math

from dart_hal.core.config import CarFiles, Quantity
from dart_hal.core.errors import CalibrationFailed, UsageError
from dart_hal.core.types import Estimate, Scan, State
from dart_hal.estimation.localisation.field import Map

from .lidar_fit import ANY_GYRO, Drive, Sits, fit_lidar, sense_of
from .measured import Measured
from .mocap import SPEEDS, drive
from .procedure import Bench, Procedure, ProcedurePlan
from .runner import driving

LEGS = [(speed, left) for left in (True, False) for speed in (*SPEEDS, *reversed(SPEEDS))]
"""One change of side, and slowly: each carries the car on, and rooms are small."""
LOCK = 1.0
"""Steering of the circles, 1 = full: the smallest that a car drives, 0.5 m of radius."""
FLOOR = (3.0, 2.0)
"""m: two circles of 0.5 m radius beside each other, the car beyond them, and what it moves on."""
WAIT = 3.0
"""s in which a lidar that is there has told something: its motor takes 1 to 2 s to its pace."""
MIRRORED = 0.0
"""Sense of the scans against the gyro, 1 right, -1 mirrored, below which they are mirrored."""
WITHIN = {"x": 0.05, "y": 0.05, "yaw": math.radians(15.0), "scale": 0.05}
"""m, m, rad, share by which what is measured may differ from car.toml: more is another lidar, or
one that was screwed on the other way round, and somebody should look at it."""
KEYS = {"x": "mount_x", "y": "mount_y", "yaw": "mount_yaw", "scale": "scale"}


def plan(files: CarFiles) -> ProcedurePlan:
    """Say what ``measure`` will do."""
    return ProcedurePlan(
        f"circles at {SPEEDS[0]} and {SPEEDS[1]} m/s to the left and to the right, "
        "twice each, to measure how the lidar sits on the car and how true its distances are: "
        f"about 55 s, a floor of {FLOOR[0]:g} m x {FLOOR[1]:g} m in a room of which there is a "
        "map, no tools", 55.0, FLOOR)


def measure(bench: Bench) -> Measured:
    """Measure mount [m, m, rad] and scale in the room of ``bench.chart``.

    Errors: CalibrationFailed (with the likely cause), NoScan, LinkLost, NotArmed.
    """
    car = bench.car
    files = bench.files
    chart = bench.chart
    if chart is None:
        raise UsageError("the lidar is measured in a map", found="none", expected="a chart",
                         remedy="calibrate_lidar(car, chart=MAP), or --map room.yaml")
    if not car.has_lidar:
        raise _no_scans(False)
    states: list[State] = []
    scans: list[Scan] = []

    def watch(some: list[State]) -> None:
        states.extend(some)
        scans.extend(car.lidar.scans())

    watch(list(car.states(duration=WAIT)))
    if not scans:
        raise car.lidar.trouble or _no_scans(True)
    with driving(car) as runner:
        drive(runner, files, bench.progress, watch, LEGS, LOCK, whole=True)
    sits = found_by(Drive(states, scans), chart, _gyro_std(files))
    method = f"{sits.scans} scans in a map"
    found = {f"lidar.{KEYS[name]}": Quantity(e.value, e.std, method)
             for name, e in sits.found.items()}
    return Measured(files.config.name, bench.source, "lidar", found,
                    f"lidar and dead reckoning differ by {1e3 * sits.rms:.1f} mm rms, the map "
                    f"explains {100.0 * sits.agreement:.0f} % of the beams",
                    states[-1].t - states[0].t,
                    ("the scale is that of the map: a map drawn 1 % too large makes it 1 % too "
                     "large",))


def _gyro_std(files: CarFiles) -> float:
    """Relative standard error of the gyro's scale, by the car's files or of any BNO055."""
    imu = files.calibration.imu if files.calibration else None
    scale = imu.gyro_scale if imu else None
    return scale.std / scale.value if scale else ANY_GYRO


def found_by(told: Drive, chart: Map, gyro_std: float = ANY_GYRO) -> Sits:
    """Errors: CalibrationFailed for scans that turn the wrong way, are of another room, and for a
    lidar that sits quite otherwise than car.toml says."""
    sense, mount = sense_of(told), told.scans[0].mount
    if sense is not None and sense < MIRRORED:
        raise _mirrored(mount.inverted, sense)
    sits = fit_lidar(told, chart, gyro_std)
    for name, limit in WITHIN.items():
        was, now = getattr(mount, name), sits.found[name]
        if abs(now.value - was) > limit:
            raise _otherwise(name, was, now)
    return sits


def _no_scans(named: bool) -> CalibrationFailed:
    return CalibrationFailed(
        "no scans", found=f"none within {WAIT:.0f} s", expected="a lidar that turns",
        likely="it has no 5 V, or its motor stands" if named else "no lidar is named",
        remedy="dart-hal doctor" if named else
        "--lidar serial:///dev/dart-lidar, $DART_HAL_LIDAR, or sim://?lidar=1&map=room")


def _mirrored(inverted: bool, sense: float) -> CalibrationFailed:
    sits = "upside down" if inverted else "upright"
    return CalibrationFailed(
        "the scans turn against the gyro", found=f"{sense:+.2f} times the car's turns",
        expected="+1 times: both turn to the left together",
        likely=f"the lidar is mounted {sits}, or its rotation is told the other way round than "
               f"inverted = {str(inverted).lower()} under [lidar] in car.toml says",
        remedy=f"inverted = {str(not inverted).lower()} under [lidar] in car.toml")


def _otherwise(name: str, was: float, now: Estimate) -> CalibrationFailed:
    unit = {"yaw": " rad", "scale": ""}.get(name, " m")
    key = {"x": "lidar_x under [geometry]", "y": "y under [lidar]",
           "yaw": "mount_yaw under [lidar]", "scale": "scale under [lidar]"}[name]
    return CalibrationFailed(
        f"the lidar does not sit as car.toml says: {name}", found=f"{now.value:.3f}{unit}",
        expected=f"{was:.3f}{unit}, within {WITHIN[name]:.2f}",
        likely="it was screwed on the other way round, or car.toml is of another car; scale: the "
               "map's metres are none",
        remedy=f"{key} = {now.value:.3f} in car.toml, then run it again")


calibrate_lidar = Procedure(
    name="lidar",
    help="""How the lidar sits on the car, and how true its distances are.

    Slow and fast circles to both sides, about a minute, in a room of which there is a map. A lidar
    that is upside down or turns the other way than car.toml says, and a map of another room are
    named. Measure encoder and imu first.
    """,
    plan=plan, measure=measure, lidar=True, keys=tuple(f"lidar.{n}" for n in KEYS.values()),
    after=("clock", "encoder", "imu"))
