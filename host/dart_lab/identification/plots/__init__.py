"""Pictures like the paper's: data, our fit, the paper's curve."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from dart_hal.core.figures import save_figure
from dart_lab.identification.fit import Fit

from .complete import completed, papers_form
from .evidence import Coasting, Driving, Evidence, Lagging, Slipping, StepResponse, Turning
from .from_recordings import evidence_of
from .lateral import draw_delay, draw_steering, draw_tyres
from .longitudinal import draw_friction, draw_motor, draw_step

__all__ = ["Coasting", "Driving", "Evidence", "Lagging", "Slipping", "StepResponse", "Turning",
           "completed", "draw", "evidence_of", "figures", "missing"]

DRAWN: dict[str, Callable[[Any, Fit], Any]] = {
    "friction": draw_friction, "motor": draw_motor, "steering": draw_steering,
    "tyres": draw_tyres, "delay": draw_delay}


def figures(evidence: Evidence, fits: Mapping[str, Fit]) -> dict[str, Any]:
    """By name, a picture of each sub-model that was fitted and has data, and the step response.

    fits with all parameters that a curve needs, see ``completed``.
    Errors: UsageError when matplotlib is missing.
    """
    drawn = {name: drawer(getattr(evidence, name), fits[name]) for name, drawer in DRAWN.items()
             if name in fits and not _why_not(evidence, name, fits[name])}
    longitudinal = [fits.get(name) for name in ("friction", "motor")]
    if evidence.step is not None and any(longitudinal):
        drawn["step_response"] = draw_step(evidence.step, *longitudinal)
    return drawn


def draw(drawn: Mapping[str, Any], folder: str | Path) -> list[Path]:
    """Every figure as a PNG in ``folder``, which is made."""
    return [save_figure(figure, Path(folder) / f"{name}.png") for name, figure in drawn.items()]


def missing(evidence: Evidence, fits: Mapping[str, Fit]) -> dict[str, str]:
    """Sub-models that were asked for and have no picture, with the reason."""
    reasons = {name: _why_not(evidence, name, fits[name]) for name in DRAWN if name in fits}
    return {name: why for name, why in reasons.items() if why}


def _why_not(evidence: Evidence, name: str, fit: Fit) -> str:
    """Empty where there is something to draw."""
    if name == "tyres" and not papers_form({name: fit}):
        return "these tyres have another form than the paper's"
    if getattr(evidence, name) is None:
        return "no usable stretch in these recordings"
    return "" if fit.n else "nothing of it was fitted"
