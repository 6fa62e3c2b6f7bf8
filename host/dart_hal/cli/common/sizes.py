"""Sizes of the car for verbs on recordings: of the named car, of the runs, or assumed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import click
import msgspec

from dart_hal.cli.common.options import cars_option
from dart_hal.cli.common.output import console
from dart_hal.core.config import CarConfig, CarFiles, ModelFile, load_car
from dart_hal.recording.dart import Recording
from dart_hal.vehicle.load import vehicle_of
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.scale import find_scale
from dart_hal.vehicle.sets import SETS
from dart_hal.vehicle.sizes import (
    SIZES,
    describe_sizes,
    find_steering_lock,
    is_drive_assumed,
    list_differences,
    scale_steering_lock,
    set_sizes,
)

CommandT = TypeVar("CommandT", bound=Callable[..., Any])
# Start of ``provenance.sizes`` of a model whose sizes were not stated.
ASSUMED_PREFIX = "assumed"


@dataclass(frozen=True, slots=True)
class SizedModel:
    """A model with the sizes of a car.

    model, vehicle: with these sizes. source: of the sizes, in words. assumed: no car was named, so
    the sizes are those of DART. caution: contradiction of two sources, "" if there is none.
    """

    model: ModelFile
    vehicle: Vehicle
    source: str
    assumed: bool = False
    caution: str = ""

    def show_cautions(self, as_json: bool) -> None:
        """Print a caution if two sources contradict, with JSON the assumption about sizes too.

        Text has the assumption below its verdict.
        """
        if self.first_line and as_json:
            console.print(self.first_line, style="yellow", markup=False, highlight=False)
        if self.caution:
            console.print(f"caution: {self.caution}", style="yellow", markup=False,
                          highlight=False)

    @property
    def first_line(self) -> str:
        """The assumption as a sentence; "" if nothing is assumed."""
        if not self.assumed:
            return ""
        sizes = describe_sizes(self.model)
        return (f"assumed: {sizes}, of {self.source}, because no car is named; "
                "--car NAME (or $DART_HAL_CAR) takes those of NAME/car.toml")

    @property
    def lines(self) -> tuple[str, ...]:
        """The assumption and the caution as sentences."""
        return tuple(line for line in (self.first_line, self.caution) if line)

    def to_json(self) -> dict[str, Any]:
        """Return the object under "sizes" of the verbs with ``--json``."""
        return {"source": self.source, "assumed": self.assumed, "caution": self.caution or None,
                **{key: float(getattr(self.vehicle.body, key)) for key in SIZES}}


def recorded_car_options(command: CommandT) -> CommandT:
    """Add ``--car`` and ``--cars`` of a verb on recordings: no car is named by default."""
    return click.option("--car", "car_name", default=None, envvar="DART_HAL_CAR", metavar="NAME",
                        help="car of the recordings; its car.toml gives wheelbase, mass, centre of "
                        "mass, inertia and largest steering angle (also: $DART_HAL_CAR; default: "
                        "those of the runs, else of DART, with a notice)")(cars_option(command))


def load_named_car(name: str | None, cars: Path | None, out: Path | None = None) -> CarFiles | None:
    """Load the files of the named car, or of the car in whose folder ``out`` is; else None.

    Raises as ``config.load_car``.
    """
    folders = [cars] if cars else None
    if name:
        return load_car(name, folders)
    if out is not None and (out.parent / "car.toml").is_file():
        folder = out.absolute().parent
        return load_car(folder.name, [folder.parent])
    return None


def apply_car_sizes(name: str, model: ModelFile, car: CarFiles | None,
                    recordings: Sequence[Recording], *, fitting: bool) -> SizedModel:
    """Give a model the sizes of the car of the recordings. The first rule that applies decides:

    1. Sizes of the named car, if the model is a shipped set or the base of a fit.
    2. Sizes that a model file states; a named car with other sizes is a caution.
    3. Sizes of the car of the runs, if all recordings are runs of one car.
    4. Sizes of DART. This is an assumption, unless all recordings are published ones.

    name: of the model on the command line. fitting: the model is the base of a fit.
    """
    # A shipped set has DART's sizes, and an assumption is no statement: both give way to a car.
    source = str(model.provenance.get("sizes", ""))
    stated = name not in SETS and not source.startswith(ASSUMED_PREFIX)
    if car is not None and (fitting or not stated):
        changed = set_sizes(model, car.config.geometry)
        lock = _find_start_lock(car.config, recordings) if fitting else None
        changed = changed if lock is None else scale_steering_lock(changed, lock)
        return _record_source(changed, f"car {car.config.name} ({car.origin})", recordings,
                              caution=_describe_assumed_drive(car.config))
    if car is not None:
        differences = list_differences(model, car.config.geometry)
        caution = (f"{name} states other sizes than car {car.config.name} ({car.origin}): "
                   f"{', '.join(differences)}; those of the model are used" if differences else "")
        return _record_source(model, f"the model {name}", recordings, caution=caution)
    if stated:
        return _record_source(model, f"the model {name}", recordings)
    lock = _find_start_lock(None, recordings) if fitting else None
    model = model if lock is None else scale_steering_lock(model, lock)
    # Runs contain the car.toml of their car. One of another car, or none, ends this rule.
    owner = recordings[0].car if recordings else None
    if owner is not None and all(r.car is not None and r.car.geometry == owner.geometry
                                 for r in recordings):
        return _record_source(set_sizes(model, owner.geometry),
                              f"car {owner.name}, as recorded in its runs", recordings,
                              caution=_describe_assumed_drive(owner))
    published = bool(recordings) and all(r.published for r in recordings)
    return _record_source(model, "the DART car", recordings, assumed=not published)


def _find_start_lock(car: CarConfig | None, recordings: Sequence[Recording]) -> float | None:
    """Return the steering angle [rad] of the command 1 at the start of a fit, None if unknown.

    An imported recording of angles states it; otherwise it is the largest angle of the car.
    """
    scales = {r.steering_scale for r in recordings}
    stated = scales.pop() if len(scales) == 1 else None
    return stated or (None if car is None else find_steering_lock(car))


def _describe_assumed_drive(car: CarConfig) -> str:
    """Return a caution if it is not known which wheels of a car are driven, else ""."""
    if not is_drive_assumed(car.geometry):
        return ""
    return (f"all-wheel drive is assumed, because car.toml of {car.name} does not state the driven "
            "axle: dart-hal car new --drive, or [geometry] front_share (0 rear, 0.5 all, 1 front)")


def _record_source(model: ModelFile, source: str, recordings: Sequence[Recording], *,
                   assumed: bool = False, caution: str = "") -> SizedModel:
    """Write the source of the sizes into the provenance of the model."""
    recorded = f"{ASSUMED_PREFIX}: {source}" if assumed else source
    model = msgspec.structs.replace(model, provenance={**model.provenance, "sizes": recorded})
    vehicle = vehicle_of(model)
    cautions = [line for line in (caution, _describe_other_scales(vehicle, recordings)) if line]
    return SizedModel(model, vehicle, source, assumed, "; ".join(cautions))


def _describe_other_scales(vehicle: Vehicle, recordings: Sequence[Recording]) -> str:
    """Return a caution if recordings count as those of a car of another size, else ""."""
    # A recording without car.toml counts as one of a 1:10 car.
    scale = find_scale(vehicle.body)
    others = [r.name for r in recordings if r.scale != scale]
    if not others:
        return ""
    return (f"{len(others)} recording(s) of {len(recordings)} are read with the limits of speed "
            f"and length of a car of another size, because they do not have the car.toml of this "
            f"one: {others[0]}; import or record them with --car")
