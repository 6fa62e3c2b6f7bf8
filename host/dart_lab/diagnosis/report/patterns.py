"""Patterns without a cause: remaining residuals of the final model on the test recordings.

Text and picture show the same residual: 0.5 s ahead, the horizon of the search for structure, or
the reading of a sensor.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from dart_lab.diagnosis.result import Diagnosis, Unexplained
from dart_lab.diagnosis.unexplained.features import FEATURE_UNITS
from dart_lab.report.numbers import p_value, percent, significant

from .along import (
    PATTERN_TIME,
    Means,
    ResidualColumn,
    ResidualCurve,
    ResidualRows,
    compute_curve,
    list_columns,
)
from .compared import HORIZON
from .words import channel, error_figure, variable

RECORDING = "recording"
# Channel of the evaluation for each channel of a residual.
EVALUATED = {"v_x": "vx", "v_y": "vy", "omega": "yaw_rate"}
# What to do, by the variables of a pattern.
NEXT_STEPS = (
    (("x", "y"), "Check floor, slope and motion capture at this place, and drive through it in "
                 "both directions."),
    (("heading",), "Check slope and motion capture: drive the same straight in both directions."),
    (("steering_angle", "lateral_acceleration", "yaw_rate", "direction"),
     "Drive circles of several radii in both directions, each from low to high speed."),
    (("steering_rate",), "Drive steps of the steering at two speeds."),
    (("speed", "throttle", "acceleration"),
     "Drive steps of the throttle on a straight, and coast down from high speed."),
    (("revolution_angle", "way"), "Check ring and gear of the encoder."),
    ((RECORDING,), "Compare what differed between these recordings: battery, tyres, floor, car."),
    (("time",), "Repeat the same drive after a rest: battery, motor and tyres warm up."))


def next_step(u: Unexplained) -> str:
    """Return what to do about a pattern."""
    return " ".join(step for names, step in NEXT_STEPS if set(names) & set(u.along)) or (
        "Record more driving of this kind: the pattern follows no variable that is known here.")


class Pattern:
    """A pattern with the residual of the final model that shows it; found None: no picture."""

    def __init__(self, d: Diagnosis, u: Unexplained, rows: ResidualRows) -> None:
        self._d = d
        self.u = u
        self.column, self.found = self._residual(rows)
        self.names: tuple[str, ...] = ()
        if self.column is not None and RECORDING in u.along:
            names, means = rows.by_recording(self.column, d.stages[-1].residuals)
            if len(names) > 1:
                self.names = names
                self.found = ResidualCurve(self.column, RECORDING, means, means, 0.0)

    def _residual(self, rows: ResidualRows) -> tuple[ResidualColumn | None, ResidualCurve | None]:
        """The residual along the first variable that can be drawn."""
        candidates = list_columns(self._d.evidence, self.u.channel, (PATTERN_TIME,))
        for name in self.u.along:
            tried = [compute_curve(rows, column, name, self._d.stages[-1], period=self.u.period)
                     for column in candidates]
            found = [a for a in tried if a is not None]
            if found:
                best = max(found, key=lambda a: a.score)
                return best.column, best
        return (replace(candidates[0], folded=False), None) if candidates else (None, None)

    def sentences(self) -> dict[str, str]:
        """Describe the pattern: what it is, how much it matters, what to do."""
        u = self.u
        follows = " and ".join(map(variable, u.along)) or "no variable that is known here"
        share = f"{percent(u.share)} of the variance of" if math.isfinite(u.share) else "a part of"
        name = channel(u.channel)
        return {"What": f"{name[:1].upper()}{name[1:]}: {share} its error follows {follows} "
                        f"({p_value(u.p_value)}). {self._extremes()}",
                **({"Size": size} if (size := self._over_floor()) else {}),
                "Next": next_step(u)}

    def _extremes(self) -> str:
        """"On the test recordings: +0.073 m/s at place (x) 1.9 m, -0.056 m/s at -2.29 m"."""
        if self.found is None:
            return f"On the training recordings: {self.u.structure.rstrip('.')}."
        means = self.found.after
        unit = self.found.column.unit
        ends = [int(np.nanargmax(means.mean)), int(np.nanargmin(means.mean))]
        places = [f"{means.mean[i]:+.2g} {unit} {self._place(means, i)}" for i in ends]
        return (f"With the final model the {self.found.column.words} on the test recordings is "
                f"{' and '.join(places)} in the mean.")

    def _place(self, means: Means, i: int) -> str:
        assert self.found is not None
        if self.names:
            return f"in {self.names[i]}"
        unit = FEATURE_UNITS[self.found.variable]
        return (f"at {variable(self.found.variable)} {significant(float(means.x[i]), 2)}"
                f"{'' if unit == '-' else f' {unit}'}")

    def _over_floor(self) -> str:
        """"The speed error 1 s ahead is 6 % above the noise floor"; "" where it has none."""
        name = EVALUATED.get(self.u.channel, "")
        floor = self._d.noise_floor.get(name, math.nan)
        error = error_figure(self._d.stages[-1].horizons, HORIZON, name)
        if not (math.isfinite(error) and floor > 0.0):
            return ""
        above = round(100.0 * (error / floor - 1.0))
        where = f"{above} % above" if above > 0 else "not above"
        return (f"The {channel(name)} error 1 s ahead is {where} the noise floor "
                f"({significant(error)} against {significant(floor)}).")

    def caption(self) -> str:
        """Caption of the picture."""
        assert self.found is not None
        words = self.found.column.words[:1].upper() + self.found.column.words[1:]
        if self.names:
            numbered = ", ".join(f"{i + 1}: {name}" for i, name in enumerate(self.names))
            return f"{words} by test recording, final model ({numbered})"
        again = f", from 0 again every {self.u.period:.2f} m" if self.u.period else ""
        return (f"{words}, along {variable(self.found.variable)}{again}: final "
                "model, test recordings")


def describe_pattern(d: Diagnosis, u: Unexplained, rows: ResidualRows | None = None) -> str:
    """Return the sentences about a pattern."""
    return " ".join(Pattern(d, u, rows or ResidualRows(d.evidence,
                                                       d.extended)).sentences().values())
