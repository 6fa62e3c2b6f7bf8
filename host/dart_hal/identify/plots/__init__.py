"""Pictures like the paper's: data, our fit, the paper's curve."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from dart_hal.identify.fit import Fit

from . import style
from .evidence import Coasting, Driving, Evidence, Lagging, Slipping, StepResponse, Turning
from .from_paper import evidence_as_paper
from .from_recordings import evidence_of
from .lateral import draw_delay, draw_steering, draw_tyres
from .longitudinal import draw_friction, draw_motor, draw_step

__all__ = ["Coasting", "Driving", "Evidence", "Lagging", "Slipping", "StepResponse", "Turning",
           "draw", "evidence_as_paper", "evidence_of"]

DRAWN: dict[str, Callable[[Any, Fit], Any]] = {
    "friction": draw_friction, "motor": draw_motor, "steering": draw_steering,
    "tyres": draw_tyres, "delay": draw_delay}


def draw(evidence: Evidence, fits: Mapping[str, Fit], folder: str | Path) -> list[Path]:
    """One PNG per sub-model that was fitted and has data, and the step response.

    Errors: UsageError when matplotlib is missing.
    """
    folder = Path(folder)
    pictures: list[Path] = []
    for name, drawer in DRAWN.items():
        data: Any = getattr(evidence, name)
        if data is not None and name in fits and fits[name].n:
            pictures.append(style.save(drawer(data, fits[name]), folder, name))
    longitudinal = [fits.get(name) for name in ("friction", "motor")]
    if evidence.step is not None and any(longitudinal):
        figure = draw_step(evidence.step, *longitudinal)
        pictures.append(style.save(figure, folder, "step_response"))
    return pictures
