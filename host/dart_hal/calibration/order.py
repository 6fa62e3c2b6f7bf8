"""``calibrate all``: the procedures in the order in which each needs what others have measured.

The clock makes every pulse, and the ESC's neutral is where the car stands. The encoder measures
the speeds at which the car turns and pulls. The gyro's scale and the encoder make the angles
of the steering map, behind whose backlash the servo's delay is measured.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from typing import Any

from dart_hal.calibration import (
    clock,
    encoder,
    esc,
    imu,
    latency,
    lidar,
    mocap,
    steering,
    throttle,
)
from dart_hal.calibration.asking import Ask, Progress
from dart_hal.calibration.measured import Measured
from dart_hal.calibration.mocap_fit import NAMES
from dart_hal.calibration.result import SteeringResult
from dart_hal.car import Car
from dart_hal.core.config import Calibration, CarFiles
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.ports import Workshop
from dart_hal.estimation.localisation.field import Map

FRESH = timedelta(hours=12)
"""A session at the car: what was measured within it is not measured again unless asked for."""
ROLL_OUT = 1.0
"""m beyond the taped distance: the car's length, and what it takes to stop."""

Found = Measured | SteeringResult
Run = Callable[[Car, Workshop, Progress, Ask], Found]
VERBS = ("clock", "esc", "encoder", "throttle", "imu", "steering", "latency", "mocap",
         "lidar")
"""All there are, in the order in which they are run."""


@dataclass(frozen=True, slots=True)
class Step:
    """One procedure on one car.

    keys: what stands in calibration.toml once it is done; after: verbs whose outcome it uses;
    floor: (length, width) [m] that it needs, (0, 0) none; optional: the rest goes on without it.
    """

    verb: str
    plan: str
    run: Run
    keys: tuple[str, ...]
    after: tuple[str, ...] = ()
    floor: tuple[float, float] = (0.0, 0.0)
    optional: bool = False


def steps_of(files: CarFiles, floor: tuple[float, float] | None = None, skip: Sequence[str] = (),
             poses: bool = False, chart: Map | None = None) -> tuple[Step, ...]:
    """The procedures for this car but ``skip``, in order, within ``floor`` (length, width) [m].

    poses: there is a source of poses from outside, whose marker is to be measured; chart: the map
    of the room, of a car whose lidar is to be measured.

    Errors: CalibrationFailed where one has no room, naming each that has none.
    """
    rolled, room = encoder.DISTANCE, throttle.ROOM
    if floor is not None:
        rolled = max(min(rolled, max(floor) - ROLL_OUT), encoder.SHORTEST)
        room = min(room, max(floor))
    route = steering.plan(files)
    every = (
        Step("clock", clock.plan(files), _clock, ("pwm.oscillator_hz",), optional=True),
        Step("esc", esc.plan(files), _esc, ("throttle.neutral_us", "throttle.deadband_forward_us"),
             ("clock",)),
        Step("encoder", encoder.plan(files, rolled), _encoder(rolled),
             ("encoder.metres_per_edge",), ("clock",), (rolled + ROLL_OUT, 1.0)),
        Step("throttle", throttle.plan(files, room), _throttle(room), ("throttle.drive",),
             ("clock", "esc", "encoder"),
             (room, 1.0) if throttle.speeds_in(room) else throttle.CIRCLE_FLOOR),
        Step("imu", imu.plan(files), _imu, ("imu.gyro_scale", "imu.mount_yaw"),
             ("clock", "encoder"), imu.FLOOR),
        Step("steering", str(route), _steering, ("steering.map",), ("clock", "encoder", "imu"),
             (2.0 * route.radius, 2.0 * route.radius)),
        Step("latency", latency.plan(files), _latency,
             ("latency.pulse_to_wheel", "latency.pulse_to_yaw", "latency.sensor_to_host"),
             ("clock", "esc", "encoder", "imu", "steering"), latency.FLOOR),
        Step("mocap", mocap.plan(files), _mocap, tuple(f"mocap.{n}" for n in NAMES),
             ("clock", "encoder", "imu"), mocap.FLOOR),
        *(() if chart is None else (
            Step("lidar", lidar.plan(files), _lidar(chart),
                 tuple(f"lidar.{n}" for n in lidar.KEYS.values()), ("clock", "encoder", "imu"),
                 lidar.FLOOR),)),
    )
    left_out = {*skip, *(() if poses else ("mocap",))}
    steps = tuple(s for s in every if s.verb not in left_out)
    if floor is not None:
        _fit(steps, floor)
    return steps


