"""Compare the files of a car with their previous versions in history/."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dart_hal.core.config.calibration import Calibration, parse_calibration
from dart_hal.core.config.model import MODEL_PARAMETERS, ModelFile, parse_model, plain
from dart_hal.core.config.quantity import Quantity
from dart_hal.core.config.write import version_number
from dart_hal.core.text_file import read_text


@dataclass(frozen=True, slots=True)
class ValueChange:
    """A number of a file, now and in the previous version; None: absent.

    z: difference / standard error of the difference, NaN without standard errors.
    """

    name: str
    before: float | None
    now: float | None
    z: float


def list_versions(path: Path) -> list[Path]:
    """Return the previous versions of a file of a car, the newest first."""
    found = (path.parent / "history").glob(f"{path.stem}-*{path.suffix}")
    return sorted((p for p in found if version_number(p)), key=version_number, reverse=True)


def calibration_changes(now: Calibration, folder: Path) -> list[ValueChange]:
    """Return the scalar quantities that changed. Raises ConfigError, OSError."""
    before = list_versions(folder / "calibration.toml")
    if not before:
        return []
    text = read_text(before[0])
    old = parse_calibration(text, str(before[0]), now.car)
    return _list_changes(_list_scalars(old.quantities()), _list_scalars(now.quantities()))


def model_changes(now: ModelFile, path: Path) -> list[ValueChange]:
    """Return the parameters that changed. Raises ConfigError, OSError."""
    before = list_versions(path)
    if not before:
        return []
    old = parse_model(read_text(before[0]), str(before[0]))
    return _list_changes(_list_parameters(old), _list_parameters(now))


def _list_changes(previous: Mapping[str, tuple[float, float]],
                  current: Mapping[str, tuple[float, float]]) -> list[ValueChange]:
    """Compare two tables of (value, standard error) by name."""
    out = []
    for name in sorted(previous.keys() | current.keys()):
        old = previous.get(name)
        new = current.get(name)
        if old is None or new is None:
            out.append(ValueChange(name, old and old[0], new and new[0], math.nan))
        elif old[0] != new[0]:
            spread = math.hypot(old[1], new[1])
            out.append(ValueChange(name, old[0], new[0],
                                   abs(new[0] - old[0]) / spread if spread > 0.0 else math.nan))
    return out


def _list_scalars(quantities: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    return {name: (float(q.value), float(q.std)) for name, q in quantities.items()
            if isinstance(q, Quantity)}


def _list_parameters(model: ModelFile) -> dict[str, tuple[float, float]]:
    """Return (value, standard error or 0) by "section.name", effects as "effect.parameter"."""
    tables = {section: getattr(model, section) for section in MODEL_PARAMETERS if section != "body"}
    tables |= {effect.name: effect.parameters for effect in model.effects}
    return {f"{table}.{key}": (plain(entry),
                               entry.std if isinstance(entry, Quantity) else 0.0)
            for table, entries in tables.items() for key, entry in entries.items()}
