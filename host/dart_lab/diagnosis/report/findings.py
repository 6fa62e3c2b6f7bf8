"""Findings in one line each: name, size with its error, share, status."""

from __future__ import annotations

import math
from dataclasses import dataclass

from dart_lab.diagnosis.result import Cause, Claim, Diagnosis, Possible, QuantityChange
from dart_lab.report.numbers import percent

from .explain import is_small, is_small_change
from .physical import main_size
from .words import channel, describe_share, quantity_change, short_title


@dataclass(frozen=True, slots=True)
class FindingLine:
    """One line.

    share: what it removes of an error, or by what it raises it. status: accepted, substitute,
    possible, ... anchor: of its evidence on the page.
    """

    name: str
    size: str
    share: str
    status: str
    anchor: str

    @property
    def line(self) -> str:
        """The finding for the terminal."""
        return f"{self.status}: {'; '.join(filter(None, (self.name, self.size, self.share)))}"


def list_findings(d: Diagnosis) -> list[FindingLine]:
    """List wrong parameters, causes, small corrections, then candidates that were not accepted."""
    wrong, small = ([_describe_claim(c) for c in d.claims if is_small(c) == kind]
                    for kind in (False, True))
    return [*wrong, *(_describe_cause(c, i) for i, c in enumerate(d.causes)), *small,
            *map(_describe_possible, d.possible)]


def _describe_cause(cause: Cause, i: int) -> FindingLine:
    gain = cause.gain
    share = _describe_share(gain.test, gain.low, gain.high, channel(gain.channel))
    status = "accepted" if cause.constancy.constant else "substitute"
    return FindingLine(f"{short_title(cause)} ({cause.effect})", main_size(cause), share, status,
                       f"cause-{i + 1}")


def _describe_claim(claim: Claim) -> FindingLine:
    size = ""
    if claim.quantities:
        # The quantity that moved most, by its standard errors, among those that moved by much.
        name = max(claim.quantities, key=lambda key: _significance(claim.quantities[key]))
        size = f"{name} {quantity_change(claim.quantities[name])}"
    gain, low, high = (1.0 - 1.0 / value for value in claim.cost)
    share = _describe_share(gain, low, high, "motion")
    return FindingLine(claim.title, size, share,
                       "small correction" if is_small(claim) else "wrong parameter", "claims")


def _describe_share(gain: float, low: float, high: float, error: str) -> str:
    """Return what a finding changes of an error, with its interval; "" if it is not known."""
    if not math.isfinite(gain):
        return ""
    return describe_share(gain, low, high, error, _format_limits)


def _format_limits(low: float, high: float) -> str:
    return f" ({percent(low)} to {percent(high)})" if math.isfinite(low + high) else ""


def _significance(q: QuantityChange) -> tuple[bool, float]:
    """Return whether a quantity moved by much, and by how many standard errors."""
    return not is_small_change(q), abs(q.after - q.before) / max(q.std, 1e-12)


def _describe_possible(p: Possible) -> FindingLine:
    return FindingLine(f"{short_title(p)} ({p.effect}), probability {p.probability:.2f}", "", "",
                       p.grade, "rejected")