def due(steps: Sequence[Step], calibration: Calibration | None, now: datetime | None = None
        ) -> tuple[Step, ...]:
    """Those that are not measured, or before something that they use, or longer ago than FRESH."""
    now = now or datetime.now(timezone.utc)
    when = {s.verb: measured_at(s, calibration) for s in steps}
    found: list[Step] = []
    for step in steps:
        mine = when[step.verb]
        used = [when[verb] for verb in step.after if verb in when]
        anew = set(step.after) & {s.verb for s in found if not s.optional}
        if mine is None or now - mine > FRESH or anew or any(u and u > mine for u in used):
            found.append(step)
    return tuple(found)


def measured_at(step: Step, calibration: Calibration | None) -> datetime | None:
    """When ``calibrate`` wrote what this step measures; None: not all of it is there."""
    if calibration is None or not all(_there(calibration, key) for key in step.keys):
        return None
    when = calibration.provenance.get(step.verb, {}).get("when")
    if not isinstance(when, datetime):
        return None
    return when if when.tzinfo else when.replace(tzinfo=timezone.utc)


def _there(calibration: Calibration, key: str) -> bool:
    table, _, name = key.partition(".")
    return getattr(getattr(calibration, table), name) is not None


def _fit(steps: Sequence[Step], floor: tuple[float, float]) -> None:
    long, wide = max(floor), min(floor)
    small = [s for s in steps if max(s.floor) > long or min(s.floor) > wide]
    if small:
        raise CalibrationFailed(
            "the floor is too small for " + ", ".join(s.verb for s in small),
            found=f"{long:g} m x {wide:g} m",
            expected="; ".join(f"{s.verb}: {max(s.floor):.1f} m x {min(s.floor):.1f} m"
                               for s in small),
            likely="the room, or the order of the numbers: --floor LENGTH WIDTH in metres",
            remedy=" ".join(["a larger room, or dart-hal calibrate all",
                             *(f"--skip {s.verb}" for s in small)]))


def _clock(car: Car, workshop: Workshop, progress: Progress, ask: Ask) -> Found:
    return clock.calibrate_clock(car, progress=progress, ask=ask, source=car.url)


def _encoder(distance: float) -> Run:
    def run(car: Car, workshop: Workshop, progress: Progress, ask: Ask) -> Found:
        return encoder.calibrate_encoder(car, workshop, progress=progress, ask=ask,
                                         source=car.url, distance=distance)
    return run


def _esc(car: Car, workshop: Workshop, progress: Progress, ask: Ask) -> Found:
    return esc.calibrate_esc(car, workshop, progress=progress, ask=ask, source=car.url)


def _throttle(room: float) -> Run:
    def run(car: Car, workshop: Workshop, progress: Progress, ask: Ask) -> Found:
        return throttle.calibrate_throttle(car, workshop, progress=progress, ask=ask,
                                           source=car.url, room=room)
    return run


def _imu(car: Car, workshop: Workshop, progress: Progress, ask: Ask) -> Found:
    return imu.calibrate_imu(car, workshop, progress=progress, ask=ask, source=car.url)


def _steering(car: Car, workshop: Workshop, progress: Progress, ask: Ask) -> Found:
    return steering.calibrate_steering(car, progress=progress, ask=ask, source=car.url,
                                       dry_run=True)


def _latency(car: Car, workshop: Workshop, progress: Progress, ask: Ask) -> Found:
    return latency.calibrate_latency(car, workshop, progress=progress, ask=ask, source=car.url)


def _mocap(car: Car, workshop: Workshop, progress: Progress, ask: Ask) -> Found:
    return mocap.calibrate_mocap(car, progress=progress, ask=ask, source=car.url)


def _lidar(chart: Map) -> Run:
    def run(car: Car, workshop: Workshop, progress: Progress, ask: Ask) -> Found:
        return lidar.calibrate_lidar(car, chart, progress=progress, ask=ask, source=car.url)
    return run


def to_json(steps: Sequence[Step], left: Sequence[Step]) -> list[dict[str, Any]]:
    """What is coming, for machines: every step, and whether it will be run."""
    return [{"verb": s.verb, "plan": s.plan, "floor_m": list(s.floor), "due": s in left}
            for s in steps]
