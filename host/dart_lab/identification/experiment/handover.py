"""Fit of a recorded experiment, compared with the previous model of the car."""

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
from dart_lab.identification.battery import find_mean_voltage
from dart_lab.identification.fit import FittedParameter, SubmodelFit
from dart_lab.identification.submodels import fit_submodels
from dart_lab.identification.write import Source, WrittenModel, build_model, write

from .scales import add_scale_errors
from .understeer import Understeer, fit_understeer

# Frames per message (others: ten). The delay test needs the PWM frames of the commands.
FRAMES_BY_EXPERIMENT = {"delay": FRAMES_PER_FINE_MESSAGE}
# Relative standard error of a mass in car.toml that was not weighed for this experiment.
MASS_STD = 0.02


# Begin of identify's note on the tyres, which the result of the ramps replaces.
ONBOARD_NOTE = "on-board sensors identify"


@dataclass(frozen=True, slots=True)
class ExperimentOutcome:
    """Fits by sub-model, reports by file as ``identify`` prints them, and the base model.

    understeer: gradient from on-board sensors; None for other experiments. motor_voltage [V]: mean
    voltage of the battery in the drive; None: not measured.
    """

    fits: Mapping[str, SubmodelFit]
    files: Mapping[str, Any]
    base: Vehicle
    mass: FittedParameter
    understeer: Understeer | None = None
    motor_voltage: float | None = None

    @property
    def empty(self) -> bool:
        """Whether no parameter was fitted."""
        return self.understeer is None and not any(fit.n for fit in self.fits.values())

    @property
    def sound(self) -> bool:
        """Whether all fits of the experiment may be used."""
        return all(fit.sound for fit in self.fits.values())

    def value_before(self, submodel: str, parameter: str) -> float:
        """Return the value of the car's previous model."""
        return float(getattr(getattr(self.base, submodel), parameter))


def find_mass(files: CarFiles, kilograms: float | None = None, workshop: Workshop | None = None
              ) -> FittedParameter:
    """Return the car's mass [kg]: as given, else from the workshop's scale, else car.toml's."""
    if kilograms is not None:
        return FittedParameter(kilograms, SCALE_STD, "kg")
    if workshop is not None:
        value, std = workshop.mass()
        return FittedParameter(value, std, "kg")
    entry = files.config.geometry.mass
    return FittedParameter(entry, MASS_STD * entry, "kg")


def note_mass(car: Car, mass: FittedParameter) -> None:
    """Write the mass into the recording, so that ``identify`` uses it later."""
    car.note(MASS_NOTE, {"kg": repr(mass.value), "std": repr(mass.std)})


def fit_run(path: str | Path, name: str, files: CarFiles,
            mass: FittedParameter) -> ExperimentOutcome:
    """Fit the sub-model ``name`` to a recorded drive.

    Raises RecordingError for a run that is too short or cannot be read.
    """
    base = vehicle_of(files.model)
    recording = read_run(path, FRAMES_BY_EXPERIMENT.get(name, FRAMES_PER_MESSAGE))
    fits, reports = fit_submodels([recording], [name], base=base, mass=mass)
    gradient = fit_understeer(recording, files, mass.value) if name == "tyres" else None
    if gradient is not None:
        # The ramps give more than the understeer note of any recording, so they replace it.
        fits = {n: replace(fit, notes=tuple(s for s in fit.notes if not s.startswith(ONBOARD_NOTE)))
                for n, fit in fits.items()}
    return ExperimentOutcome({n: add_scale_errors(fit, files) for n, fit in fits.items()}, reports,
                             base, mass, gradient, find_mean_voltage([recording]))


def write_model(outcome: ExperimentOutcome, files: CarFiles, run: Path, target: Path, command: str
                ) -> WrittenModel:
    """Write sound fits and the mass that they depend on into the model file ``target``.

    A new file starts from the car's model.toml, else from the paper's. Nothing is written if no
    fit is sound. Raises ConfigError, OSError.
    """
    start = find_model(target)[0] if target.exists() else files.model or find_model("paper")[0]
    mass = Quantity(outcome.mass.value, outcome.mass.std)
    start = msgspec.structs.replace(start, body={**start.body, "mass": mass})
    source = Source({str(run): hashlib.sha256(run.read_bytes()).hexdigest()}, command,
                    method="experiment", motor_voltage=outcome.motor_voltage)
    written = build_model(outcome.fits, start, source)
    write(written, target)
    return written
