"""Sentences of a diagnosis, the same in the terminal and on the page."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from dart_hal.vehicle.effects import catalogue
from dart_lab.diagnosis.error_summaries import Excess, LateCommands, Outliers
from dart_lab.diagnosis.result import (
    BestPredictor,
    Cause,
    ErrorReduction,
    ParameterChange,
    ParameterEstimate,
    Possible,
    QuantityChange,
)
from dart_lab.report.numbers import describe_change, join_names, percent, significant, with_error

# Name and unit of every channel of a stated error.
CHANNEL_LABELS = {
    "vx": ("speed", "m/s"), "vy": ("lateral velocity", "m/s"), "yaw_rate": ("yaw rate", "rad/s"),
    "position": ("position", "m"), "yaw_deg": ("yaw angle", "deg"),
    "v_x": ("speed", "m/s"), "v_y": ("lateral velocity", "m/s"), "omega": ("yaw rate", "rad/s"),
    "encoder": ("encoder", "m/s"), "gyro": ("gyro", "rad/s"),
    "accel_x": ("longitudinal accelerometer", "m/s2"),
    "accel_y": ("lateral accelerometer", "m/s2")}
HORIZONS = ("0.5", "1.0", "2.0")
UNIT_WORDS = {"": "", "-": "", "relative": " (relative)"}
NO_INTERVAL = "too little data for an interval"
# Moments in a sentence; the page lists all.
MAX_LISTED_MOMENTS = 3

# How the note about the mounting of the sensors begins.
PARTS_OF_THE_CAR = ("a model that --out writes also has these parts of the car, which are no "
                    "causes: ")


def channel(name: str) -> str:
    """Name of a channel in words, or its own name if it has none."""
    return CHANNEL_LABELS.get(name, (name.replace("_", " "), ""))[0]


def change(q: QuantityChange | ParameterChange) -> str:
    """"0.294 -> 0.351 +- 0.004 N (+19 %, 14 standard errors)"."""
    share = 100.0 * (q.after / q.before - 1.0) if q.before else math.nan
    parts = [f"{share:+.{1 if abs(share) < 9.95 else 0}f} %"] if q.before else []
    if math.isfinite(q.std) and q.std > 0.0:
        errors = significant(abs(q.after - q.before) / q.std, 2)
        parts.append(f"{errors} standard error{'' if errors == '1' else 's'}")
    note = f" ({', '.join(parts)})" if parts else ""
    return quantity_change(q) + note


def quantity_change(q: QuantityChange | ParameterChange) -> str:
    """"0.294 -> 0.351 +- 0.004 N"."""
    return (f"{significant(q.before, 4)} -> "
            f"{quantity(ParameterEstimate(q.after, q.std, q.unit))}")


def predictor(b: BestPredictor) -> str:
    """Describe the best predictor and how much better it predicts than the refit."""
    n = len(b.left_out)
    if not b.effects:
        nearest = min((ratio for _, ratio in b.tried), key=lambda ratio: ratio.value)
        alone = "Best predictor: the refitted parameters alone"
        if b.ratio.high < 1.0:
            return (f"{alone}, fitted with equal weight for each recording: the errors 1 s ahead "
                    f"in {n} recordings left out in turn are {describe_change(*b.ratio)} than "
                    "those of the usual refit.")
        return (f"{alone}. No effects significantly lower the errors 1 s ahead in {n} recordings "
                f"left out in turn: with the best ones they are {describe_change(*nearest)} than "
                "those of the refit.")
    better = sum(one.ratio < 1.0 for one in b.left_out.values())
    return (f"Best predictor: with {join_names(list(b.effects), 'and')} the errors 1 s ahead in "
            f"recordings left out are {describe_change(*b.ratio)} than those of the refit, and "
            f"smaller in {better} of {n}. Use it to predict (controller, simulation), and the "
            "extended model to understand the car: an effect that predicts better need not be a "
            "cause.")


def possible(p: Possible) -> str:
    """Describe an effect that the search accepted and a later test did not."""
    why = f": {p.why}" if p.why else ""
    return (f"{p.effect} is {p.grade}: the car {p.title} (probability {p.probability:.2f}); it is "
            f"not in the extended model{why}")


def removes(gain: ErrorReduction) -> str:
    """State what a cause changes of an error on the test recordings."""
    if not math.isfinite(gain.test):
        return f"what it removes of the {channel(gain.channel)} error could not be measured"
    nothing = math.isfinite(gain.low) and gain.low <= 0.0 <= gain.high
    return (f"{share_of(gain)} on the test recordings"
            + (", which may be chance" if nothing else ""))


def share_of(gain: ErrorReduction) -> str:
    """"removes 24 % [13 %, 33 %] of the speed error", or "raises the speed error by ..."."""
    return describe_share(gain.test, gain.low, gain.high, channel(gain.channel), _format_interval)


def describe_share(share: float, low: float, high: float, error: str,
                   format_limits: Callable[[float, float], str]) -> str:
    """Describe a share of an error that is removed, or by which it rises.

    format_limits: formats the interval, with a space before it.
    """
    if share < 0.0:
        return f"raises the {error} error by {percent(-share)}{format_limits(-high, -low)}"
    return f"removes {percent(share)}{format_limits(low, high)} of the {error} error"


def _format_interval(low: float, high: float) -> str:
    known = math.isfinite(low) and math.isfinite(high)
    return f" [{percent(low)}, {percent(high)}]" if known else f" ({NO_INTERVAL})"


def interval(gain: ErrorReduction) -> str:
    """Format the 95 % interval of a gain for a table."""
    known = math.isfinite(gain.low) and math.isfinite(gain.high)
    return f"{percent(gain.low)} to {percent(gain.high)}" if known else NO_INTERVAL


def outliers(o: Outliers) -> str:
    """Describe a channel with much larger errors at single moments, and the largest ones."""
    unit = CHANNEL_LABELS[o.channel][1]
    worst = "; ".join(f"{m.file} at {m.second:.1f} s ({m.error:+.2g} {unit})"
                      for m in o.moments[:MAX_LISTED_MOMENTS])
    return (f"{channel(o.channel)}: errors 0.5 s ahead have a standard deviation "
            f"{o.ratio:.1f} times what most of them have"
            + (f"; the worst: {worst}" if worst else ""))


def late_commands(late: LateCommands) -> str:
    """State how many commands acted too late, by how much, and when."""
    when = "; ".join(f"{m.file} at {m.second:.1f} s" for m in late.moments[:MAX_LISTED_MOMENTS])
    return (f"{percent(late.share)} of the changes of a command act later than their log allows, "
            f"by {late.delay:.2f} s in the mean (log likelihood {late.log_likelihood:.0f} higher), "
            "as after a lost message" + (f"; the clearest: {when}" if when else ""))


def excess(e: Excess) -> str:
    """"yaw rate 0.31 rad/s after 1 s, 2.4 times the noise floor of 0.13 rad/s"."""
    name, unit = CHANNEL_LABELS[e.channel]
    return (f"{name} {significant(e.error)} {unit} after 1 s, {e.error / e.floor:.1f} times the "
            f"noise floor of {significant(e.floor)} {unit}")


def error_figure(horizons: Mapping[str, Any], horizon: str, name: str,
                 kind: str = "pooled") -> float:
    """One figure of an error table of ``evaluate``; NaN if it is missing."""
    value = horizons.get(horizon, {}).get(kind, {}).get(name)
    return float(value) if value is not None else math.nan


def describe_moved(name: str, m: ParameterChange) -> str:
    """Describe one base parameter that the refit changed."""
    doubt = f"; hard to believe: {m.doubt}" if m.doubt else ""
    after = quantity(ParameterEstimate(m.after, m.std, m.unit))
    return f"{name}: {significant(m.before)} -> {after}{doubt}"


def quantity(number: ParameterEstimate) -> str:
    """"0.060 +- 0.004 s"; the standard error has two digits, the value as many decimals."""
    known = math.isfinite(number.std) and number.std > 0.0
    value = with_error(number.value, number.std) if known else significant(number.value)
    return value + UNIT_WORDS.get(number.unit, f" {number.unit}")


def describe_parts(mounting: Mapping[str, Mapping[str, ParameterEstimate]]) -> tuple[str, ...]:
    """Describe the effects of the written model that are parts of the car and no causes."""
    words = [f"{effect} {quantity(number)}" for effect, numbers in mounting.items()
             for number in numbers.values() if number.value != number.null]
    return (f"{PARTS_OF_THE_CAR}{', '.join(words)}",) if words else ()


def variable(name: str) -> str:
    """Name of a feature in words."""
    return {"x": "place (x)", "y": "place (y)", "time": "time in the recording",
            "revolution_angle": "angle of the encoder's gear",
            "direction": "direction of the turn",
            "way": "way since the start"}.get(name, name.replace("_", " "))


def title(effect: str) -> str:
    """Title of an effect in the catalogue, "" if it has none."""
    found = catalogue().get(effect)
    return found.title if found is not None else ""


def signed_title(found: Cause | Possible) -> str:
    """Return the title of an effect by the sign of its size: "has a weaker motor than ..."."""
    known = catalogue().get(found.effect)
    if known is None or not known.signed_titles or not isinstance(found, Cause):
        return found.title
    size = found.parameters[known.parameters[0].name]
    return known.signed_titles[size.value > size.null]


def short_title(found: Cause | Possible) -> str:
    """Return the title without the comparison with the model, for lists."""
    return signed_title(found).replace(" than the model", "")
