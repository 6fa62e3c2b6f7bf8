"""A diagnosis in sentences, the same in the terminal and on the page."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from dart_hal.diagnose.error_summaries import Excess, LateCommands, Outliers
from dart_hal.diagnose.result import (
    BestPredictor,
    Change,
    Cost,
    Diagnosis,
    Gained,
    Moved,
    Number,
    Possible,
    Unexplained,
)
from dart_hal.report.numbers import listed, p_value, percent, significant, with_error
from dart_hal.vehicle.effects import catalogue

CHANNELS = {
    "vx": ("speed", "m/s"), "vy": ("lateral velocity", "m/s"), "yaw_rate": ("yaw rate", "rad/s"),
    "position": ("position", "m"), "yaw_deg": ("yaw angle", "deg"),
    "v_x": ("speed", "m/s"), "v_y": ("lateral velocity", "m/s"), "omega": ("yaw rate", "rad/s"),
    "encoder": ("encoder", "m/s"), "gyro": ("gyro", "rad/s"),
    "accel_x": ("longitudinal accelerometer", "m/s2"),
    "accel_y": ("lateral accelerometer", "m/s2")}
"""Name and unit of every channel that an error is stated in."""
HORIZONS = ("0.5", "1.0", "2.0")
UNIT_WORDS = {"": "", "-": "", "relative": " (relative)"}
NO_INTERVAL = "too little data for an interval"
CANDIDATE = 14.0
"""Drop of the loss: of 52 effects that do nothing, one gains more in 1 of 100 drives where
residuals are independent (chi-square of one number at 0.01 / 52). Above it it is a candidate."""
MOST_DROPPED = 3
"""Dropped candidates in the verdict; the page lists all."""


def channel(name: str) -> str:
    """The channel in words, its own name if it is none of CHANNELS."""
    return CHANNELS.get(name, (name.replace("_", " "), ""))[0]


def verdict(d: Diagnosis) -> str:
    """Return the result in one or two sentences, and the candidates that a test has dropped."""
    return " ".join(filter(None, verdict_parts(d)))


def verdict_parts(d: Diagnosis) -> tuple[str, str]:
    """Return the result, and separately the candidates that a test has dropped, "" for none."""
    n = len(d.causes)
    named = "one cause" if n == 1 else f"{n} causes"
    explain = "explains" if n == 1 else "explain"
    dropped = _dropped(d)
    nothing_else = "Nothing is named" if dropped else (
        "No effect of the catalogue explains how. Nothing is named, because the nearest relative "
        "of an unknown cause is not it")
    if d.verdict == "unexplained" and not remainder(d):
        names = listed([p.effect for p in d.possible], "or")
        return (f"Something is wrong, possibly {names}, but these recordings do not suffice "
                "to accept it, and nothing is named."), dropped
    text = {
        "nothing_wrong": "Nothing is wrong as far as these recordings can show: "
                         + ("no pattern in the errors exceeds the noise, and no effect passes all "
                            "tests." if dropped else "neither an effect of the catalogue nor "
                            "another pattern in the errors exceeds the noise."),
        "parameters_only": "Only the parameters were off: with the model's own parameters "
                           "re-estimated, nothing is missing from it.",
        "explained": f"The model is wrong, and {named} of the catalogue {explain} how.",
        "partly_explained": f"The model is wrong: {named} of the catalogue {explain} part of it, "
                            f"and {remainder(d)}.",
        "unexplained": f"The model is wrong: {remainder(d)}. {nothing_else}.",
    }.get(d.verdict, d.verdict)
    return text, dropped


def remainder(d: Diagnosis) -> str:
    """Name what the accepted causes do not explain, as the page shows it; "" for nothing."""
    if d.unexplained:
        return "a pattern without a cause remains in the errors"
    if d.outliers:
        return "at single moments it errs far more than otherwise"
    if d.late_commands:
        return "some commands act later than they were logged"
    if d.excesses:
        above = [excess(e) for e in d.excesses]
        return f"its errors are above the noise floor: {listed(above, 'and')}"
    changing = [*(c.effect for c in d.causes if not c.constancy.constant),
                *(c.title for c in d.claims if not c.constant)]
    if changing:
        return f"the size of {listed(changing, 'and')} is not constant"
    worse = [c.effect for c in d.causes if c.gain.high < 0.0]
    return (f"with {listed(worse, 'and')} test recordings are predicted worse in one channel"
            if worse else "")


def is_good(d: Diagnosis) -> bool:
    """Whether the verdict is good news and the page lists nothing against it."""
    if remainder(d) or d.possible:
        return False
    if d.verdict == "nothing_wrong":
        return not _dropped(d)
    return d.verdict in ("explained", "parameters_only")


def _dropped(d: Diagnosis) -> str:
    """Candidates that gain more than chance usually does, each with the gate that dropped it."""
    gates = {p.effect: p.why for p in d.possible}
    for c in sorted(d.considered, key=lambda c: -c.loss if math.isfinite(c.loss) else 0.0):
        if math.isfinite(c.loss) and c.loss > CANDIDATE:
            gates.setdefault(c.effect, f"{c.why_not} ({p_value(c.p_value)})")
    accepted = {c.effect for c in d.causes}
    items = [f"{name} ({why})" for name, why in gates.items() if name not in accepted]
    if not items:
        return ""
    more = len(items) - MOST_DROPPED
    return (f"{'Candidate' if len(items) == 1 else 'Candidates'} that a test dropped: "
            + "; ".join(items[:MOST_DROPPED]) + (f"; and {more} more" if more > 0 else "") + ".")


def change(q: Change) -> str:
    """"0.294 -> 0.351 +- 0.004 N"."""
    return f"{significant(q.before)} -> {quantity(Number(q.after, q.std, q.unit))}"


def times(cost: Cost) -> str:
    """"1.07 [1.05, 1.09] times as large"."""
    ratio, low, high = cost
    between = f" [{low:.2f}, {high:.2f}]" if math.isfinite(low) else f" ({NO_INTERVAL})"
    return f"{ratio:.2f}{between} times as large"


def predictor(b: BestPredictor) -> str:
    """What the best predictor is and how much better it predicts than the refit."""
    n = len(b.left_out)
    if not b.effects:
        nearest = min((ratio for _, ratio in b.tried), key=lambda ratio: ratio.value)
        alone = "Best predictor: the refitted parameters alone"
        if b.ratio.high < 1.0:
            return (f"{alone}, fitted with equal weight for each recording: the errors 1 s ahead "
                    f"in {n} recordings left out in turn are {times(b.ratio)} as those of the "
                    "usual refit.")
        return (f"{alone}. No effects significantly lower the errors 1 s ahead in {n} recordings "
                f"left out in turn: with the best ones they are {times(nearest)} as those of the "
                "refit.")
    better = sum(one.ratio < 1.0 for one in b.left_out.values())
    return (f"Best predictor: with {listed(list(b.effects), 'and')} the errors 1 s ahead in "
            f"recordings left out are {times(b.ratio)} as those of the refit, and smaller in "
            f"{better} of {n}. That an effect predicts better does not show that it is a cause.")


def possible(p: Possible) -> str:
    """Describe an effect that the search accepted and a later test did not."""
    why = f": {p.why}" if p.why else ""
    return (f"{p.effect} is {p.grade}: the car {p.title} (probability {p.probability:.2f}); it is "
            f"not in the extended model{why}")


def removes(gain: Gained) -> str:
    """State what a cause changes of an error on the test recordings."""
    if not math.isfinite(gain.test):
        return f"what it removes of the {channel(gain.channel)} error could not be measured"
    nothing = math.isfinite(gain.low) and gain.low <= 0.0 <= gain.high
    return (f"{share_of(gain)} on the test recordings"
            + (", which may be chance" if nothing else ""))


def share_of(gain: Gained) -> str:
    """"removes 24 % [13 %, 33 %] of the speed error", or "raises the speed error by ..."."""
    name = channel(gain.channel)
    if gain.test < 0.0:
        worse = _between(-gain.high, -gain.low)
        return f"raises the {name} error by {percent(-gain.test)} {worse}"
    return f"removes {percent(gain.test)} {_between(gain.low, gain.high)} of the {name} error"


def _between(low: float, high: float) -> str:
    known = math.isfinite(low) and math.isfinite(high)
    return f"[{percent(low)}, {percent(high)}]" if known else f"({NO_INTERVAL})"


def interval(gain: Gained) -> str:
    """Its 95 % interval for a table."""
    known = math.isfinite(gain.low) and math.isfinite(gain.high)
    return f"{percent(gain.low)} to {percent(gain.high)}" if known else NO_INTERVAL


def structure(u: Unexplained) -> str:
    """One structure that is left, in words."""
    along = listed([variable(name) for name in u.along], "and") or "no variable that is known here"
    share = f"{percent(u.share)} of the variance" if math.isfinite(u.share) else "a part"
    return (f"{channel(u.channel)}: {u.structure.rstrip('.')}; {share} of what is left follows "
            f"{along} ({p_value(u.p_value)})")


def outliers(o: Outliers) -> str:
    """A channel that errs far more at single moments, with when the worst were."""
    unit = CHANNELS[o.channel][1]
    worst = "; ".join(f"{m.file} at {m.second:.1f} s ({m.error:+.2g} {unit})"
                      for m in o.moments[:MOST_DROPPED])
    return (f"{channel(o.channel)}: errors 0.5 s ahead have a standard deviation "
            f"{o.ratio:.1f} times what most of them have"
            + (f"; the worst: {worst}" if worst else ""))


def late_commands(late: LateCommands) -> str:
    """How many commands acted too late, by how much, and when."""
    when = "; ".join(f"{m.file} at {m.second:.1f} s" for m in late.moments[:MOST_DROPPED])
    return (f"{percent(late.share)} of the changes of a command act later than their log allows, "
            f"by {late.delay:.2f} s in the mean (log likelihood {late.log_likelihood:.0f} higher), "
            "as after a lost message" + (f"; the clearest: {when}" if when else ""))


def excess(e: Excess) -> str:
    """"yaw rate 0.31 rad/s after 1 s, 2.4 times the noise floor of 0.13 rad/s"."""
    name, unit = CHANNELS[e.channel]
    return (f"{name} {significant(e.error)} {unit} after 1 s, {e.error / e.floor:.1f} times the "
            f"noise floor of {significant(e.floor)} {unit}")


def pooled(horizons: Mapping[str, Any], horizon: str, name: str, kind: str = "pooled") -> float:
    """One figure of an error table of ``evaluate``; NaN where there is none."""
    value = horizons.get(horizon, {}).get(kind, {}).get(name)
    return float(value) if value is not None else math.nan


def moved(name: str, m: Moved) -> str:
    """One base parameter that the refit changed."""
    doubt = f"; hard to believe: {m.doubt}" if m.doubt else ""
    return (f"{name}: {significant(m.before)} -> {quantity(Number(m.after, m.std, m.unit))}"
            f"{doubt}")


def quantity(number: Number) -> str:
    """"0.060 +- 0.004 s"; the standard error has two digits, the value as many decimals."""
    known = math.isfinite(number.std) and number.std > 0.0
    value = with_error(number.value, number.std) if known else significant(number.value)
    return value + UNIT_WORDS.get(number.unit, f" {number.unit}")


def variable(name: str) -> str:
    """A feature in words."""
    return {"x": "place (x)", "y": "place (y)", "time": "time in the recording",
            "revolution_angle": "angle of the encoder's gear",
            "direction": "direction of the turn",
            "way": "way since the start"}.get(name, name.replace("_", " "))


def title(effect: str) -> str:
    """The catalogue's title of an effect, "" for one that it does not have."""
    found = catalogue().get(effect)
    return found.title if found is not None else ""
