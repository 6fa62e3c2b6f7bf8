"""``model.toml`` out of fits: what is sound is written, the rest stays as it was.

A fit that did not converge, or stopped at a bound, never replaces a value:
its section keeps what the base model has.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from dart_hal import __version__
from dart_hal.core.config import ModelFile, Quantity, save_model
from dart_hal.core.config.model import MODEL_PARAMETERS, Covariance, Parameter
from dart_hal.core.errors import ConfigError
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.load import vehicle_of
from dart_lab.identification.fit import Fit

SECTIONS = ("friction", "motor", "steering", "delay", "tyres")
"""Fits that are sections of the file; others (rows of a comparison) are not written."""


@dataclass(frozen=True, slots=True)
class Source:
    """Where the numbers come from, for the file's provenance.

    sha256 by file, of every file used; reference: by file (L_x m, theta rad,
    L_y m) of the mocap marker, where one was used; command: as typed; method:
    how the fits were made. Sections of the base that this run leaves alone
    keep their entry, and the hashes of their files.
    """

    sha256: Mapping[str, str]
    command: str = ""
    reference: Mapping[str, tuple[float, float, float]] | None = None
    method: str = "per recording"

    def table(self, base: ModelFile, written: Sequence[str]) -> dict[str, Any]:
        """The section "provenance"."""
        before = base.provenance
        made = {section: {"method": self.method, "command": self.command} for section in written}
        sections = {**before.get("sections", {}), **made}
        kept = before.get("files", {}) if set(sections) - set(written) else {}
        table: dict[str, Any] = {
            "dart_hal": __version__, "command": self.command, "base": base.name,
            "files": {**kept, **self.sha256}, "sections": sections}
        if "sizes" in before:
            table["sizes"] = before["sizes"]
        if self.reference:
            table["reference"] = {file: list(point) for file, point in self.reference.items()}
        return table


@dataclass(frozen=True, slots=True)
class Written:
    """model: None when no fit is sound; sections: those that were identified.

    left_out: sections that keep the base's values, with the reason.
    """

    model: ModelFile | None
    sections: tuple[str, ...]
    left_out: Mapping[str, str]


def why_unsound(fit: Fit) -> str:
    """One sentence; empty for a sound fit."""
    if not fit.converged:
        return "not identified" if fit.n == 0 else "the fit did not converge"
    if fit.at_bound:
        return f"{', '.join(fit.at_bound)} stopped at the edge of the allowed interval"
    return ""


def model_from(fits: Mapping[str, Fit], base: ModelFile, source: Source, *,
               name: str = "identified", joint: Covariance | None = None) -> Written:
    """The base with every sound sub-model in it, its errors and its covariance.

    joint: covariance of parameters that were fitted together, across sections
    ("friction.a", ...); it takes the place of those of the single sections.
    Such a fit is written whole or not at all: each section holds given the others.
    """
    unsound = {name: why for name, fit in fits.items() if (why := why_unsound(fit))}
    if joint is not None and unsound:
        said = "; ".join(f"{name}: {why}" for name, why in unsound.items())
        return Written(None, (), dict.fromkeys(fits, f"one of a joint fit ({said})"))
    model, sections, left_out = base, list[str](), {}
    for section in SECTIONS:
        if section not in fits:
            continue
        why = why_unsound(fits[section])
        if not why:
            candidate = _with(model, section, fits[section])
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
        return Written(None, (), left_out)
    if joint is not None:
        apart = {key: table for key, table in model.covariance.items()
                 if not set(table.names) & set(joint.names)}
        model = msgspec.structs.replace(model, covariance={**apart, "joint": joint})
    model = msgspec.structs.replace(model, name=name, provenance=source.table(base, sections))
    return Written(model, tuple(sections), left_out)


def write(written: Written, path: Path) -> Path | None:
    """Save the model; the old file goes to history/. None: nothing sound, nothing touched."""
    return None if written.model is None else save_model(written.model, path)


def _with(model: ModelFile, section: str, fit: Fit) -> ModelFile:
    entries = {key: _entry(e.value, e.std) for key, e in fit.parameters.items()
               if key in MODEL_PARAMETERS[section]}
    other_form = section == "tyres" and ("rear_D" in model.tyres) != ("rear_D" in entries)
    kept = {} if other_form else dict(getattr(model, section))
    changes: dict[str, Any] = {section: kept | entries}
    if other_form:  # its slip angles belonged to its tyres
        changes["forms"] = {k: v for k, v in model.forms.items() if k != "slip"}
    covariance = {key: table for key, table in model.covariance.items()
                  if not any(name.startswith(f"{section}.") for name in table.names)}
    if np.all(np.isfinite(fit.covariance)):
        names = tuple(f"{section}.{key}" for key in fit.parameters)
        rows = rounded(fit.covariance)
        covariance[section] = Covariance(names, rows)
    return msgspec.structs.replace(model, covariance=covariance, **changes)


def rounded(matrix: FloatArray) -> tuple[tuple[float, ...], ...]:
    """A covariance as a file holds it: six digits of a standard error are plenty."""
    return tuple(tuple(float(f"{v:.6g}") for v in row) for row in matrix.tolist())


def _entry(value: float, std: float) -> Parameter:
    return Quantity(value, std) if math.isfinite(std) else value
