"""What the demo's page says of a diagnosis: the sentences, one picture, the errors, the report."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import islice
from typing import Any

from dart_lab.demo.diagnosis import AFTER, BEFORE, UNSEEN, Chapter, as_hidden, values_of
from dart_lab.diagnosis.report import describe_pattern
from dart_lab.diagnosis.report.along import ResidualRows
from dart_lab.diagnosis.report.causes import LEGEND, cause_pictures
from dart_lab.diagnosis.report.overview import answer_card, overview
from dart_lab.diagnosis.report.words import channel, interval, quantity
from dart_lab.diagnosis.result import Diagnosis
from dart_lab.report import page
from dart_lab.report.html import Html, el, join, table
from dart_lab.report.numbers import listed, percent

LEFT = 2
"""Structures without a cause that are written out; the report has all."""
BUILT = {"imu_yaw": "imu.mount_yaw", "imu_pitch": "imu.mount_pitch", "imu_roll": "imu.mount_roll"}
"""Effects that a car of a seed has from the start, and what the truth calls their sizes [rad]."""
HIDDEN = "Two things were changed in this car. Which?"
REAL = "The real car: what the paper's model gets wrong"


def hidden_section(told: Chapter, sensors: Mapping[str, Any]) -> Html:
    """What was changed in the emulated car, and what was found of it; sensors: their truth."""
    true = {name: f"k {sensors[key]:.3g} rad, built so" for name, key in BUILT.items()}
    true |= {a.name: f"{values_of(a)}, put in" for a in told.hidden}
    how = (f"The car was driven for {BEFORE:.0f} s as it was. The paper's model, with the speed "
           "of the servo from its data sheet, was fitted to that drive: that is all that is known "
           "of the healthy car. Then it was changed. The diagnosis had that model "
           f"and a recorded drive of {AFTER:.0f} s; how much a cause gains is measured on another "
           f"one of {UNSEEN:.0f} s. Encoder, gyro and accelerometer are all that it sees.")
    named = "Named." if told.found else "Not named: this drive did not show it well enough."
    changed = el("p", el("strong", "What was changed: "),
                 "; ".join(as_hidden(a) for a in told.hidden), ". ", named)
    return _section(told.diagnosis, how, told.files["diagnosis"].name,
                    changed, el("p", _as_built(sensors)),
                    _found(told.diagnosis, true, [a.name for a in told.hidden]))


def _as_built(sensors: Mapping[str, Any]) -> str:
    """What else is true of this car and not in its model."""
    turned = [math.degrees(sensors[key]) for key in BUILT.values()]
    if max(map(abs, turned)) < 0.01:
        return "Nothing else is different from what its model can say."
    yaw, pitch, roll = (f"{angle:+.1f} deg" for angle in turned)
    return ("True of this car from the start, and unknown to its model: the IMU sits askew (yaw "
            f"{yaw}, pitch {pitch}, roll {roll}), and the ring of the encoder is uneven.")


def real_section(d: Diagnosis, train: Sequence[str], test: Sequence[str], report: str) -> Html:
    """What the paper's model gets wrong on recordings of the real car."""
    how = ("Recordings of the real car with motion capture, from the excerpt that comes with the "
           f"sources. Causes are looked for in those until 9 September 2024 ({', '.join(train)}); "
           f"how much they gain is measured on later days ({', '.join(test)}), of which no fit "
           "has seen anything. Step 1 is the model as it is, its parameters fitted anew: a cause "
           "is what that cannot do. There is no ground truth for this car.")
    return _section(d, how, report, _found(d))


def real_skipped() -> Html:
    """Where the package is installed without its recordings."""
    return el(
        "p", "Skipped: the excerpt of the real car's recordings comes with the sources, and this "
             "installation is without them. ", el("code", "dart-hal data fetch"), " brings all of "
             "them, ", el("code", "dart-hal diagnose --model paper --train FOLDER"),
        " does the same on any.", class_="notice")


def _section(d: Diagnosis, how: str, report: str, *known: Html) -> Html:
    """The answer with paths and errors, what is known of the truth, where each cause shows."""
    more = len(d.unexplained) - LEFT
    rows = ResidualRows(d.evidence, d.extended)
    left = [describe_pattern(d, u, rows) for u in d.unexplained[:LEFT]]
    left += [f"and {more} more, see the report"] if more > 0 else []
    without = [el("p", "Left without a cause:"), page.items(left)] if left else []
    drawn = [one for i in range(len(d.causes)) for one in islice(cause_pictures(d, i, rows), 1)]
    return join([
        el("p", how), answer_card(d, *without, report=report), overview(d), *known,
        page.figures(drawn), *([LEGEND] if drawn else []),
        el("p", el("a", "The full report: every figure, and how it was made", href=report,
                   class_="button"))])


def _found(d: Diagnosis, true: Mapping[str, str] | None = None, hidden: Sequence[str] = ()
           ) -> Html:
    """One row for each cause, and for what was hidden and not named; true None: nobody knows."""
    rows = [(c.effect, (true or {}).get(c.effect, "-"),
             ", ".join(f"{name} {quantity(n)}" for name, n in c.parameters.items()),
             listed(c.cannot_be_told_from, "or") or "nothing in the catalogue",
             f"{percent(c.gain.test)} of the {channel(c.gain.channel)} error", interval(c.gain))
            for c in d.causes]
    named = [c.effect for c in d.causes]
    rows += [(name, (true or {})[name], "not named", "-", "-", "-")
             for name in hidden if name not in named]
    head = ("effect", "in the car", "found", "cannot be told from", "removes", "95 %")
    if true is None:
        return table((head[0], *head[2:]), [(row[0], *row[2:]) for row in rows])
    return table(head, rows)
