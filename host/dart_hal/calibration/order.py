"""``calibrate all``: the procedures in the order in which they need each other's results.

The clock sets every pulse, and the neutral of the ESC the standstill. The encoder measures the
speeds of the turns and accelerations. Gyro scale and encoder give the angles of the steering map,
whose backlash affects the delay of the servo.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta, timezone
from importlib import import_module
from typing import TYPE_CHECKING, Any

from dart_hal.calibration.procedure import Ask, Procedure, Progress
from dart_hal.calibration.result import Result
from dart_hal.core.config import Calibration, CarFiles
from dart_hal.core.errors import CalibrationFailed, ConfigError
from dart_hal.core.plugins import attribute_errors, list_plugins, load_entry
from dart_hal.core.ports import Workshop

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from dart_hal.car import Car
    from dart_hal.estimation.localisation.field import Map

# Module and name of the built-in procedures, in the order in which they run.
BUILT_IN = {
    "clock": "clock:calibrate_clock",
    "esc": "esc:calibrate_esc",
    "encoder": "encoder:calibrate_encoder",
    "throttle": "throttle:calibrate_throttle",
    "imu": "imu:calibrate_imu",
    "steering": "steering:STEERING_PROCEDURE",
    "latency": "latency:calibrate_latency",
    "mocap": "mocap:calibrate_mocap",
    "lidar": "lidar:calibrate_lidar",
}
PROCEDURE_NAMES = tuple(BUILT_IN)
# Entry points: procedures of other packages. They run after the built-in ones.
ENTRY_POINTS = "dart_hal.procedures"
# A session at the car: its results are not measured again unless requested.
MAX_RESULT_AGE = timedelta(hours=12)

Run = Callable[["Car", Workshop, Progress, Ask], Result]


@dataclass(frozen=True, slots=True)
class ProcedureStep:
    """One procedure on one car.

    keys: names in calibration.toml that it writes. after: verbs whose result it uses. floor:
    (length, width) [m] that it needs, (0, 0) none. optional: the others do not need it.
    """

    verb: str
    plan: str
    run: Run
    keys: tuple[str, ...]
    after: tuple[str, ...] = ()
    floor: tuple[float, float] = (0.0, 0.0)
    optional: bool = False


def list_names() -> tuple[str, ...]:
    """Names of all procedures in the order in which they run, without importing any."""
    return (*BUILT_IN, *(name for name in list_plugins(ENTRY_POINTS) if name not in BUILT_IN))


def load_procedure(name: str) -> Procedure[Any]:
    """Import a procedure of ``list_names``.

    Raises ConfigError for an entry point that is not a Procedure of that name, PluginFailed for one
    that cannot be imported. Errors of another package's procedure also name that package.
    """
    if name in BUILT_IN:
        module, _, attribute = BUILT_IN[name].partition(":")
        own: Procedure[Any] = getattr(import_module(f"dart_hal.calibration.{module}"), attribute)
        return own
    entry = list_plugins(ENTRY_POINTS)[name]
    found = load_entry(entry)
    if not isinstance(found, Procedure) or found.name != name:
        raise ConfigError(f"the entry point {name} of {ENTRY_POINTS} is not a calibration",
                          found=f"a Procedure named {found.name}"
                          if isinstance(found, Procedure) else repr(found),
                          expected=f"a Procedure named {name}",
                          remedy=f"correct {entry.value}, or uninstall its package")
    calls: dict[str, Any] = {
        field: _name_package(call, entry)
        for field in ("plan", "measure", "adapt", "check", "plot", "fit")
        if (call := getattr(found, field)) is not None}
    return replace(found, **calls)


def _name_package(call: Callable[..., Any], entry: EntryPoint) -> Callable[..., Any]:
    """Wrap a function so that its errors name the package of the entry point."""
    def wrapper(*args: Any, **options: Any) -> Any:
        with attribute_errors(entry):
            return call(*args, **options)

    return wrapper


def make_steps(files: CarFiles, floor: tuple[float, float] | None = None, skip: Sequence[str] = (),
               poses: bool = False, chart: Map | None = None) -> tuple[ProcedureStep, ...]:
    """Make the procedures for this car without ``skip``, in order.

    floor: (length, width) [m] that has to be enough for each; None: any. poses: there
    is a source of external poses, whose marker is to be measured. chart: map of the room, for a car
    whose lidar is to be measured.
    Raises CalibrationFailed that names all procedures for which the floor is too small.
    """
    every = [load_procedure(name) for name in list_names() if name not in skip]
    steps = tuple(_step(procedure, files, floor, chart) for procedure in every
                  if procedure.keys and (poses or not procedure.poses)
                  and (chart is not None or not procedure.lidar))
    if floor is not None:
        _check_floor(steps, floor)
    return steps


def _step(procedure: Procedure[Any], files: CarFiles, floor: tuple[float, float] | None,
          chart: Map | None) -> ProcedureStep:
    options = {**procedure.defaults, **({} if floor is None else procedure.adapt(floor))}
    plan = procedure.plan(files, **options)

    def run(car: Car, workshop: Workshop, progress: Progress, ask: Ask) -> Result:
        found: Result = procedure(car, workshop, progress=progress, ask=ask, source=car.url,
                                  chart=chart, **options)
        return found

    return ProcedureStep(procedure.name, str(plan or ""), run, procedure.keys, procedure.after,
                plan.floor if plan else (0.0, 0.0), procedure.optional)


def due(steps: Sequence[ProcedureStep], calibration: Calibration | None, now: datetime | None = None
        ) -> tuple[ProcedureStep, ...]:
    """Select the steps that have to run.

    A step is due if it was never measured, if its result is older than ``MAX_RESULT_AGE``, or if a
    procedure that it uses is due or was measured later.
    """
    now = now or datetime.now(timezone.utc)
    when = {s.verb: measurement_time(s, calibration) for s in steps}
    found: list[ProcedureStep] = []
    for step in steps:
        own = when[step.verb]
        used = [when[verb] for verb in step.after if verb in when]
        repeated = set(step.after) & {s.verb for s in found if not s.optional}
        if own is None or now - own > MAX_RESULT_AGE or repeated or any(
                u and u > own for u in used):
            found.append(step)
    return tuple(found)


def measurement_time(step: ProcedureStep, calibration: Calibration | None) -> datetime | None:
    """Time at which ``calibrate`` wrote the result of this step; None if a key is missing."""
    if calibration is None or not all(_has_key(calibration, key) for key in step.keys):
        return None
    when = calibration.provenance.get(step.verb, {}).get("when")
    if not isinstance(when, datetime):
        return None
    return when if when.tzinfo else when.replace(tzinfo=timezone.utc)


def _has_key(calibration: Calibration, key: str) -> bool:
    table, _, name = key.partition(".")
    return getattr(getattr(calibration, table, None), name, None) is not None


def _check_floor(steps: Sequence[ProcedureStep], floor: tuple[float, float]) -> None:
    long = max(floor)
    wide = min(floor)
    small = [s for s in steps if max(s.floor) > long or min(s.floor) > wide]
    if small:
        raise CalibrationFailed(
            "the floor is too small for " + ", ".join(s.verb for s in small),
            found=f"{long:g} m x {wide:g} m",
            expected="; ".join(f"{s.verb}: {max(s.floor):.1f} m x {min(s.floor):.1f} m"
                               for s in small),
            likely="a small room, or wrong numbers: --floor LENGTH WIDTH in metres",
            remedy=" ".join(["a larger room, or dart-hal calibrate all",
                             *(f"--skip {s.verb}" for s in small)]))


def to_json(steps: Sequence[ProcedureStep], remaining: Sequence[ProcedureStep]
            ) -> list[dict[str, Any]]:
    """Return every step and whether it will run, as JSON."""
    return [{"verb": s.verb, "plan": s.plan, "floor_m": list(s.floor), "due": s in remaining}
            for s in steps]
