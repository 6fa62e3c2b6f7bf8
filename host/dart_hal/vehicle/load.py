"""Models by name or file, for every verb that takes one.

The sets and effects are imported at the first use: a program that imports ``Car`` starts sooner.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from dart_hal.core.config import ModelFile, load_model
from dart_hal.core.errors import ConfigError, UsageError

if TYPE_CHECKING:
    from dart_hal.vehicle.parameters import Vehicle


def vehicle_of(model: ModelFile | None) -> Vehicle:
    """The vehicle of a model file; None, and what a file leaves out: the paper's.

    Raises ConfigError on a bad value.
    """
    from dart_hal.vehicle.file import vehicle_from
    from dart_hal.vehicle.sets import PAPER

    return PAPER if model is None else vehicle_from(model, PAPER)


def find_model(name: str | Path) -> tuple[ModelFile, Vehicle]:
    """A shipped set by its name, or a ``model.toml``.

    Raises UsageError for a name that is neither, ConfigError for a bad file.
    """
    from dart_hal.vehicle.file import model_of
    from dart_hal.vehicle.sets import SETS

    if str(name) in SETS:
        p = SETS[str(name)]
        return model_of(p), p
    path = Path(name)
    if not path.is_file():
        from difflib import get_close_matches

        close = get_close_matches(str(name), SETS, n=1)
        raise UsageError(f"no model is called {str(name)!r}",
                         found="no such file, and no shipped set of that name",
                         expected=f"a model.toml, or one of {', '.join(SETS)}",
                         remedy=f"write {close[0]}" if close else
                         "check the path; dart-hal identify all FILES --out model.toml writes one")
    model = load_model(path)
    try:
        return model, vehicle_of(model)
    except ConfigError as err:
        if err.read:
            raise
        raise ConfigError(f"{path}: {err.what}", found=err.found, expected=err.expected,
                          likely=err.likely, remedy=err.remedy, read=str(path)) from err
