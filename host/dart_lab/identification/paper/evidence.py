"""The arrays of the pictures out of a fit made the paper's way."""

from __future__ import annotations

from typing import Any

import numpy as np

from dart_lab.identification.plots import (
    Coasting,
    Driving,
    Evidence,
    Lagging,
    Slipping,
    StepResponse,
    Turning,
)

from .delay import Correlation
from .folders import JoinedRows
from .problems import motion
from .run import AsPaper

STRETCH = 12.0  # s


def evidence_as_paper(made: AsPaper) -> Evidence:
    """The very rows that were fitted, and one step response of the motor's folder."""
    found: dict[str, Any] = {}
    problems = made.problems
    if "friction" in problems:
        found["friction"] = Coasting(problems["friction"].inputs[0], problems["friction"].target)
    if "motor" in problems:
        throttle, v = problems["motor"].inputs
        found["motor"] = Driving(throttle, v, problems["motor"].target)
    if "steering" in problems:
        found["steering"] = Turning(problems["steering"].inputs[0], problems["steering"].target)
    if "tyres_front" in problems:
        front, rear = problems["tyres_front"], problems["tyres_rear"]
        found["tyres"] = Slipping(front.inputs[0], front.target, rear.inputs[0], rear.target)
    if made.correlation is not None:
        found["delay"] = _lagging(made.correlation)
    rows = made.rows.get("motor") or made.rows.get("friction")
    if rows is not None:
        found["step"] = _step(rows)
    return Evidence(**found)


def _lagging(c: Correlation) -> Lagging:
    return Lagging(c.median_step * np.arange(len(c.value), dtype=np.float64), c.value, (
        (c.lag * c.median_step, "best lag x median step"),
        (c.delay, "the paper's way, best lag x mean step"),
        (c.peak * c.median_step, "parabola through the peak")))


def _step(rows: JoinedRows) -> StepResponse:
    """Around the longest push of the fastest file."""
    v, force = motion(rows)
    file, (first, end) = max(rows.spans.items(), key=lambda item: float(v[slice(*item[1])].max()))
    top = first + int(np.argmax(v[first:end]))
    use = slice(max(first, int(np.searchsorted(rows.t, rows.t[top] - 0.5 * STRETCH))),
                min(end, int(np.searchsorted(rows.t, rows.t[top] + 0.5 * STRETCH))))
    name = file.replace("\\", "/").rpartition("/")[2]
    return StepResponse(rows.t[use] - rows.t[use][0], rows.throttle[use], v[use], force[use], name)
