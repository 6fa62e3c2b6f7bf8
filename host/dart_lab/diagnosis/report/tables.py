"""The parts of the page that are figures and tables: errors, effects, parameters, files."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from dart_lab.diagnosis.result import BestPredictor, Considered, Diagnosis, ParameterEstimate
from dart_lab.identification.evaluation import CHANNELS as PREDICTED
from dart_lab.identification.evaluation import ERROR_UNITS
from dart_lab.identification.evaluation.cases import short
from dart_lab.identification.evidence.onboard import OnboardEvidence
from dart_lab.report import charts, page, svg
from dart_lab.report.html import Html, el, join, table
from dart_lab.report.numbers import join_names, p_value, percent, significant

from .words import (
    HORIZONS,
    channel,
    error_figure,
    interval,
    late_commands,
    outliers,
    predictor,
    quantity,
    title,
)

# Entries of a file that are not listed with its details.
VISIBLE_ENTRIES = ("role", "windows", "why")
BY_NOISE = " (the same effects, fitted with recordings weighted by their noise)"
# Bars of the ranking; the table below it has all.
MAX_LISTED_EFFECTS = 24


def ranking(d: Diagnosis) -> Html:
    """Draw the loss reduction of every effect alone."""
    if not (d.causes or d.considered):
        return el("p", "No effect was tried.")
    named = {c.effect for c in d.causes}
    shown = sorted(((name, loss) for name, loss in d.ranking.items() if math.isfinite(loss)),
                   key=lambda e: (-e[1], e[0]))[:MAX_LISTED_EFFECTS]
    return join([
        charts.draw_bars("Loss reduction by effect", "loss reduction, alone (logarithmic scale)",
                         [(name, loss, "after" if name in named else "other")
                          for name, loss in shown]),
        svg.legend([("after", "accepted"), ("other", "not accepted")]),
        page.small_print("Each effect alone, before any was accepted: effects similar to a cause "
                         "reduce the loss nearly as much, until the cause is in the model. The "
                         "threshold differs from effect to effect, see the p-values.")])


def errors(d: Diagnosis) -> Html:
    """Tabulate gains, then every stage and CTRV by horizon and channel: RMSE (median)."""
    steps = [(f"{i}. {s.label}", s.horizons) for i, s in enumerate(d.stages)]
    head = ("step", *(f"{channel(c)} [{u}]" for c, u in zip(PREDICTED, ERROR_UNITS, strict=True)))
    out: list[Html] = []
    if isinstance(d.evidence, OnboardEvidence):
        out.append(page.small_print("Without motion capture: speed as the encoder reads it and yaw "
                                    "rate as the gyro reads it; no other channel can be judged."))
    out.append(gains(d))
    known = len(out)
    for horizon in HORIZONS:
        rows = [(label, *(_pair(of, horizon, c) for c in PREDICTED))
                for label, of in [*steps, ("CTRV", d.ctrv)]]
        if horizon == "1.0" and d.noise_floor:
            rows.append(("noise floor", *(significant(d.noise_floor[c]) for c in PREDICTED)))
        if any(cell != "-" for row in rows for cell in row[1:]):
            n = error_figure(d.stages[0].horizons, horizon, "n")
            out.append(table(head, rows, 1, f"after {float(horizon):g} s: RMSE (median) of "
                             f"{significant(n, 9)} windows of the test recordings"))
    if len(out) == known:
        out.append(el("p", "No prediction could be judged: the test recordings have no motion "
                      "capture."))
    return join(out)


def moments(d: Diagnosis) -> Html:
    """List the moments with exceptionally large errors; "" for none."""
    late = page.items([late_commands(d.late_commands)] if d.late_commands else [])
    if not d.outliers:
        return late
    rows = [(channel(o.channel), m.file,
             page.link_replay(f"{m.second:.1f}", m.file, m.second), significant(m.error),
             f"{m.times:.1f}", f"{m.speed:.2f}", f"{m.throttle:.2f}", f"{m.steering:.2f}")
            for o in d.outliers for m in o.moments]
    return join([
        late, page.items(map(outliers, d.outliers)),
        page.small_print("Events that come at any time, with either sign, are no cause of the "
                         "catalogue: a gust, a lost command, a wheel that lifts, a jump of the "
                         "motion capture. Look at these moments in the recordings: while dart-hal "
                         "view FILE runs, the second of a run links to it."),
        table(("channel", "file", "second", "error", "times the usual one", "speed [m/s]",
               "throttle", "steering"), rows, 2)])


def best_predictor(d: Diagnosis, b: BestPredictor) -> Html:
    """Tabulate the best predictor: effects, errors by held-out recording, and on the test side."""
    sizes = [(name, title(name), ", ".join(f"{k} {quantity(n)}" for k, n in numbers.items()))
             for name, numbers in b.effects.items()]
    held_out = [(short(name), f"{one.ratio:.2f}", *(
        f"{significant(before)} -> {significant(after)}" for before, after in zip(
            one.refitted, one.predictor, strict=True))) for name, one in b.left_out.items()]
    channels = [f"{channel(c)} [{u}]" for c, u in zip(PREDICTED, ERROR_UNITS, strict=True)]
    sets = [names for names, _ in b.tried]
    tried = [(f"{ratio.value:.3f} [{ratio.low:.2f}, {ratio.high:.2f}]",
              (", ".join(names) or "none") + (BY_NOISE if names in sets[:i] else ""))
             for i, (names, ratio) in enumerate(b.tried)]
    stages = [("refitted", d.stages[1].horizons), ("with the causes", d.stages[-1].horizons),
              ("best predictor", b.horizons)]
    test = [(label, *(_pair(of, "1.0", c) for c in PREDICTED)) for label, of in stages]
    return join([
        el("p", predictor(b)),
        table(("effect", "the car ...", "size"), sizes, 2, "standard errors: spread of the fits "
              "without one recording each (jackknife)"),
        table(("model", *channels), test, 1, "errors after 1 s on the test recordings: RMSE "
              "(median); they selected nothing of the predictor"),
        table(("recording held out", "ratio", *channels), held_out, 1,
              "RMSE after 1 s: refit -> best predictor, each fitted to the other recordings"),
        table(("ratio", "effects on the motion"), tried, 2,
              "sets of effects that were tried: errors in held-out recordings over those of the "
              "refit, with 90 % intervals")])


def _pair(horizons: Mapping[str, Any], horizon: str, name: str) -> str:
    rmse, median = (error_figure(horizons, horizon, name, kind) for kind in ("pooled", "median"))
    if not math.isfinite(median):
        return significant(rmse)
    return f"{significant(rmse)} ({significant(median)})"


def gains(d: Diagnosis) -> Html:
    """Compare the extended model with the base, by channel."""
    rows = [(channel(name), percent(g.test), interval(g), percent(g.train))
            for name, g in d.gain.items()]
    measures = "; ".join(dict.fromkeys(g.measure for g in d.gain.values()))
    return table(("channel", "gain on test data", "95 %", "on training data"), rows,
                 caption=f"extended model against the model as it was given: {measures}")


def considered_table(d: Diagnosis) -> Html:
    """Tabulate effects that were not accepted, and why; those with a loss below 1 in one line."""
    ordered = sorted(d.considered, key=lambda c: (-_or_low(c.loss), c.effect))
    rows = [(c.effect, title(c.effect), significant(c.loss),
             p_value(c.p_value), c.why_not) for c in ordered if not _is_negligible(c)]
    idle: dict[str, list[str]] = {}
    for c in filter(_is_negligible, ordered):
        idle.setdefault(c.why_not, []).append(f"{c.effect} ({significant(c.loss)})")
    head = ("effect", "the car ...", "loss reduction, added", "p", "why not accepted")
    return page.foldable(f"{len(ordered)} effects", table(head, rows), *(
        page.small_print(f"Loss reduction, added, below 1 ({why}): {', '.join(names)}.")
        for why, names in idle.items()), page.text(
            "Found at first and withdrawn: "
            f"{join_names(d.withdrawn, 'and')}." if d.withdrawn else ""))


def _is_negligible(c: Considered) -> bool:
    return c.loss < 1.0


def parameters(d: Diagnosis) -> Html:
    """Tabulate the base parameters that the refit changed."""
    if not d.refitted:
        return el("p", "The model's own parameters were not fitted.")
    rows = []
    for name, m in d.refitted.items():
        change = (m.after - m.before) / m.before if m.before else float("nan")
        rows.append((name, significant(m.before, 4),
                     quantity(ParameterEstimate(m.after, m.std, m.unit)),
                     f"{100 * change:+.0f} %" if change == change else "-",
                     m.doubt or "believable"))
    return table(("parameter", "before", "after", "change", "judged"), rows)


def files(d: Diagnosis) -> Html:
    """Tabulate every file with its role and windows; hash and what was dropped are folded."""
    rows = []
    for name, use in d.files.items():
        details = [f"{key}: {_cell(value)}" for key, value in use.items()
                   if key not in VISIBLE_ENTRIES]
        why = use.get("why") or ()
        folded = page.foldable(f"{len(details) + len(why)} notes", page.items([*why, *details]))
        rows.append((name, *(_cell(use.get(key)) for key in VISIBLE_ENTRIES[:2]), folded))
    return join([table(("file", *VISIBLE_ENTRIES[:2], "details"), rows), page.small_print(
        "Windows: of the fit. Errors are of more windows, one each 0.25 s.")])


def sources(d: Diagnosis, about: Mapping[str, str]) -> Html:
    """Tabulate how the page was made."""
    rows = [(key, el("code", value) if key == "command" else value)
            for key, value in {**about, "seed": str(d.seed),
                               "time it took": f"{d.runtime_s:.1f} s"}.items()]
    return table(("", ""), rows)


def _or_low(value: float) -> float:
    return value if value == value else float("-inf")


def _cell(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_cell(inner)}" for key, inner in value.items())
    if isinstance(value, (list, tuple)):
        return "; ".join(map(str, value)) or "-"
    if isinstance(value, float):
        return significant(value)
    return "-" if value is None else str(value)
