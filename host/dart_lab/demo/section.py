"""Sections of the demo's page on a diagnosis: sentences, pictures, errors, link to the report."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import islice
from typing import Any

from dart_lab.demo.diagnosis import (
    FIRST_DRIVE_S,
    SECOND_DRIVE_S,
    THIRD_DRIVE_S,
    DiagnosisChapter,
    describe_effect,
    describe_values,
)
from dart_lab.diagnosis.report import describe_pattern
from dart_lab.diagnosis.report.along import ResidualRows
from dart_lab.diagnosis.report.causes import LEGEND, cause_pictures
from dart_lab.diagnosis.report.overview import overview, verdict_section
from dart_lab.diagnosis.report.words import channel, interval, quantity
from dart_lab.diagnosis.result import Diagnosis
from dart_lab.report import page
from dart_lab.report.html import Html, el, join, table
from dart_lab.report.numbers import join_names, percent

# Patterns without a cause that are described; the report has all.
MAX_PATTERNS = 2
# Effects that a car of a seed has from the start, and the names of their sizes [rad] in the truth.
BUILT_IN_ANGLES = {"imu_yaw": "imu.mount_yaw", "imu_pitch": "imu.mount_pitch",
                   "imu_roll": "imu.mount_roll"}
HIDDEN_TITLE = "Two things were changed in this car. Which?"
REAL_TITLE = "The real car: what the paper's model gets wrong"


def hidden_section(chapter: DiagnosisChapter, sensors: Mapping[str, Any]) -> Html:
    """Describe what was changed in the emulated car, and what was found; sensors: their truth."""
    true = {name: f"k {sensors[key]:.3g} rad, built so" for name, key in BUILT_IN_ANGLES.items()}
    true |= {a.name: f"{describe_values(a)}, put in" for a in chapter.hidden}
    how = (f"The car was driven for {FIRST_DRIVE_S:.0f} s as it was. The paper's model, with the "
           "speed of the servo from its data sheet, was fitted to that drive: that is all that is "
           "known of the healthy car. Then it was changed. The diagnosis had that model "
           f"and a recorded drive of {SECOND_DRIVE_S:.0f} s; how much a cause gains is measured on "
           f"another one of {THIRD_DRIVE_S:.0f} s. It uses encoder, gyro and accelerometer only.")
    named = "Named." if chapter.found else "Not named: this drive did not show it well enough."
    changed = el("p", el("strong", "What was changed: "),
                 "; ".join(describe_effect(a) for a in chapter.hidden), ". ", named)
    return _diagnosis_section(chapter.diagnosis, how, chapter.files["diagnosis"].name,
                    changed, el("p", _describe_built_in(sensors)),
                    _tabulate_causes(chapter.diagnosis, true, [a.name for a in chapter.hidden]))


def _describe_built_in(sensors: Mapping[str, Any]) -> str:
    """Describe other differences of this car from its model."""
    turned = [math.degrees(sensors[key]) for key in BUILT_IN_ANGLES.values()]
    if max(map(abs, turned)) < 0.01:
        return "Nothing else is different from its model."
    yaw, pitch, roll = (f"{angle:+.1f} deg" for angle in turned)
    return ("True of this car from the start, and unknown to its model: the IMU is misaligned (yaw "
            f"{yaw}, pitch {pitch}, roll {roll}), and the ring of the encoder is uneven.")


def real_section(d: Diagnosis, train: Sequence[str], test: Sequence[str], report: str) -> Html:
    """Describe what the paper's model gets wrong on recordings of the real car."""
    how = ("Recordings of the real car with motion capture, from the excerpt that comes with the "
           f"sources. Causes are searched in those until 9 September 2024 ({', '.join(train)}); "
           f"how much they gain is measured on later days ({', '.join(test)}), which no fit "
           "uses. Step 1 is the given model with its parameters fitted again: a cause explains "
           "what that cannot. There is no ground truth for this car.")
    return _diagnosis_section(d, how, report, _tabulate_causes(d))


def real_skipped() -> Html:
    """Text for an installation without the recordings."""
    return el(
        "p", "Skipped: the excerpt of the real car's recordings comes with the sources, and this "
             "installation is without them. ", el("code", "dart-hal data fetch"), " brings all of "
             "them, ", el("code", "dart-hal diagnose --model paper --train FOLDER"),
        " does the same on any.", class_="notice")


def _diagnosis_section(d: Diagnosis, how: str, report: str, *known: Html) -> Html:
    """Answer with paths and errors, what is known of the truth, and where each cause shows."""
    more = len(d.unexplained) - MAX_PATTERNS
    rows = ResidualRows(d.evidence, d.extended)
    patterns = [describe_pattern(d, u, rows) for u in d.unexplained[:MAX_PATTERNS]]
    patterns += [f"and {more} more, see the report"] if more > 0 else []
    unexplained = ([page.foldable("Patterns without a cause", page.items(patterns))]
                   if patterns else [])
    figures = [one for i in range(len(d.causes)) for one in islice(cause_pictures(d, i, rows), 1)]
    return join([
        # The verdict is first; the details of the method are folded.
        verdict_section(d, report), *known, *unexplained,
        page.foldable("How this was done", el("p", how)), overview(d),
        page.figures(figures), *([LEGEND] if figures else []),
        el("p", el("a", "The full report: every figure, and how it was made", href=report,
                   class_="button"))])


def _tabulate_causes(d: Diagnosis, true: Mapping[str, str] | None = None, hidden: Sequence[str] = ()
           ) -> Html:
    """Tabulate each cause, and each hidden effect that was not accepted; true: None if unknown."""
    rows = [(c.effect, (true or {}).get(c.effect, "-"),
             ", ".join(f"{name} {quantity(n)}" for name, n in c.parameters.items()),
             join_names(c.cannot_be_told_from, "or") or "nothing in the catalogue",
             f"{percent(c.gain.test)} of the {channel(c.gain.channel)} error", interval(c.gain))
            for c in d.causes]
    named = [c.effect for c in d.causes]
    rows += [(name, (true or {})[name], "not named", "-", "-", "-")
             for name in hidden if name not in named]
    head = ("effect", "in the car", "found", "confounded with", "removes", "95 %")
    if true is None:
        return table((head[0], *head[2:]), [(row[0], *row[2:]) for row in rows])
    return table(head, rows)
