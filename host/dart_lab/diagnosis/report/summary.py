"""Summary at the top of the page: the result, and the effect of refit, causes and sensors.

1. result, 2. refit of the parameters, 3. causes in the motion, 4. sensors, 5. remaining errors as a
multiple of the noise floor, 6. the first thing to do. Lines without content are omitted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from dart_hal.vehicle.effects import catalogue
from dart_lab.diagnosis.result import Cause, Diagnosis
from dart_lab.identification.evaluation import CHANNELS as PREDICTED
from dart_lab.report.numbers import join_names, significant

from .compared import HORIZON, MIN_ERROR_CHANGE, error_change, stages_around, step_changes
from .data_problems import data_problems
from .explain import inside, is_small, largest_changes
from .patterns import next_step
from .words import CHANNEL_LABELS, channel, error_figure, excess, short_title

# Ratio of medians above which a sentence states that the typical error grows.
MIN_MEDIAN_RATIO = 1.1


def headline(d: Diagnosis) -> str:
    """Return the result in one sentence."""
    if d.verdict == "unexplained" and not remainder(d):
        names = join_names([f"{short_title(p)} ({p.effect})" for p in d.possible], "or")
        return (f"Something is wrong, possibly the car {names}, but these recordings do not "
                "suffice to accept it, and nothing is named.")
    found, explain = _state_findings(d)
    return {
        "nothing_wrong": "Nothing is wrong as far as these recordings can show: no pattern in the "
                         "errors exceeds the noise, and no effect of the catalogue passes all "
                         "tests.",
        "parameters_only": "Only the parameters were off: with the model's own parameters "
                           "re-estimated, nothing is missing from it.",
        "explained": f"The model is wrong, and {found} {explain} how.",
        "partly_explained": f"The model is wrong: {found} {explain} part of it, and "
                            f"{remainder(d)}.",
        "unexplained": f"The model is wrong: {remainder(d)}. No effect of the catalogue passes "
                       "all tests, so nothing is named.",
    }.get(d.verdict, d.verdict)


def summary_lines(d: Diagnosis) -> list[str]:
    """Return the lines below the result."""
    return [*filter(None, [_refit(d), _causes(d), _sensors(d), *median_warnings(d),
                           _describe_remainder(d)]), f"First: {inside(first_step(d))}"]


def _state_findings(d: Diagnosis) -> tuple[str, str]:
    """Count causes and substitutes, with wrong parameters, and return the verb of the sentence."""
    wrong = any(not is_small(c) for c in d.claims)
    causes = [c for c in d.causes if c.constancy.constant]
    sensors = sum(map(is_sensor, causes))
    substitutes = len(d.causes) - len(causes)
    parts = ["wrong parameters"] if wrong else []
    if 0 < sensors < len(causes):
        parts.append(f"{_count(len(causes) - sensors, 'cause')} in the motion and "
                     f"{'one' if sensors == 1 else sensors} in the sensors")
    elif causes:
        parts.append(f"{_count(len(causes), 'cause')} of the catalogue")
    if substitutes:
        parts.append(f"{_count(substitutes, 'substitute')} (of no constant size)")
    if not parts:
        parts.append("small corrections of the parameters")
    single = not wrong and len(d.causes) == 1
    return join_names(parts, "and"), "explains" if single else "explain"


def _count(n: int, noun: str) -> str:
    return f"one {noun}" if n == 1 else f"{n} {noun}s"


def remainder(d: Diagnosis) -> str:
    """Describe what the accepted causes do not explain, as the page shows it; "" for nothing."""
    if d.unexplained:
        return "a pattern without a cause remains in the errors"
    if d.outliers:
        return "at single moments it errs far more than otherwise"
    if d.late_commands:
        return "some commands act later than they were logged"
    if d.excesses:
        above = [excess(e) for e in d.excesses]
        return f"its errors are above the noise floor: {join_names(above, 'and')}"
    changing = [*(c.effect for c in d.causes if not c.constancy.constant),
                *(c.title for c in d.claims if not c.constant)]
    if changing:
        return f"the size of {join_names(changing, 'and')} is not constant"
    worse = [c.effect for c in d.causes if c.gain.high < 0.0]
    return (f"with {join_names(worse, 'and')} test recordings are predicted worse in one channel"
            if worse else "")


def tone(d: Diagnosis) -> str:
    """"good": nothing wrong, or only small corrections; "found": explained; "bad": open."""
    if remainder(d) or d.verdict not in ("nothing_wrong", "parameters_only", "explained"):
        return "bad"
    return "found" if d.causes or not all(map(is_small, d.claims)) else "good"


def _refit(d: Diagnosis) -> str:
    """State which groups the refit changed, and by how much the errors change."""
    if "refitted" not in d.compared:
        return ""
    wrong, small = ([c.title for c in d.claims if is_small(c) == kind] for kind in (False, True))
    parts = [f"wrong: {join_names(wrong, 'and')}"] if wrong else []
    parts += [f"small correction: {join_names(small, 'and')}"] if small else []
    if not parts:
        largest = largest_changes(d)
        parts = [f"no group is confirmed as wrong; most changed: {largest}"
                 if largest else "no parameter changes"]
    return f"Parameters: {'; '.join(parts)}. With the refit {_effect_on_errors(d, 'refitted')}."


def _causes(d: Diagnosis) -> str:
    """State the causes in the motion, and by how much the errors change."""
    causes = [c for c in d.causes if not is_sensor(c)]
    if not causes:
        return ""
    lead = "Cause" if len(causes) == 1 else "Causes"
    return (f"{lead}: the car {join_names([_label(c) for c in causes], 'and')}. With "
            f"{'it' if len(d.causes) == 1 else 'all causes'} {_effect_on_errors(d, 'extended')}.")


def _sensors(d: Diagnosis) -> str:
    """State the causes in the sensors."""
    causes = [c for c in d.causes if is_sensor(c)]
    if not causes:
        return ""
    return (f"Sensors: the car {join_names([_label(c) for c in causes], 'and')}. This changes "
            "what is measured, not how the model predicts the motion.")


def is_sensor(cause: Cause) -> bool:
    """Check that a cause changes only what is measured."""
    return catalogue()[cause.effect].stage == "measurement"


def _label(cause: Cause) -> str:
    """Title and name of a cause; marked if it is a substitute."""
    kind = "" if cause.constancy.constant else ", substitute"
    return f"{short_title(cause)} ({cause.effect}{kind})"


def _effect_on_errors(d: Diagnosis, model: str) -> str:
    """"the test errors 1 s ahead fall by 8 % to 16 %", by the step to a model of ``compared``."""
    step = list(d.compared).index(model) - 1
    shares = [changes[step].ratio for name in PREDICTED if (changes := step_changes(d, name))]
    lead = "the test errors 1 s ahead"
    if not shares:
        return f"{lead} could not be measured"
    low, high = (round(100.0 * (end - 1.0)) for end in (min(shares), max(shares)))
    if low == high == 0:
        return f"{lead} stay the same"
    ends = [f"{end} %" if end else "up" for end in sorted({abs(low), abs(high)})]
    if high <= 0 or low >= 0:
        return f"{lead} {'fall' if low < 0 else 'rise'} by {' to '.join(ends)}"
    return f"{lead} change by {low:+d} % to {high:+d} %"


def _describe_remainder(d: Diagnosis) -> str:
    """State the remaining errors as multiples of the noise floor."""
    last = d.stages[-1].horizons
    ratios = {name: error_figure(last, HORIZON, name) / floor
              for name, floor in d.noise_floor.items()
              if floor > 0.0 and math.isfinite(error_figure(last, HORIZON, name))}
    if not ratios:
        return ""
    low = min(ratios, key=ratios.__getitem__)
    high = max(ratios, key=ratios.__getitem__)
    ends = [f"{ratios[name]:.1f} ({channel(name)})" for name in dict.fromkeys((low, high))]
    return f"Left: errors of {' to '.join(ends)} times the noise floor."


def motion_warnings(d: Diagnosis) -> list[str]:
    """State which causes improve no prediction, and where constant velocity is better.

    Predictions of the motion are compared by the RMSE 1 s ahead on the test recordings.
    """
    useless = [c.effect for i, c in enumerate(d.causes)
               if (ratios := [error_change(d, *stages_around(d, i), name).ratio
                              for name in PREDICTED])
               and not any(ratio <= 1.0 - MIN_ERROR_CHANGE for ratio in ratios)]
    out = []
    if useless:
        every = len(useless) == len(d.causes)
        verb = "improves" if len(useless) == 1 else "improve"
        lead = ("No cause improves a" if every else f"{join_names(useless, 'and')} {verb} no")
        source = ": what is gained there comes from the refit" * (
            every and "refitted" in d.compared)
        out.append(f"{lead} prediction of the motion{source}.")
    last = d.stages[-1].horizons
    errors = {name: (error_figure(d.ctrv, HORIZON, name), error_figure(last, HORIZON, name))
              for name in PREDICTED}
    beaten = [f"{channel(name)} ({significant(held)} against {significant(model)} "
              f"{CHANNEL_LABELS[name][1]})" for name, (held, model) in errors.items()
              if held < model]
    if beaten:
        out.append("Constant velocity predicts better than the model: "
                   f"{join_names(beaten, 'and')}.")
    return out


def median_warnings(d: Diagnosis) -> list[str]:
    """State where medians contradict the root mean squares.

    A typical error that grows from the first to the last model while large ones shrink, and
    constant velocity with a smaller one than every model.
    """
    given = d.stages[0].horizons
    last = d.stages[-1].horizons
    figures = {name: [error_figure(of, HORIZON, name, kind) for kind in ("pooled", "median")
                      for of in (given, last)] for name in PREDICTED}
    grow = [name for name, (rms, rms_after, median, median_after) in figures.items()
            if rms_after < rms and median_after > MIN_MEDIAN_RATIO * median > 0.0]
    out = []
    if grow:
        most = max(grow, key=lambda name: figures[name][3] / figures[name][2])
        large, typical = (f"{significant(figures[most][k])} -> {significant(figures[most][k + 1])}"
                          for k in (0, 2))
        out.append(f"The large errors shrink ({channel(most)} RMSE {large}) but the typical one "
                   f"grows (median {typical}){_also(grow, most)}.")
    constant_velocity = {name: error_figure(d.ctrv, HORIZON, name, "median") for name in PREDICTED}
    best = {name: min(error_figure(stage.horizons, HORIZON, name, "median")
                      for stage in d.compared.values()) for name in PREDICTED}
    beaten = [name for name in PREDICTED if constant_velocity[name] < best[name]]
    if beaten:
        most = min(beaten, key=lambda name: constant_velocity[name] / best[name])
        out.append("In the median, constant velocity predicts better than every model: "
                   f"{channel(most)} {significant(constant_velocity[most])} against "
                   f"{significant(best[most])} {CHANNEL_LABELS[most][1]}{_also(beaten, most)}.")
    return out


def _also(names: Sequence[str], most: str) -> str:
    """"; also position and yaw angle"."""
    others = [channel(name) for name in names if name != most]
    return f"; also {join_names(others, 'and')}" if others else ""


def first_step(d: Diagnosis) -> str:
    """Return the first thing to do: a problem of the data, then what is open, then a check."""
    problems = data_problems(d)
    if problems:
        which = f"the first of {len(problems)} problems" if len(problems) > 1 else "a problem"
        what, *remedy = problems[0].split(". ")[:2]
        return f"solve {which} of the data: {'. '.join([inside(what), *remedy]).rstrip('.')}."
    if d.unexplained:
        return next_step(d.unexplained[0])
    if d.outliers:
        return "look at the listed moments in the recordings."
    for lead, checks in (
            ("find the cause behind {}", [c for c in d.causes if not c.constancy.constant]),
            ("distinguish {}", [c for c in d.causes if c.cannot_be_told_from]),
            ("confirm {}", d.causes)):
        check = next((c for c in checks if c.experiment), None)
        if check is not None:
            names = " from ".join([check.effect, *check.cannot_be_told_from[:1]])
            return f"{lead.format(names)}: {inside(check.experiment)}"
    if d.claims and d.claims[0].experiment:
        return f"confirm the {d.claims[0].title}: {inside(d.claims[0].experiment)}"
    if d.possible:
        return (f"record more driving that excites {d.possible[0].effect}: "
                f"{inside(catalogue()[d.possible[0].effect].experiment)}")
    if d.verdict == "parameters_only":
        return "use the refitted model; --out MODEL.TOML writes it."
    return "nothing to do; another kind of driving may show more."
