"""What the demo's page says of a diagnosis: the sentences, one picture, the errors, the report."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from dart_hal.cli.demo_diagnosis import AFTER, BEFORE, UNSEEN, Chapter, as_hidden, values_of
from dart_hal.diagnose.report import sentence, structure, svg, verdict
from dart_hal.diagnose.report.along import Rows, columns, most, stages_of
from dart_hal.diagnose.report.charts import before_after, share_gone, staircase
from dart_hal.diagnose.report.html import Html, el, join, table
from dart_hal.diagnose.report.words import (
    channel,
    interval,
    listed,
    percent,
    quantity,
    share_of,
    variable,
)
from dart_hal.diagnose.result import Diagnosis

LEFT = 2
"""Structures without a cause that are written out; the report has all."""


BUILT = {"imu_yaw": "imu.mount_yaw", "imu_pitch": "imu.mount_pitch", "imu_roll": "imu.mount_roll"}
"""Effects that a car of a seed has from the start, and what the truth calls their sizes [rad]."""


def hidden_section(told: Chapter, sensors: Mapping[str, Any]) -> Html:
    """What was changed in the emulated car, and what was found of it; sensors: their truth."""
    d = told.diagnosis
    true = {name: f"k {sensors[key]:.3g} rad, built so" for name, key in BUILT.items()}
    hidden = [a.name for a in told.hidden]
    true |= {a.name: f"{values_of(a)}, put in" for a in told.hidden}
    how = (f"The car was driven for {BEFORE:.0f} s as it was. The paper's model, with the speed "
           "of the servo from its data sheet, was fitted to that drive: that is all that is known "
           "of the healthy car. Then something was changed in it. The diagnosis had that model "
           f"and a recorded drive of {AFTER:.0f} s; what a cause is worth is measured on another "
           f"one of {UNSEEN:.0f} s. Encoder, gyro and accelerometer are all that it sees.")
    return join([
        el("h2", "Something was changed in this car. What?"), el("p", how), answer(d),
        el("p", el("strong", "What was changed: "),
           "; ".join(as_hidden(a) for a in told.hidden), ". ",
           "Named." if told.found else "Not named: this drive did not show it well enough."),
        el("p", _as_built(sensors)),
        _found(d, true, hidden), pictures(d), _report(told.files["diagnosis"].name)])


def _as_built(sensors: Mapping[str, Any]) -> str:
    """What else is true of this car and not in its model."""
    turned = [math.degrees(sensors[key]) for key in BUILT.values()]
    if max(map(abs, turned)) < 0.01:
        return "Nothing else is different from what its model can say."
    yaw, pitch, roll = (f"{angle:+.1f} deg" for angle in turned)
    return ("True of this car from the start, and unknown to its model: the IMU sits askew (yaw "
            f"{yaw}, pitch {pitch}, roll {roll}), and the ring of the encoder is uneven.")


def real_section(d: Diagnosis, train: Sequence[str], test: Sequence[str], page: str) -> Html:
    """What the paper's model gets wrong on recordings of the real car."""
    how = ("Recordings of the real car with motion capture, from the excerpt that comes with the "
           f"sources. Causes are looked for in those until 9 September 2024 ({', '.join(train)}); "
           f"what they are worth is measured on later days ({', '.join(test)}), of which no fit "
           "has seen anything. Step 1 is the model as it is, its parameters fitted anew: a cause "
           "is what that cannot do. What is true of this car nobody knows.")
    gains = [share_of(g) for g in d.gain.values()]
    worth = el("p", "Against the paper's model, at 1 s, on those later days, the extended model "
                    f"{listed(gains, 'and')}.") if gains else Html()
    return join([_title(), el("p", how), answer(d), worth, _found(d), pictures(d), _report(page)])


def real_skipped() -> Html:
    """Where the package is installed without its recordings."""
    return join([_title(), el(
        "p", "Skipped: the excerpt of the real car's recordings comes with the sources, and this "
             "installation is without them. ", el("code", "dart-hal data fetch"), " brings all of "
             "them, ", el("code", "dart-hal diagnose --model paper --train FOLDER"),
        " does the same on any.", class_="notice")])


def _title() -> Html:
    return el("h2", "The real car: what the paper's model gets wrong")


def answer(d: Diagnosis) -> Html:
    """Verdict and causes in sentences, and what no effect explains."""
    lines = [el("p", verdict(d), class_="big")]
    if d.causes:
        lines.append(el("ol", *(el("li", sentence(c)) for c in d.causes)))
    if d.unexplained:
        more = len(d.unexplained) - LEFT
        lines += [el("p", "Left without a cause:"),
                  el("ul", *(el("li", structure(u)) for u in d.unexplained[:LEFT]),
                     *([el("li", f"and {more} more, see the report")] if more > 0 else []))]
    good = d.verdict in ("nothing_wrong", "explained", "parameters_only")
    return el("div", *lines, class_="verdict " + ("good" if good else "bad"))


def _found(d: Diagnosis, true: Mapping[str, str] | None = None, hidden: Sequence[str] = ()
           ) -> Html:
    """One row for each cause, and for what was hidden and not named; true None: nobody knows."""
    named = [c.effect for c in d.causes]
    rows: list[tuple[str, ...]]
    rows = [(c.effect, (true or {}).get(c.effect, "-"),
             ", ".join(f"{name} {quantity(n)}" for name, n in c.parameters.items()),
             listed(c.cannot_be_told_from, "or") or "nothing in the catalogue",
             f"{percent(c.gain.test)} of the {channel(c.gain.channel)} error", interval(c.gain))
            for c in d.causes]
    rows += [(name, (true or {})[name], "not named", "-", "-", "-")
             for name in hidden if name not in named]
    head: tuple[str, ...] = ("effect", "in the car", "found", "cannot be told from", "removes",
                             "95 %")
    if true is None:
        head, *rows = [(row[0], *row[2:]) for row in (head, *rows)]
    return table(head, rows) if rows else Html()


def pictures(d: Diagnosis) -> Html:
    """Where each cause shows, before and after it is in the model; then the errors step by step."""
    rows, drawn = Rows(d.evidence, d.extended), list[Html]()
    for i, cause in enumerate(d.causes):
        before, after = stages_of(d, i)
        shown = most(rows, columns(d.evidence, cause.gain.channel), before, after)
        if shown is not None:
            words = (f"{cause.effect}: {shown.column.words}, along {variable(shown.variable)}; "
                     f"{share_gone(shown)} of its mean square went with this structure")
            drawn.append(el("figure", el("figcaption", words), before_after(shown, cause.effect)))
    key = [svg.legend([("before", "before"), ("after", "with the cause in the model")])]
    steps = el("ol", *(el("li", s.label) for s in d.stages), start="0", class_="soft")
    return join([*([el("div", *drawn, class_="figures"), *key] if drawn else []),
                 el("h3", "Error at 1 s, step by step"), steps,
                 el("div", *staircase(d), class_="figures")])


def _report(page: str) -> Html:
    return el("p", el("a", "The full report: every figure, and how it was made", href=page,
                      class_="button"))
