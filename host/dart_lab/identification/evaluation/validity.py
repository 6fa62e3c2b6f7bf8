"""Limit of the kinematic model, from the measured motion and from predictions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from dart_hal.vehicle.parameters import Vehicle

from .cases import Case
from .compare import MIN_BLOCKS
from .limit import MIN_RECORDINGS, ToleranceLimit, find_limits
from .noslip import MAX_NO_SLIP_SPEED
from .takeover import TAKEOVER_HORIZON, Takeover, find_takeover

RADII = (0.5, 1.0, 2.0)
TITLES = {"vy": "lateral velocity", "yaw_rate": "yaw rate", "position": "position"}


@dataclass(frozen=True, slots=True)
class KinematicLimit:
    """Limits of the kinematic model.

    slip, curvature: evidence without a model; takeover: one per channel and variable.
    """

    slip: ToleranceLimit
    curvature: ToleranceLimit
    takeover: tuple[Takeover, ...]
    model: str

    def to_json(self) -> dict[str, Any]:
        """Return the field ``kinematic_limit`` of ``dart-hal evaluate --json``."""
        takeover: dict[str, Any] = {"model": self.model, "horizon": TAKEOVER_HORIZON,
                                    "speed": "measured", "by": {}}
        for t in self.takeover:
            takeover["by"].setdefault(t.by, {})[t.channel] = t.to_json()
        return {"holds_to": {limit.by: {"value": limit.value, "ci95": [limit.low, limit.high],
                                        "unit": unit, "supported": limit.is_supported}
                             for limit, unit in ((self.slip, "m/s2"), (self.curvature, "m/s"))},
                "rear_slip": self.slip.to_json(), "curvature_loss": self.curvature.to_json(),
                "takeover": takeover, "statement": self.sentences()}

    def sentences(self) -> list[str]:
        """Return one sentence for each kind of evidence."""
        return [self._slip(), self._curvature(), self._takeover()]

    def _slip(self) -> str:
        limit = self.slip
        tolerance = f"{math.degrees(limit.tolerance):.0f} deg"
        if not math.isfinite(limit.value):
            return (f"rear slip: {_why_none(limit)} pass {tolerance}, "
                    "so no limit in lateral acceleration is stated")
        circles = ", ".join(f"{math.sqrt(limit.value * r):.1f} m/s at {r:g} m" for r in RADII)
        return (f"the rear axle slips by {tolerance} at {limit.value:.1f} m/s2 of lateral "
                f"acceleration {_interval(limit)}: on circles {circles} radius")

    def _curvature(self) -> str:
        limit = self.curvature
        tolerance = f"{limit.tolerance:.0%}"
        if not math.isfinite(limit.value):
            return (f"path curvature: {_why_none(limit)} lose {tolerance}, "
                    "so no limit in speed is stated")
        accel, speed = limit.spread()
        matters = "" if not math.isfinite(accel) else (
            f"; single recordings scatter by {speed:.0%} in speed and {accel:.0%} in lateral "
            "acceleration")
        return (f"at a held steering command the path is {tolerance} less curved at "
                f"{limit.value:.1f} m/s than below {MAX_NO_SLIP_SPEED} m/s {_interval(limit)}"
                f"{matters}")

    def _takeover(self) -> str:
        found = []
        none = []
        for t in self.takeover:
            unit = "m/s" if t.by == "speed" else "m/s2"
            if math.isfinite(t.taken_from):
                whole = t.taken_from == t.bins[0].low
                found.append(f"{TITLES[t.channel]} " + (
                    f"at any {t.by.replace('_', ' ')}" if whole else
                    f"from {t.taken_from:g} {unit}"))
            else:
                none.append(f"{TITLES[t.channel]} by {t.by.replace('_', ' ')}")
        head = f"{self.model}, at the measured speed: "
        if not found:
            return head + self._no_threshold()
        rest = f"; no threshold from these recordings: {', '.join(none)}" if none else ""
        return (f"{head}its dynamic form predicts better with 95 % confidence, all the way up, "
                f"in {', '.join(found)}{rest}")

    def _no_threshold(self) -> str:
        """Explain why no threshold is stated."""
        better = [b for t in self.takeover for b in t.bins if b.gain.low > 0.0]
        total = sum(len(t.bins) for t in self.takeover)
        if not better:
            return f"its dynamic form is better in none of {total} bins with 95 % confidence"
        top = [t.bins[-1].gain for t in self.takeover if any(b.gain.low > 0.0 for b in t.bins)]
        thin = sum(g.blocks < MIN_BLOCKS for g in top)
        why = (f"too few {top[0].unit} for an interval" if thin == len(top) else
               "the interval holds 0 as well" if not thin else
               f"the interval holds 0 as well, or there are too few {top[0].unit} for one")
        return (f"with 95 % confidence its dynamic form is better in {len(better)} of {total} bins "
                f"(shaded in the picture); above these {why}, so no threshold is stated")


def kinematic_limit(p: Vehicle, cases: Sequence[Case], seed: int = 0) -> KinematicLimit:
    """Find the limits from the motion, and where the dynamic form of ``p`` is better."""
    slip, curvature = find_limits(cases, p.body.l_r, seed)
    return KinematicLimit(slip, curvature, tuple(find_takeover(p, cases, seed)), p.name)


def _interval(limit: ToleranceLimit) -> str:
    if not limit.is_supported:
        return f"(no interval: {limit.recordings} recording(s), {MIN_RECORDINGS} needed)"
    high = f"{limit.high:.1f}" if math.isfinite(limit.high) else "no upper end"
    return f"(95 %: {limit.low:.1f} to {high}; {limit.recordings} recordings)"


def _why_none(limit: ToleranceLimit) -> str:
    if not limit.curves:
        return "no recording turns long enough over a range of speeds to"
    return f"{limit.recordings} recording(s) do not"
