"""``calibrate lidar``: mounting pose and scale of the lidar.

The car drives slow and fast full circles to the left and to the right in a room with a known map;
``lidar_fit`` does the fit. Scans that turn against the gyro are refused first, because every other
result would be wrong.
"""

from __future__ import annotations

import math

from dart_hal.core.config import CarFiles, Quantity
from dart_hal.core.errors import CalibrationFailed, UsageError
from dart_hal.core.types import Estimate, Scan, State
from dart_hal.estimation.localisation.field import Map

from .lidar_fit import DEFAULT_GYRO_STD, LidarDrive, LidarFit, fit_lidar, rotation_sense
from .measured import Measured
from .mocap import CIRCLE_SPEEDS, drive_circles
from .mocap_fit import graph_places
from .procedure import Bench, Procedure, ProcedurePlan, scale_floor
from .runner import driving

# (m/s, to the left). Only one change of side, at low speed: each moves the car on, and rooms are
# small.
LIDAR_LEGS = [(speed, left) for left in (True, False)
              for speed in (*CIRCLE_SPEEDS, *reversed(CIRCLE_SPEEDS))]
# Steering of the circles, 1 = full lock: the smallest circles that a car drives, 0.5 m of radius.
LIDAR_LOCK = 1.0
# m: two circles of 0.5 m radius side by side, the car outside of them, and its drift.
LIDAR_FLOOR = (3.0, 2.0)
# s within which a connected lidar has sent a scan: its motor needs 1 to 2 s to reach its speed.
MAX_SCAN_WAIT = 3.0
# Sense of the scans relative to the gyro (1 correct, -1 mirrored) below which they are mirrored.
MIN_ROTATION_SENSE = 0.0
# m, m, rad, share by which the result may differ from car.toml. More is another lidar, or one that
# is mounted the other way round: a person has to check it.
MAX_MOUNT_CHANGE = {"x": 0.05, "y": 0.05, "yaw": math.radians(15.0), "scale": 0.05}
LIDAR_KEYS = {"x": "mount_x", "y": "mount_y", "yaw": "mount_yaw", "scale": "scale"}


def plan(files: CarFiles) -> ProcedurePlan:
    """Describe what ``measure`` does."""
    floor = scale_floor(LIDAR_FLOOR, files)
    return ProcedurePlan(
        f"circles at {CIRCLE_SPEEDS[0]} and {CIRCLE_SPEEDS[1]} m/s to the left and to the right, "
        "twice each, to measure the mounting pose and the scale of the lidar: about 55 s, a floor "
        f"of {floor[0]:g} m x {floor[1]:g} m in a room with a map, no tools",
        55.0, floor)


def measure(bench: Bench) -> Measured:
    """Measure mount [m, m, rad] and scale in the room of ``bench.chart``.

    Raises CalibrationFailed (with the likely cause), NoScan, LinkLost, NotArmed.
    """
    car = bench.car
    files = bench.files
    chart = bench.chart
    if chart is None:
        raise UsageError("the lidar is calibrated in a map", found="no chart", expected="a chart",
                         remedy="calibrate_lidar(car, chart=MAP), or --map room.yaml")
    if not car.has_lidar:
        raise _no_scans(False)
    states: list[State] = []
    scans: list[Scan] = []

    def collect(some: list[State]) -> None:
        states.extend(some)
        scans.extend(car.lidar.scans())

    collect(list(car.states(duration=MAX_SCAN_WAIT)))
    if not scans:
        raise car.lidar.trouble or _no_scans(True)
    with driving(car) as runner:
        drive_circles(runner, files, bench.progress, collect, LIDAR_LEGS, LIDAR_LOCK, whole=True)
    fit = check_and_fit(LidarDrive(states, scans), chart, _gyro_std(files))
    method = f"{fit.scans} scans in a map"
    found = {f"lidar.{LIDAR_KEYS[name]}": Quantity(estimate.value, estimate.std, method)
             for name, estimate in fit.found.items()}
    return Measured(files.config.name, bench.source, "lidar", found,
                    f"lidar and dead reckoning differ by {1e3 * fit.rms:.1f} mm rms, the map "
                    f"explains {100.0 * fit.agreement:.0f} % of the beams",
                    states[-1].t - states[0].t,
                    ("the scale is relative to the map: a map that is 1 % too large makes it 1 % "
                     "too large",),
                    graph=graph_places("Where each scan has the rear axle, by the mount measured",
                                       fit.marker, "each scan", "axle, 90 % interval to the left"))


