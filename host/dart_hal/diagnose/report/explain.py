"""Findings in four sentences each, the same in the terminal and on the page.

What is it, and how large? Why is it believed? What does it gain? What to do next?
"""

from __future__ import annotations

import math

from dart_hal.diagnose.parameters.groups import MERGED
from dart_hal.diagnose.result import Cause, Claim, Diagnosis
from dart_hal.report.numbers import listed, p_value, percent, significant

from .compared import error_change, stages_around
from .physical import describe_size
from .words import CHANNELS, change, channel, variable

SIGNIFICANT = 2.0
"""Standard errors of a size from which on a recording needs the cause."""


def describe_cause(d: Diagnosis, i: int) -> dict[str, str]:
    """Describe the cause number i in four sentences: what, why, gain and next."""
    cause = d.causes[i]
    what = describe_size(cause)
    return {"What": f"The car {cause.title}: {what}.", "Why": _reasons(cause),
            "Gain": _gain(d, i),
            "Next": _next(cause.experiment, bool(cause.cannot_be_told_from))}


def _reasons(cause: Cause) -> str:
    """How many recordings need the cause with which spread of sizes, and its probability."""
    sizes = [size for size, _ in cause.sizes.values()]
    needed = sum(size > SIGNIFICANT * std for size, std in cause.sizes.values())
    if len(sizes) > 1:
        low, high = percent(min(sizes)), percent(max(sizes))
        spread = "the same size" if low == high else f"sizes from {low} to {high} of the fitted one"
        text = f"{needed} of {len(sizes)} training recordings need it, with {spread}"
    else:
        text = "The training recording needs it"
        if cause.constancy.constant:
            text += " with the same size throughout"
    return f"{text}; probability {cause.probability:.2f}." + _doubts(cause)


def _doubts(found: Cause | Claim) -> str:
    """What else would explain the data, and with what the size changes; each a sentence."""
    constant = found.constant if isinstance(found, Claim) else found.constancy.constant
    out = ""
    if not constant:
        others = "".join(f", or with {variable(name)}" for name in found.constancy.others)
        out += (f" Its size changes with {variable(found.constancy.along)} "
                f"({p_value(found.constancy.p_value)}){others}, so it is not the whole cause.")
    if found.cannot_be_told_from:
        out += (f" These data do not distinguish it from "
                f"{listed(found.cannot_be_told_from, 'or')}.")
    return out


def _gain(d: Diagnosis, i: int) -> str:
    """The error before and after, in the channel where the cause shows."""
    gain = d.causes[i].gain
    errors = error_change(d, *stages_around(d, i), gain.channel)
    name, unit = CHANNELS.get(gain.channel, (channel(gain.channel), ""))
    if not math.isfinite(errors.before) or not math.isfinite(errors.after):
        return f"The {name} error could not be measured on the test recordings."
    chance = gain.low <= 0.0 <= gain.high
    verb = ("does not change significantly" if chance else
            "falls" if errors.after < errors.before else "rises")
    return (f"The {name} error{errors.when} on the test recordings {verb}: "
            f"{significant(errors.before)} -> {significant(errors.after)} {unit} "
            f"({errors.counts}).")


def _next(experiment: str, confounded: bool) -> str:
    """The drive that confirms a finding, or distinguishes it from another one."""
    if not experiment:
        return "Use the extended model."
    lead = "To distinguish them" if confounded else "To confirm it"
    return f"{lead}: {_inside(experiment)}"


def describe_claim(c: Claim) -> dict[str, str]:
    """Describe parameters that were wrong in four sentences: what, why, gain and next."""
    stand_for = {name: sorted(part) for part, (name, *_) in MERGED.items()}
    verb = "were" if c.title.endswith("s") else "was"
    what = (f"The model's {c.title} {verb} wrong: "
            + ", ".join(f"{name} {change(q)}" for name, q in c.quantities.items()) + ".")
    why = f"Probability {c.probability:.2f} that they changed.{_doubts(c)}"
    if c.group in stand_for:
        why += f" These data do not distinguish {listed(stand_for[c.group], 'and')}."
    ratio, low, high = c.cost
    within = f" (90 % interval {low:.2f} to {high:.2f})" if math.isfinite(low) else ""
    gain = ("What the old values cost could not be measured." if not math.isfinite(ratio) else
            "With the old values, and all others estimated again, the errors of the motion on the "
            f"test recordings are {ratio:.2f} times as large{within}.")
    return {"What": what, "Why": why, "Gain": gain,
            "Next": _next(c.experiment, bool(c.cannot_be_told_from) or c.group in stand_for)}


def _inside(text: str) -> str:
    """A sentence inside of another: its first letter small, unless it begins a short form."""
    return text[:1].lower() + text[1:] if text[1:2].islower() else text
