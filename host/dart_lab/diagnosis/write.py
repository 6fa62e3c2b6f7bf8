"""Write the extended model as a ``model.toml``: parameters, effects and their provenance."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from dart_hal import __version__
from dart_hal.core.config import EffectEntry, ModelFile, Quantity, plain, save_model
from dart_hal.core.config.model import Covariance, Parameter, list_parameters
from dart_hal.recording.dart import Recording
from dart_hal.vehicle.file import model_of
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.battery import FADE, find_mean_voltage
from dart_lab.identification.write import round_covariance

from .frames import FRAME_EFFECTS
from .result import Diagnosis
from .servo import TYRE_CAUTION

# Name of the covariance of the refitted parameters in the file.
DIAGNOSED = "diagnosis"


def write_model(d: Diagnosis, path: Path, base: ModelFile, train: Sequence[Recording],
                command: str = "") -> Path:
    """Save the extended model; an older file goes to history/. Errors: OSError."""
    return save_model(extended_model(d, base, train, command), path)


def write_predictor(d: Diagnosis, path: Path, base: ModelFile, train: Sequence[Recording],
                    command: str = "") -> Path:
    """Save the best predictor; an older file goes to history/.

    Errors: OSError; ValueError for a diagnosis without one.
    """
    return save_model(predictor_model(d, base, train, command), path)


def extended_model(d: Diagnosis, base: ModelFile, train: Sequence[Recording],
                   command: str = "") -> ModelFile:
    """Return the file of ``d.extended``, with the mounting of the IMU.

    Parameters that were not fitted keep the standard errors of the base. The covariance of the
    fitted ones replaces those in the base, which were valid around the old values.
    """
    fitted = bool(d.causes or d.refitted)
    stds = {name: m.std for name, m in d.refitted.items()}
    stds |= {f"{c.effect}.{k}": n.std for c in d.causes for k, n in c.parameters.items()}
    stds |= {f"{e}.{k}": n.std for e, numbers in d.mounting.items() for k, n in numbers.items()}
    provenance = {"method": "diagnosis", "verdict": d.verdict,
                  "causes": [c.effect for c in d.causes],
                  **({"caution": TYRE_CAUTION} if TYRE_CAUTION in d.notes else {})}
    model = _model(d, d.extended, base, train, "extended" if fitted else "", stds,
                   _provenance(d, base, train if fitted else (), command, provenance))
    if d.correlation is None:
        return model
    names, correlation = d.correlation
    # Offsets of a fitted marker frame are no part of the car, and not in its file.
    kept = [i for i, name in enumerate(names) if name in list_parameters(model)]
    std = np.array([stds[names[i]] for i in kept])
    together = Covariance(tuple(names[i] for i in kept),
                          round_covariance(correlation[np.ix_(kept, kept)] * np.outer(std, std)))
    return msgspec.structs.replace(model, covariance={**model.covariance, DIAGNOSED: together})


def predictor_model(d: Diagnosis, base: ModelFile, train: Sequence[Recording],
                    command: str = "") -> ModelFile:
    """Return the file of ``d.predictor``, as ``extended_model``.

    Raises ValueError for a diagnosis without one.
    """
    if d.predictor is None:
        raise ValueError("this diagnosis has no predictor: diagnose(..., predictor=True)")
    stds = {name: n.std for name, n in d.predictor.parameters.items()}
    stds |= {f"{e}.{k}": n.std for e, numbers in d.predictor.effects.items()
             for k, n in numbers.items()}
    ratio, low, high = d.predictor.ratio
    provenance = {"method": "best predictor", "effects": list(d.predictor.effects),
                  "error_of_refit": {"ratio": ratio, "ci90": [low, high]}}
    return _model(d, d.predictor.vehicle, base, train, "predictor", stds,
                  _provenance(d, base, train, command, provenance))


def _model(d: Diagnosis, vehicle: Vehicle, base: ModelFile, train: Sequence[Recording], kind: str,
           stds: Mapping[str, float], provenance: Mapping[str, Any]) -> ModelFile:
    """Return the file of a vehicle; kind: suffix of the name; stds: of fitted parameters."""
    model = model_of(vehicle, base)
    # an offset of the fitted marker frame belongs to these recordings, and not to the car
    keep = {*(c.effect for c in d.causes), *(e.name for e in base.effects)}
    effects = tuple(EffectEntry(e.name, _add_errors(e.name, e.parameters, stds))
                    for e in model.effects if e.name not in FRAME_EFFECTS or e.name in keep)
    has = {e.name for e in effects}
    effects += tuple(EffectEntry(name, {k: _entry(n.value, n.std) for k, n in numbers.items()})
                     for name, numbers in d.mounting.items() if name not in has)
    sections: dict[str, Any] = {}
    # A fitted motor holds at the voltage of its recordings, with battery_fade at the reference.
    fitted = {name.partition(".")[0] for name in stds}
    volt = (model.motor_voltage if FADE in has
            else find_mean_voltage(train) if "motor" in fitted else base.motor_voltage)
    for name, std in stds.items():
        section, _, key = name.partition(".")
        if key in getattr(model, section, {}):
            table = sections.setdefault(section, dict(getattr(model, section)))
            table[key] = _entry(plain(table[key]), std)
    covariance = {key: table for key, table in base.covariance.items()
                  if not set(table.names) & set(stds)}
    return msgspec.structs.replace(
        model, name=f"{base.name}-{kind}" if kind else base.name, motor_voltage=volt,
        effects=effects, covariance=covariance, speed_loop=base.speed_loop,
        provenance=dict(provenance), **sections)


def _provenance(d: Diagnosis, base: ModelFile, train: Sequence[Recording], command: str,
                own: Mapping[str, Any]) -> dict[str, Any]:
    files = {r.name: r.sha256 for r in train}
    return {**base.provenance, "dart_hal": __version__, "command": command, "base": d.model,
            "seed": d.seed, **own, "files": {**base.provenance.get("files", {}), **files}}


def _add_errors(effect: str, parameters: Mapping[str, Parameter], stds: Mapping[str, float]
          ) -> dict[str, Parameter]:
    names = {key: f"{effect}.{key}" for key in parameters}
    return {key: _entry(plain(entry), stds[names[key]]) if names[key] in stds else entry
            for key, entry in parameters.items()}


def _entry(value: float, std: float) -> Parameter:
    return Quantity(value, std) if math.isfinite(std) and std >= 0.0 else value
