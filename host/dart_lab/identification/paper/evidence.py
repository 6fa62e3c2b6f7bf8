"""Arrays for the pictures of a fit with the paper's preprocessing."""

from __future__ import annotations

from typing import Any

import numpy as np

from dart_lab.identification.plots import (
    CoastingData,
    DelayData,
    MotorData,
    PlotData,
    SteeringData,
    StepResponse,
    TyreData,
)

from .delay import Correlation
from .folders import JoinedRows
from .problems import motion
from .run import AsPaper

# [s] Length of the drawn step response.
STEP_LENGTH = 12.0


def collect_paper_data(made: AsPaper) -> PlotData:
    """Collect the fitted rows, and one step response of the motor's folder."""
    found: dict[str, Any] = {}
    problems = made.problems
    if "friction" in problems:
        found["friction"] = CoastingData(problems["friction"].inputs[0],
                                         problems["friction"].target)
    if "motor" in problems:
        throttle, v = problems["motor"].inputs
        found["motor"] = MotorData(throttle, v, problems["motor"].target)
    if "steering" in problems:
        found["steering"] = SteeringData(problems["steering"].inputs[0],
                                         problems["steering"].target)
    if "tyres_front" in problems:
        front, rear = problems["tyres_front"], problems["tyres_rear"]
        found["tyres"] = TyreData(front.inputs[0], front.target, rear.inputs[0], rear.target)
    if made.correlation is not None:
        found["delay"] = _delay_data(made.correlation)
    rows = made.rows.get("motor") or made.rows.get("friction")
    if rows is not None:
        found["step"] = _find_step(rows)
    return PlotData(**found)


def _delay_data(c: Correlation) -> DelayData:
    return DelayData(c.median_step * np.arange(len(c.value), dtype=np.float64), c.value, (
        (c.lag * c.median_step, "best lag x median step"),
        (c.delay, "as the paper: best lag x mean step"),
        (c.peak * c.median_step, "parabola through the peak")))


def _find_step(rows: JoinedRows) -> StepResponse:
    """Cut the step response around the highest speed of the fastest file."""
    v, force = motion(rows)
    file, (first, end) = max(rows.spans.items(), key=lambda item: float(v[slice(*item[1])].max()))
    top = first + int(np.argmax(v[first:end]))
    use = slice(max(first, int(np.searchsorted(rows.t, rows.t[top] - 0.5 * STEP_LENGTH))),
                min(end, int(np.searchsorted(rows.t, rows.t[top] + 0.5 * STEP_LENGTH))))
    name = file.replace("\\", "/").rpartition("/")[2]
    return StepResponse(rows.t[use] - rows.t[use][0], rows.throttle[use], v[use], force[use], name)
