"""From a recorded drive to a fit: what ``identify`` makes of it, beside the model before."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec

from dart_hal.car import Car
from dart_hal.car.runs import FRAMES_PER_FINE_MESSAGE, FRAMES_PER_MESSAGE, MASS_NOTE, read_run
from dart_hal.core.config import CarFiles, Quantity
from dart_hal.core.ports import Workshop
from dart_hal.core.ports.workshop import SCALE_STD
from dart_hal.vehicle.load import find_model, vehicle_of
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.fit import Estimate, Fit
from dart_lab.identification.submodels import fit_submodels
from dart_lab.identification.write import Source, Written, model_from, write

from .scales import with_scales
from .understeer import Understeer, understeer

FRAMES = {"delay": FRAMES_PER_FINE_MESSAGE}
"""Frames to a message, else ten: where timing is the question, the PWM frame of the commands."""
MASS_STD = 0.02
"""Relative std of a mass in car.toml that nobody has weighed for this experiment."""


ONBOARD = "on-board sensors tell"
"""How identify's note on the tyres of runs begins; the ramps say it better."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """fits by sub-model, report by file as ``identify`` prints it, base values beside them.

    understeer: what on-board sensors tell of the tyres; None for other experiments.
    """

    fits: Mapping[str, Fit]
    files: Mapping[str, Any]
    base: Vehicle
    mass: Estimate
    understeer: Understeer | None = None

    @property
    def empty(self) -> bool:
        """Whether the drive told nothing at all."""
        return self.understeer is None and not any(fit.n for fit in self.fits.values())

    @property
    def sound(self) -> bool:
        """Whether the fit that the experiment is about may be used."""
        return all(fit.sound for fit in self.fits.values())

    def before(self, submodel: str, name: str) -> float:
        """The value of the model that the car had before."""
        return float(getattr(getattr(self.base, submodel), name))


def mass_of(files: CarFiles, kilograms: float | None = None, workshop: Workshop | None = None
            ) -> Estimate:
    """The car's mass [kg]: as weighed, else on the workshop's scale, else car.toml's."""
    if kilograms is not None:
        return Estimate(kilograms, SCALE_STD, "kg")
    if workshop is not None:
        value, std = workshop.mass()
        return Estimate(value, std, "kg")
    entry = files.config.geometry.mass
    return Estimate(entry, MASS_STD * entry, "kg")


def note_mass(car: Car, mass: Estimate) -> None:
    """Put what was weighed into the recording, so that ``identify`` takes it later."""
    car.note(MASS_NOTE, {"kg": repr(mass.value), "std": repr(mass.std)})


def fit_run(path: str | Path, name: str, files: CarFiles, mass: Estimate) -> Outcome:
    """Fit the sub-model ``name`` to a recorded drive.

    Errors: RecordingError for a run that is too short or cannot be read.
    """
    base = vehicle_of(files.model)
    recording = read_run(path, FRAMES.get(name, FRAMES_PER_MESSAGE))
    fits, reports = fit_submodels([recording], [name], base=base, mass=mass)
    told = understeer(recording, files, mass.value) if name == "tyres" else None
    if told is not None:  # from the ramps, and finer than what any recording would tell
        fits = {n: replace(fit, notes=tuple(s for s in fit.notes if not s.startswith(ONBOARD)))
                for n, fit in fits.items()}
    return Outcome({n: with_scales(fit, files) for n, fit in fits.items()}, reports, base, mass,
                   told)


def write_model(outcome: Outcome, files: CarFiles, run: Path, target: Path, command: str
                ) -> Written:
    """Put sound fits and the mass they hang on into ``target``, over what it holds already.

    What it does not hold is the car's model.toml, else the paper's. Nothing is
    written when no fit is sound. Errors: ConfigError, OSError.
    """
    start = find_model(target)[0] if target.exists() else files.model or find_model("paper")[0]
    mass = Quantity(outcome.mass.value, outcome.mass.std)
    start = msgspec.structs.replace(start, body={**start.body, "mass": mass})
    source = Source({str(run): hashlib.sha256(run.read_bytes()).hexdigest()}, command,
                    method="experiment")
    written = model_from(outcome.fits, start, source)
    write(written, target)
    return written