def _gyro_std(files: CarFiles) -> float:
    """Relative standard error of the gyro scale: of this car, or else of any BNO055."""
    imu = files.calibration.imu if files.calibration else None
    scale = imu.gyro_scale if imu else None
    return scale.std / scale.value if scale else DEFAULT_GYRO_STD


def check_and_fit(drive: LidarDrive, chart: Map, gyro_std: float = DEFAULT_GYRO_STD) -> LidarFit:
    """Check the rotation of the scans, fit, and compare the result with car.toml.

    Raises CalibrationFailed for mirrored scans, scans of another room, and a mount that differs
    from car.toml by more than ``MAX_MOUNT_CHANGE``.
    """
    sense = rotation_sense(drive)
    mount = drive.scans[0].mount
    if sense is not None and sense < MIN_ROTATION_SENSE:
        raise _mirrored_scans(mount.inverted, sense)
    fit = fit_lidar(drive, chart, gyro_std)
    for name, limit in MAX_MOUNT_CHANGE.items():
        old = getattr(mount, name)
        now = fit.found[name]
        if abs(now.value - old) > limit:
            raise _other_mount(name, old, now)
    return fit


def _no_scans(connected: bool) -> CalibrationFailed:
    return CalibrationFailed(
        "no scans", found=f"none within {MAX_SCAN_WAIT:.0f} s", expected="a lidar that turns",
        likely="it has no 5 V, or its motor is at rest" if connected else "no lidar is named",
        remedy="dart-hal doctor" if connected else
        "--lidar serial:///dev/dart-lidar, $DART_HAL_LIDAR, or sim://?lidar=1&map=room")


def _mirrored_scans(inverted: bool, sense: float) -> CalibrationFailed:
    mounted = "upside down" if inverted else "upright"
    return CalibrationFailed(
        "the scans turn against the gyro", found=f"{sense:+.2f} times the car's turns",
        expected="+1 times: both turn to the left together",
        likely=f"the lidar is mounted {mounted}, or turns the other way round than "
               f"inverted = {str(inverted).lower()} under [lidar] in car.toml states",
        remedy=f"inverted = {str(not inverted).lower()} under [lidar] in car.toml")


def _other_mount(name: str, old: float, now: Estimate) -> CalibrationFailed:
    unit = {"yaw": " rad", "scale": ""}.get(name, " m")
    key = {"x": "lidar_x under [geometry]", "y": "y under [lidar]",
           "yaw": "mount_yaw under [lidar]", "scale": "scale under [lidar]"}[name]
    return CalibrationFailed(
        f"the lidar is not mounted as in car.toml: {name}", found=f"{now.value:.3f}{unit}",
        expected=f"{old:.3f}{unit} within {MAX_MOUNT_CHANGE[name]:.2f}",
        likely="it is mounted the other way round, or car.toml is of another car; scale: the map "
               "is not in metres",
        remedy=f"{key} = {now.value:.3f} in car.toml, then run it again")


calibrate_lidar = Procedure(
    name="lidar",
    help="""Mounting pose and scale of the lidar.

    Slow and fast circles to both sides, about a minute, in a room with a map. A lidar upside down
    or with reversed rotation is refused, as is another room's map. Measure encoder and imu first.
    """,
    plan=plan, measure=measure, lidar=True,
    keys=tuple(f"lidar.{n}" for n in LIDAR_KEYS.values()), after=("clock", "encoder", "imu"))
