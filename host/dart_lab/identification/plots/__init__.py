"""Pictures like the paper's: data, fitted curve, the paper's curve."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from dart_hal.core.figures import save_figure
from dart_lab.identification.fit import SubmodelFit

from .complete import complete_fits, has_paper_form
from .evidence import (
    CoastingData,
    DelayData,
    MotorData,
    PlotData,
    SteeringData,
    StepResponse,
    TyreData,
)
from .from_recordings import collect_data
from .lateral import draw_delay, draw_steering, draw_tyres
from .longitudinal import draw_friction, draw_motor, draw_step

__all__ = [
    "CoastingData",
    "DelayData",
    "MotorData",
    "PlotData",
    "SteeringData",
    "StepResponse",
    "TyreData",
    "collect_data",
    "complete_fits",
    "draw",
    "figures",
    "why_missing",
]

DRAWERS: dict[str, Callable[[Any, SubmodelFit], Any]] = {
    "friction": draw_friction, "motor": draw_motor, "steering": draw_steering,
    "tyres": draw_tyres, "delay": draw_delay}


def figures(evidence: PlotData, fits: Mapping[str, SubmodelFit]) -> dict[str, Any]:
    """Draw each sub-model that was fitted and has data, and the step response, by name.

    fits with all parameters that a curve needs, see ``complete_fits``.
    Errors: UsageError when matplotlib is missing.
    """
    drawn = {name: drawer(getattr(evidence, name), fits[name]) for name, drawer in DRAWERS.items()
             if name in fits and not _why_not(evidence, name, fits[name])}
    longitudinal = [fits.get(name) for name in ("friction", "motor")]
    if evidence.step is not None and any(longitudinal):
        drawn["step_response"] = draw_step(evidence.step, *longitudinal)
    return drawn


def draw(drawn: Mapping[str, Any], folder: str | Path) -> list[Path]:
    """Save every figure as a PNG in ``folder``, which is created."""
    return [save_figure(figure, Path(folder) / f"{name}.png") for name, figure in drawn.items()]


def why_missing(evidence: PlotData, fits: Mapping[str, SubmodelFit]) -> dict[str, str]:
    """Return the requested sub-models without a picture, with the reason."""
    reasons = {name: _why_not(evidence, name, fits[name]) for name in DRAWERS if name in fits}
    return {name: why for name, why in reasons.items() if why}


def _why_not(evidence: PlotData, name: str, fit: SubmodelFit) -> str:
    """Return why a sub-model has no picture; empty if it has one."""
    if name == "tyres" and not has_paper_form({name: fit}):
        return "these tyres have another form than the paper's"
    if getattr(evidence, name) is None:
        return "no usable stretch in these recordings"
    return "" if fit.n else "nothing of it was fitted"
