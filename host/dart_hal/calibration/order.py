"""``calibrate all``: the procedures in the order in which each needs what others have measured.

The clock makes every pulse, and the ESC's neutral is where the car stands. The encoder measures
the speeds at which the car turns and pulls. The gyro's scale and the encoder make the angles
of the steering map, behind whose backlash the servo's delay is measured.
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

OWN = {
    "clock": "clock:calibrate_clock",
    "esc": "esc:calibrate_esc",
    "encoder": "encoder:calibrate_encoder",
    "throttle": "throttle:calibrate_throttle",
    "imu": "imu:calibrate_imu",
    "steering": "steering:STEERING",
    "latency": "latency:calibrate_latency",
    "mocap": "mocap:calibrate_mocap",
    "lidar": "lidar:calibrate_lidar",
}
"""Module and name of our procedures, in the order in which they are run."""
VERBS = tuple(OWN)
GROUP = "dart_hal.procedures"
"""Entry points: procedures of other packages. They run after ours."""
FRESH = timedelta(hours=12)
"""A session at the car: what was measured within it is not measured again unless asked for."""

Run = Callable[["Car", Workshop, Progress, Ask], Result]


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


def list_names() -> tuple[str, ...]:
    """Names of all procedures in the order in which they are run, without importing any."""
    return (*OWN, *(name for name in list_plugins(GROUP) if name not in OWN))


def load_procedure(name: str) -> Procedure[Any]:
    """Import a procedure of ``list_names``.

    Raises ConfigError for an entry point that is no Procedure of that name, PluginFailed for one
    that cannot be imported. What another package's procedure raises names that package, too.
    """
    if name in OWN:
        module, _, attribute = OWN[name].partition(":")
        own: Procedure[Any] = getattr(import_module(f"dart_hal.calibration.{module}"), attribute)
        return own
    entry = list_plugins(GROUP)[name]
    found = load_entry(entry)
    if not isinstance(found, Procedure) or found.name != name:
        raise ConfigError(f"the entry point {name} of {GROUP} is no calibration",
                          found=f"a Procedure named {found.name}"
                          if isinstance(found, Procedure) else repr(found),
                          expected=f"a Procedure named {name}",
                          remedy=f"correct {entry.value}, or uninstall its package")
    calls: dict[str, Any] = {
        field: _attribute(call, entry)
        for field in ("plan", "measure", "adapt", "check", "plot", "fit")
        if (call := getattr(found, field)) is not None}
    return replace(found, **calls)


def _attribute(call: Callable[..., Any], entry: EntryPoint) -> Callable[..., Any]:
    """The same with errors that name the package of the entry point."""
    def called(*args: Any, **options: Any) -> Any:
        with attribute_errors(entry):
            return call(*args, **options)

    return called


def steps_of(files: CarFiles, floor: tuple[float, float] | None = None, skip: Sequence[str] = (),
             poses: bool = False, chart: Map | None = None) -> tuple[Step, ...]:
    """The procedures for this car but ``skip``, in order, within ``floor`` (length, width) [m].

    poses: there is a source of poses from outside, whose marker is to be measured; chart: the map
    of the room, of a car whose lidar is to be measured.

    Errors: CalibrationFailed where one has no room, naming each that has none.
    """
    every = [load_procedure(name) for name in list_names() if name not in skip]
    steps = tuple(_step(procedure, files, floor, chart) for procedure in every
                  if procedure.keys and (poses or not procedure.poses)
                  and (chart is not None or not procedure.lidar))
    if floor is not None:
        _fit(steps, floor)
    return steps


def _step(procedure: Procedure[Any], files: CarFiles, floor: tuple[float, float] | None,
          chart: Map | None) -> Step:
    options = {**procedure.defaults, **({} if floor is None else procedure.adapt(floor))}
    plan = procedure.plan(files, **options)

    def run(car: Car, workshop: Workshop, progress: Progress, ask: Ask) -> Result:
        found: Result = procedure(car, workshop, progress=progress, ask=ask, source=car.url,
                                  chart=chart, **options)
        return found

    return Step(procedure.name, str(plan or ""), run, procedure.keys, procedure.after,
                plan.floor if plan else (0.0, 0.0), procedure.optional)


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
    return getattr(getattr(calibration, table, None), name, None) is not None


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


def to_json(steps: Sequence[Step], left: Sequence[Step]) -> list[dict[str, Any]]:
    """What is coming, for machines: every step, and whether it will be run."""
    return [{"verb": s.verb, "plan": s.plan, "floor_m": list(s.floor), "due": s in left}
            for s in steps]
