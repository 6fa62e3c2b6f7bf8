"""Findings in four sentences each, the same in the terminal and on the page.

What is it, and how large? Why is it accepted? What does it gain? What to do next?
"""

from __future__ import annotations

import math

import numpy as np

from dart_lab.diagnosis.parameters.groups import MERGED
from dart_lab.diagnosis.result import Cause, Claim, Diagnosis, ParameterChange, QuantityChange
from dart_lab.report.numbers import join_names, p_value, percent, significant

from .compared import error_change, stages_around
from .data_problems import valid_sizes
from .physical import describe_size
from .words import CHANNEL_LABELS, change, channel, signed_title, title, variable

# Standard errors of a size above which a recording needs the cause.
SIGNIFICANT = 2.0
# Share of a parameter below which its change is a small correction, as below SIGNIFICANT.
# With 2 % of 2 N DART is 0.024 m/s faster after 1 s: the noise floor of simulated drives.
SMALL_CHANGE = 0.02
# Share of the motion error above which no correction is small, however uncertain its size.
SMALL_GAIN = 0.1
# Parameters that are listed if nothing else was found; one if there are causes. Of some 18
# parameters of a refit, one is beyond two standard errors by chance.
MAX_CHANGES = 3
# Minimum number of recordings for which the middle half of the sizes is stated.
QUARTILES_FROM = 4
SPLITS = ("share of random draws from the training data (bootstrap) in which the data left out are "
          "predicted better with it")


def heading(cause: Cause) -> str:
    """Return "The car has a weaker motor than the model (motor_gain)", marked as a substitute."""
    lead = "The car" if cause.constancy.constant else "Substitute: the car"
    return f"{lead} {signed_title(cause)} ({cause.effect})"


def describe_cause(d: Diagnosis, i: int) -> dict[str, str]:
    """Describe the cause number i in four sentences: what, why, gain and next."""
    cause = d.causes[i]
    what = f"The car {signed_title(cause)}: {describe_size(cause)}."
    if not cause.constancy.constant:
        what += (f" A substitute: its size changes with {_describe_variable(cause)}, so it is not "
                 "the whole cause.")
    return {"What": what, "Why": _reasons(d, i), "Gain": _gain(d, i),
            "Next": _next(cause.experiment, bool(cause.cannot_be_told_from),
                          not cause.constancy.constant)}


def _reasons(d: Diagnosis, i: int) -> str:
    """State how many recordings need the cause, the spread of its sizes, and its probability."""
    cause = d.causes[i]
    valid = valid_sizes(d, cause)
    sizes = [size for size, _ in valid.values()]
    needed = sum(size > SIGNIFICANT * std for size, std in valid.values())
    if len(sizes) > 1:
        text = f"{needed} of {len(sizes)} training recordings need it; {_spread(sizes)}"
        excluded = len(cause.sizes) - len(valid)
        if excluded:
            text += f"; {excluded} without valid data left out"
    else:
        text = "The training recording needs it"
        if cause.constancy.constant:
            text += "; no significant change of its size"
    meaning = f" ({SPLITS})" if i == 0 else ""
    return f"{text}; probability {cause.probability:.2f}{meaning}.{_describe_confounders(cause)}"


def _spread(sizes: list[float]) -> str:
    """Describe the range of the sizes, or of the middle half if there are enough."""
    quartiles = len(sizes) >= QUARTILES_FROM
    ends = np.quantile(sizes, (0.25, 0.75)) if quartiles else (min(sizes), max(sizes))
    low, high = (percent(float(end)) for end in ends)
    lead = "the middle half of the sizes is" if quartiles else "sizes are"
    return f"{lead} {low if low == high else f'{low} to {high}'} of the fitted one"


def _describe_variable(found: Cause | Claim) -> str:
    """"place (x) (p = 0.001), or with steering angle (these go together in the data)"."""
    c = found.constancy
    others = "".join(f", or with {variable(name)}" for name in c.others)
    note = " (these go together in the data)" if others else ""
    return f"{variable(c.along)} ({p_value(c.p_value)}){others}{note}"


def _describe_confounders(found: Cause | Claim) -> str:
    """State what else explains the data as well; "" for nothing."""
    if not found.cannot_be_told_from:
        return ""
    own = found.group if isinstance(found, Claim) else found.effect
    others = [f"{title(name)} ({name})" if title(name) else name
              for name in found.cannot_be_told_from]
    return (f" These data do not distinguish it from a car that {join_names(others, 'or')}: the "
            f"name {own} is a choice between equals." if title(own) else
            f" These data do not distinguish it from {join_names(others, 'or')}.")


