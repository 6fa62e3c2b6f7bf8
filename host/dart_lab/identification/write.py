"""``model.toml`` from fits: sound fits replace sections of the base model.

A fit that did not converge, or stopped at a bound, never replaces a value.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from dart_hal import __version__
from dart_hal.core.config import ModelFile, Quantity, save_model
from dart_hal.core.config.model import MODEL_PARAMETERS, Covariance, Parameter
from dart_hal.core.errors import ConfigError
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Recording
from dart_hal.vehicle.load import vehicle_of
from dart_lab.identification.battery import FADE
from dart_lab.identification.fit import SubmodelFit

# Fits that are sections of the file. Others (rows of a comparison) are not written.
SECTIONS = ("friction", "motor", "steering", "delay", "tyres")


@dataclass(frozen=True, slots=True)
class Source:
    """Origin of the fits, for the file's provenance.

    sha256: of every file used; reference: (L_x [m], theta [rad], L_y [m]) of the mocap marker by
    file; command: as typed; method: of the fits; motor_voltage [V]: of the battery in the files,
    None if it is not measured in all; prior: (value, standard error if any) of what a joint fit has
    fitted, in the base. Sections of the base that are not replaced keep their entry, and the hashes
    of their files.
    """

    sha256: Mapping[str, str]
    command: str = ""
    reference: Mapping[str, tuple[float, float, float]] | None = None
    method: str = "per recording"
    motor_voltage: float | None = None
    prior: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def table(self, base: ModelFile, written: Sequence[str]) -> dict[str, Any]:
        """Return the section "provenance"."""
        before = base.provenance
        made = {section: {"method": self.method, "command": self.command} for section in written}
        sections = {**before.get("sections", {}), **made}
        kept = before.get("files", {}) if set(sections) - set(written) else {}
        table: dict[str, Any] = {
            "dart_hal": __version__, "command": self.command, "base": base.name,
            "files": {**kept, **self.sha256}, "sections": sections}
        if "sizes" in before:
            table["sizes"] = before["sizes"]
        if self.prior:
            table["prior"] = {name: list(pair) for name, pair in self.prior.items()}
        if self.reference:
            table["reference"] = {file: list(point) for file, point in self.reference.items()}
        return table


@dataclass(frozen=True, slots=True)
class WrittenModel:
    """Model to be written, None if no fit is sound; sections: those that were replaced.

    left_out: sections that keep the base's values, with the reason.
    """

    model: ModelFile | None
    sections: tuple[str, ...]
    left_out: Mapping[str, str]


def was_fitted_to(model: ModelFile, recordings: Iterable[Recording]) -> bool:
    """Return whether a model was fitted to any of these recordings.

    Its standard errors are then no prior of another fit to them: the data would count twice.
    """
    known = set(model.provenance.get("files", {}).values())
    return any(r.sha256 in known for r in recordings)


def why_unsound(fit: SubmodelFit) -> str:
    """Return why a fit is not sound, in one sentence; empty for a sound fit."""
    if not fit.converged:
        return "not identified" if fit.n == 0 else "the fit did not converge"
    if fit.at_bound:
        return f"{', '.join(fit.at_bound)} stopped at the edge of the allowed interval"
    return ""


def build_model(fits: Mapping[str, SubmodelFit], base: ModelFile, source: Source, *,
                name: str = "identified", joint: Covariance | None = None) -> WrittenModel:
    """Insert every sound sub-model into the base, with its errors and its covariance.

    joint: covariance of parameters that were fitted together, across sections ("friction.a",
    ...); it replaces those of the single sections. A joint fit is written as a whole or not at
    all, because each section is only valid with the others.
    """
    if joint is not None and not any(fit.identifies_any for fit in fits.values()):
        return WrittenModel(None, (), dict.fromkeys(
            fits, "these recordings identify none of the parameters"))
    unsound = {name: why for name, fit in fits.items() if (why := why_unsound(fit))}
    if joint is not None and unsound:
        reasons = "; ".join(f"{name}: {why}" for name, why in unsound.items())
        return WrittenModel(None, (), dict.fromkeys(fits, f"one of a joint fit ({reasons})"))
    model = base
    sections = list[str]()
    left_out = {}
    for section in SECTIONS:
        if section not in fits:
            continue
        why = why_unsound(fits[section])
        if not why:
            candidate = _insert_fit(model, section, fits[section])
            try:
                vehicle_of(candidate)
            except ConfigError as err:
                why = err.what
            else:
                model = candidate
                sections.append(section)
        if why:
            left_out[section] = why
    if not sections:
        return WrittenModel(None, (), left_out)
    if joint is not None:
        separate = {key: table for key, table in model.covariance.items()
                    if not set(table.names) & set(joint.names)}
        model = msgspec.structs.replace(model, covariance={**separate, "joint": joint})
    # A fitted motor holds at the voltage of its files. battery_fade of the base keeps its law.
    volt = (source.motor_voltage if "motor" in sections and all(
        e.name != FADE for e in base.effects) else base.motor_voltage)
    model = msgspec.structs.replace(model, name=name, motor_voltage=volt,
                                    provenance=source.table(base, sections))
    return WrittenModel(model, tuple(sections), left_out)


def write(written: WrittenModel, path: Path) -> Path | None:
    """Save the model and move the old file to history/; None if there is nothing to write."""
    return None if written.model is None else save_model(written.model, path)


def _insert_fit(model: ModelFile, section: str, fit: SubmodelFit) -> ModelFile:
    entries = {key: _entry(e.value, e.std) for key, e in fit.parameters.items()
               if key in MODEL_PARAMETERS[section]}
    other_tyres = section == "tyres" and ("rear_D" in model.tyres) != ("rear_D" in entries)
    other_motor = section == "motor" and ("gain" in model.motor) != ("gain" in entries)
    kept = {} if other_tyres or other_motor else dict(getattr(model, section))
    changes: dict[str, Any] = {section: kept | entries}
    if other_tyres:
        # The form of the slip angles belonged to the replaced tyres.
        changes["forms"] = {k: v for k, v in model.forms.items() if k != "slip"}
    if other_motor:
        changes["forms"] = {**model.forms, "motor": "speed" if "gain" in entries else "duty"}
    covariance = {key: table for key, table in model.covariance.items()
                  if not any(name.startswith(f"{section}.") for name in table.names)}
    if np.all(np.isfinite(fit.covariance)):
        names = tuple(f"{section}.{key}" for key in fit.parameters)
        rows = round_covariance(fit.covariance)
        covariance[section] = Covariance(names, rows)
    return msgspec.structs.replace(model, covariance=covariance, **changes)


def round_covariance(matrix: FloatArray) -> tuple[tuple[float, ...], ...]:
    """Round a covariance to six digits for the file."""
    return tuple(tuple(float(f"{v:.6g}") for v in row) for row in matrix.tolist())


def _entry(value: float, std: float) -> Parameter:
    return Quantity(value, std) if math.isfinite(std) else value
