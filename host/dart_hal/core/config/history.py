"""What of a car's files was different before: versions in history/, and what changed since."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dart_hal.core.config.calibration import Calibration, parse_calibration
from dart_hal.core.config.model import KNOWN, ModelFile, parse_model, plain
from dart_hal.core.config.quantity import Quantity
from dart_hal.core.config.write import number
from dart_hal.core.text_file import read_text


@dataclass(frozen=True, slots=True)
class Change:
    """A number of a file: as it is, and as it was in the version before; None: not in it.

    z: by how many of their common standard errors they differ, NaN where none is stated.
    """

    name: str
    before: float | None
    now: float | None
    z: float


def versions(path: Path) -> list[Path]:
    """Earlier versions of a file of a car, the newest first."""
    found = (path.parent / "history").glob(f"{path.stem}-*{path.suffix}")
    return sorted((p for p in found if number(p)), key=number, reverse=True)


def calibration_changes(now: Calibration, folder: Path) -> list[Change]:
    """Scalar quantities that differ from the version before. Errors: ConfigError, OSError."""
    before = versions(folder / "calibration.toml")
    if not before:
        return []
    text = read_text(before[0])
    old = parse_calibration(text, str(before[0]), now.car)
    return _changed(_scalars(old.quantities()), _scalars(now.quantities()))


def model_changes(now: ModelFile, path: Path) -> list[Change]:
    """Parameters that differ from the version before. Errors: ConfigError, OSError."""
    before = versions(path)
    if not before:
        return []
    old = parse_model(read_text(before[0]), str(before[0]))
    return _changed(_parameters(old), _parameters(now))


def _changed(before: Mapping[str, tuple[float, float]], now: Mapping[str, tuple[float, float]]
             ) -> list[Change]:
    out = []
    for name in sorted(before.keys() | now.keys()):
        old, new = before.get(name), now.get(name)
        if old is None or new is None:
            out.append(Change(name, old and old[0], new and new[0], math.nan))
        elif old[0] != new[0]:
            spread = math.hypot(old[1], new[1])
            out.append(Change(name, old[0], new[0],
                              abs(new[0] - old[0]) / spread if spread > 0.0 else math.nan))
    return out


def _scalars(quantities: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    return {name: (float(q.value), float(q.std)) for name, q in quantities.items()
            if isinstance(q, Quantity)}


def _parameters(model: ModelFile) -> dict[str, tuple[float, float]]:
    """(value, standard error or 0) by "section.name", effects as "effect.parameter"."""
    tables = {section: getattr(model, section) for section in KNOWN if section != "body"}
    tables |= {effect.name: effect.parameters for effect in model.effects}
    return {f"{table}.{key}": (plain(entry),
                               entry.std if isinstance(entry, Quantity) else 0.0)
            for table, entries in tables.items() for key, entry in entries.items()}
