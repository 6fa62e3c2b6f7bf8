"""The extended model as a ``model.toml``: refitted parameters, effects, where they come from."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from dart_hal import __version__
from dart_hal.config import EffectEntry, ModelFile, Quantity, plain, save_model
from dart_hal.config.model import Parameter
from dart_hal.recording.dart import Recording
from dart_hal.vehicle.file import model_of

from .result import Diagnosis


def write_model(d: Diagnosis, path: Path, base: ModelFile, train: Sequence[Recording],
                command: str = "") -> Path:
    """Save the extended model; an older file goes to history/. Errors: OSError."""
    return save_model(extended_model(d, base, train, command), path)


def extended_model(d: Diagnosis, base: ModelFile, train: Sequence[Recording],
                   command: str = "") -> ModelFile:
    """The file of ``d.extended`` and how its IMU sits.

    Standard errors are of what was fitted here, the base's of the rest.

    Covariances of parameters that have moved are left out: they held around
    the old values.
    """
    model = model_of(d.extended, base)
    named = {f"{c.effect}.{k}": n.std for c in d.causes for k, n in c.parameters.items()}
    stds = {**{name: m.std for name, m in d.refitted.items()}, **named}
    effects = tuple(EffectEntry(e.name, _with(e.name, e.parameters, stds))
                    for e in model.effects)
    effects += tuple(EffectEntry(name, {k: _entry(n.value, n.std) for k, n in numbers.items()})
                     for name, numbers in d.mounting.items())
    sections: dict[str, Any] = {}
    for name, moved in d.refitted.items():
        section, _, key = name.partition(".")
        if key in getattr(model, section, {}):
            table = sections.setdefault(section, dict(getattr(model, section)))
            table[key] = _entry(plain(table[key]), moved.std)
    covariance = {key: table for key, table in base.covariance.items()
                  if not set(table.names) & set(d.refitted)}
    return msgspec.structs.replace(
        model, name=f"{base.name}-extended" if d.causes or d.refitted else base.name,
        effects=effects, covariance=covariance, speed_loop=base.speed_loop,
        provenance=_provenance(d, base, train, command), **sections)


def _provenance(d: Diagnosis, base: ModelFile, train: Sequence[Recording],
                command: str) -> dict[str, Any]:
    fitted = d.causes or d.refitted
    files = {r.name: r.sha256 for r in train} if fitted else {}
    return {**base.provenance, "dart_hal": __version__, "command": command, "base": d.model,
            "method": "diagnosis", "verdict": d.verdict, "seed": d.seed,
            "causes": [c.effect for c in d.causes],
            "files": {**base.provenance.get("files", {}), **files}}


def _with(effect: str, parameters: Mapping[str, Parameter], stds: Mapping[str, float]
          ) -> dict[str, Parameter]:
    names = {key: f"{effect}.{key}" for key in parameters}
    return {key: _entry(plain(entry), stds[names[key]]) if names[key] in stds else entry
            for key, entry in parameters.items()}


def _entry(value: float, std: float) -> Parameter:
    return Quantity(value, std) if math.isfinite(std) and std >= 0.0 else value
