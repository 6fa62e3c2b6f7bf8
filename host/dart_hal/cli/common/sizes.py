"""Whose sizes the verbs on recordings use: of the car that is named, or of the runs, or assumed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import click
import msgspec

from dart_hal.cli.common.options import cars_option
from dart_hal.cli.common.output import console, say
from dart_hal.core.config import CarFiles, ModelFile, load_car
from dart_hal.recording.dart import Recording
from dart_hal.vehicle.load import vehicle_of
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.sets import SETS
from dart_hal.vehicle.sizes import SIZES, differing, listed_sizes, with_lock, with_sizes

F = TypeVar("F", bound=Callable[..., Any])
ASSUMED = "assumed"
"""How ``provenance.sizes`` of a model begins whose sizes nobody stated."""


@dataclass(frozen=True, slots=True)
class Sizes:
    """A model with the sizes of a car.

    model, vehicle: with them. source: in words. assumed: no car was named, and the sizes are
    those of DART. caution: what is to be known about them, "" for nothing.
    """

    model: ModelFile
    vehicle: Vehicle
    source: str
    assumed: bool = False
    caution: str = ""

    def show(self, as_json: bool) -> None:
        """First line of the output where sizes are assumed; a caution where they contradict."""
        line = self.first_line
        if line and as_json:
            console.print(line, style="yellow", markup=False, highlight=False)
        elif line:
            say(line, "yellow")
        if self.caution:
            console.print(f"caution: {self.caution}", style="yellow", markup=False,
                          highlight=False)

    @property
    def first_line(self) -> str:
        """What was assumed of which car; "" where nothing was."""
        if not self.assumed:
            return ""
        return (f"assumed: {listed_sizes(self.model)}, of {self.source}, because no car is named; "
                "--car NAME (or $DART_HAL_CAR) takes those of NAME/car.toml")

    @property
    def lines(self) -> tuple[str, ...]:
        """What was assumed, and what contradicts, as sentences."""
        return tuple(line for line in (self.first_line, self.caution) if line)

    def to_json(self) -> dict[str, Any]:
        """The object under "sizes" of the verbs with ``--json``."""
        return {"source": self.source, "assumed": self.assumed, "caution": self.caution or None,
                **{key: float(getattr(self.vehicle.body, key)) for key in SIZES}}


def recorded_car_options(command: F) -> F:
    """``--car`` and ``--cars`` of a verb that reads recordings: no car is named by default."""
    return click.option("--car", "car_name", default=None, envvar="DART_HAL_CAR", metavar="NAME",
                        help="car of the recordings; its car.toml gives wheelbase, mass, centre of "
                        "mass, inertia and lock (also: $DART_HAL_CAR; default: of the runs, else "
                        "those of DART, which is said)")(cars_option(command))


def named_car(name: str | None, cars: Path | None, out: Path | None = None) -> CarFiles | None:
    """Files of the car that is named, or in whose folder ``out`` is; None for neither.

    Raises as ``config.load_car``.
    """
    folders = [cars] if cars else None
    if name:
        return load_car(name, folders)
    if out is not None and (out.parent / "car.toml").is_file():
        folder = out.absolute().parent
        return load_car(folder.name, [folder.parent])
    return None


def sized(name: str, model: ModelFile, car: CarFiles | None, recordings: Sequence[Recording], *,
          fitting: bool) -> Sizes:
    """A model with the sizes of the car of the recordings.

    1. Those of the named car, where the model is a shipped set or is to be fitted.
    2. Those that a model file states; a named car that contradicts them is a caution.
    3. Those of the car of the runs, where all recordings are runs of one car.
    4. Those of DART. That is an assumption, unless all recordings are published ones.

    name: of the model on the command line. fitting: the model is the base of a fit.
    """
    stated = name not in SETS and not str(model.provenance.get("sizes", "")).startswith(ASSUMED)
    if car is not None and (fitting or not stated):
        changed = with_sizes(model, car.config.geometry)
        changed = with_lock(changed, car.config) if fitting else changed
        return _made(changed, f"car {car.config.name} ({car.origin})")
    if car is not None:
        apart = differing(model, car.config.geometry)
        caution = (f"{name} states other sizes than car {car.config.name} ({car.origin}): "
                   f"{', '.join(apart)}; those of the model are used" if apart else "")
        return _made(model, f"the model {name}", caution=caution)
    if stated:
        return _made(model, f"the model {name}")
    owner = recordings[0].car if recordings else None
    if owner is not None and all(r.car is not None and r.car.geometry == owner.geometry
                                 for r in recordings):
        return _made(with_sizes(model, owner.geometry), f"car {owner.name}, as its runs hold it")
    published = bool(recordings) and all(r.published for r in recordings)
    return _made(model, "the DART car", assumed=not published)


def _made(model: ModelFile, source: str, *, assumed: bool = False, caution: str = "") -> Sizes:
    """With the source of the sizes in the provenance of the model."""
    noted = f"{ASSUMED}: {source}" if assumed else source
    model = msgspec.structs.replace(model, provenance={**model.provenance, "sizes": noted})
    return Sizes(model, vehicle_of(model), source, assumed, caution)