def _gain(d: Diagnosis, i: int) -> str:
    """State the error before and after, in the channel in which the cause shows."""
    gain = d.causes[i].gain
    errors = error_change(d, *stages_around(d, i), gain.channel)
    name, unit = CHANNEL_LABELS.get(gain.channel, (channel(gain.channel), ""))
    if not math.isfinite(errors.before) or not math.isfinite(errors.after):
        return f"The {name} error could not be measured on the test recordings."
    chance = gain.low <= 0.0 <= gain.high
    verb = ("does not change significantly" if chance else
            "falls" if errors.after < errors.before else "rises")
    return (f"The {name} error{errors.when} on the test recordings {verb}: "
            f"{significant(errors.before)} -> {significant(errors.after)} {unit}"
            f"{errors.counts}.{_all_steps(d, i)}")


def _all_steps(d: Diagnosis, i: int) -> str:
    """State the error of the first and the last model where the cause is one of several steps."""
    name = d.causes[i].gain.channel
    own, all_steps = (
        " -> ".join(map(significant, (errors.before, errors.after))) for errors in (
            error_change(d, *stages_around(d, i), name),
            error_change(d, d.stages[0], d.stages[-1], name)))
    return "" if own == all_steps or "-" in all_steps.split() else (
        f" From the model as given to the one with all causes: {all_steps}.")


def _next(experiment: str, confounded: bool, substitute: bool = False) -> str:
    """The drive that confirms a finding, or distinguishes it from another one."""
    if not experiment:
        return "Use the extended model."
    lead = ("To distinguish them" if confounded else
            "To find the cause behind it" if substitute else "To confirm it")
    return f"{lead}: {inside(experiment)}"


def is_small_change(q: QuantityChange | ParameterChange) -> bool:
    """Check that a parameter changed by less than 2 standard errors, or by less than 2 %."""
    moved = abs(q.after - q.before)
    return moved < SMALL_CHANGE * abs(q.before) or moved < SIGNIFICANT * q.std


def is_small(c: Claim) -> bool:
    """Check that a claim is a small correction: its quantities changed by little, and gain little.
    """
    gains = math.isfinite(c.cost[1]) and c.cost[1] * (1.0 - SMALL_GAIN) > 1.0
    return not gains and all(map(is_small_change, c.quantities.values()))


def largest_changes(d: Diagnosis) -> str:
    """Return the parameters that the refit changed most, by standard errors; "" for none."""
    moved = [(abs(m.after - m.before) / m.std, name, m) for name, m in d.refitted.items()
             if m.std > 0.0 and m.after != m.before]
    most = 1 if d.causes else MAX_CHANGES
    largest = sorted(moved, key=lambda entry: (-entry[0], entry[1]))[:most]
    return "; ".join(f"{name} {change(m)}" for _, name, m in largest)


def describes_size(c: Claim) -> bool:
    """Check that a claim is about a size that the owner of the car states in car.toml."""
    return bool(c.parameters) and all(name.startswith("body.") for name in c.parameters)


def describe_claim(c: Claim) -> dict[str, str]:
    """Describe parameters that changed in four sentences: what, why, gain and next."""
    merged = {name: sorted(part) for part, (name, *_) in MERGED.items()}
    verb = "were" if c.title.endswith("s") else "was"
    mine, small = ("Your", "your") if describes_size(c) else ("The model's", "the model's")
    lead = (f"A small correction of {small} {c.title}" if is_small(c)
            else f"{mine} {c.title} {verb} wrong")
    what = f"{lead}: {', '.join(f'{name} {change(q)}' for name, q in c.quantities.items())}."
    why = f"Probability {c.probability:.2f} that the values changed"
    why += ", by however little." if is_small(c) else "."
    if not c.constant:
        why += f" The change is not constant: it goes with {_describe_variable(c)}."
    why += _describe_confounders(c)
    if c.group in merged:
        why += f" These data do not distinguish {join_names(merged[c.group], 'and')}."
    return {"What": what, "Why": why, "Gain": _claim_gain(c),
            "Next": _next(c.experiment, bool(c.cannot_be_told_from) or c.group in merged)}


def _claim_gain(c: Claim) -> str:
    """State by how much the new values lower the errors, with the 90 % interval."""
    if not math.isfinite(c.cost[0]):
        return "What the new values gain could not be measured."
    value, low, high = (1.0 - 1.0 / ratio for ratio in c.cost)
    within = (f" (90 % interval {percent(low)} to {percent(high)})" if math.isfinite(low) else "")
    verb = "fall" if value >= 0.0 else "rise"
    return ("With the new values, all others estimated again, the errors of the motion on the "
            f"test recordings {verb} by {percent(abs(value))}{within}.")


def inside(text: str) -> str:
    """Write a sentence for use inside of another: small first letter, unless it is an acronym."""
    return text[:1].lower() + text[1:] if text[1:2].islower() else text
