"""Top of the page: verdict, errors by model, a line for each cause; then paths and shares."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from dart_lab.diagnosis.error_summaries import PathWindow
from dart_lab.diagnosis.paths import MEASURED
from dart_lab.diagnosis.result import Diagnosis
from dart_lab.identification.evaluation import CHANNELS as PREDICTED
from dart_lab.identification.evaluation.cases import short
from dart_lab.report import charts, page, svg
from dart_lab.report.html import Html, el, join, table
from dart_lab.report.numbers import significant

from .compared import HORIZON, MIN_ERROR_CHANGE, step_changes
from .data_problems import data_problems, model_problems
from .findings import list_findings
from .summary import headline, motion_warnings, summary_lines, tone
from .words import CHANNEL_LABELS, channel, error_figure

CONSTANT_VELOCITY = "constant velocity"
NOISE_FLOOR = "noise floor"
# Colour and mark of each model in all pictures of the overview.
STYLES = {MEASURED: "car", CONSTANT_VELOCITY: "other", NOISE_FLOOR: "floor", "given": "before",
          "refitted": "refit", "extended": "after"}
ERROR_CAPTION = ("Error left 1 s ahead on the test recordings: RMSE, each column to its own scale; "
                 "black tick: median")
MODELS = {"given": "model as given", "refitted": "parameters refitted",
          "extended": "with the causes"}
STEP_TITLES = {"refitted": "by the refit", "extended": "by the causes"}
WHAT_FLOOR = ("Noise floor: the error of a model without any fault on these recordings, from"
              " disturbances, measurement noise and the unknown ages of commands.")
MARK_SPACING = 0.5  # s
# m between two lines that cover each other in the picture.
SAME_PATH = 0.01
NO_PATH = "Without motion capture there is no measured path to draw."


def verdict_section(d: Diagnosis, report: str = "") -> Html:
    """Draw verdict, errors by model, and one line for each cause with a link to its evidence."""
    caution = page.notices(motion_warnings(d))
    return join([page.card(el("p", headline(d), class_="big"), caution, tone=tone(d)),
                 error_bars(d), cause_lines(d, report)])


def sentences(d: Diagnosis) -> Html:
    """Fold the summary in sentences."""
    return page.foldable("In sentences", *map(_line, summary_lines(d)))


def _line(line: str) -> Html:
    """Draw a line of the summary; its first word is bold where a colon follows."""
    lead, colon, rest = line.partition(": ")
    return el("p", el("strong", f"{lead}: "), rest) if colon and " " not in lead else el("p", line)


def problem_card(d: Diagnosis) -> Html:
    """Draw the box with the limits of all numbers: problems of the data, and of the model."""
    problems = [*data_problems(d), *model_problems(d)]
    return page.card(el("p", "Before you rely on the numbers", class_="big"),
                     page.items(problems), tone="bad") if problems else Html()


def cause_lines(d: Diagnosis, report: str = "") -> Html:
    """Tabulate what was found, one line each: name, size, share, status."""
    rows = [[el("a", finding.name, href=f"{report}#{finding.anchor}"), finding.size,
             finding.share, finding.status] for finding in list_findings(d)]
    return table(("", "size", "effect on the errors", "status"), rows)


def overview(d: Diagnosis) -> Html:
    """Draw the paths; next to them the share of each step."""
    if not (d.paths or d.compared):
        return Html()
    key = svg.legend([(STYLES[name], MODELS.get(name, name)) for name in (MEASURED, *d.compared)]
                     ) if d.paths else Html()
    floor = page.small_print(WHAT_FLOOR) if d.noise_floor else Html()
    return join([key, el("div", el("div", _path_figures(d.paths)),
                         el("div", shares(d), floor), class_="pair")])


def error_bars(d: Diagnosis) -> Html:
    """Draw the RMSE 1 s ahead by channel: as given, refitted, and with each cause.

    Constant velocity and the noise floor are the first and the last row. Ticks are medians.
    """
    after = {stage.label: stage.horizons for stage in d.stages[len(d.compared) - bool(d.causes):]}
    models = {CONSTANT_VELOCITY: (CONSTANT_VELOCITY, d.ctrv),
              **{MODELS[name]: (name, stage.horizons) for name, stage in d.compared.items()
                 if name != "extended"},
              **{label: ("extended", horizons) for label, horizons in after.items()}}
    figures = [(label, STYLES[name], [[error_figure(horizons, HORIZON, c, kind) for c in PREDICTED]
                                      for kind in ("pooled", "median")])
               for label, (name, horizons) in models.items()]
    floor = [d.noise_floor.get(c, math.nan) for c in PREDICTED]
    figures.append((NOISE_FLOOR, STYLES[NOISE_FLOOR], [floor, [math.nan] * len(floor)]))
    known = [i for i in range(len(PREDICTED)) if any(
        not math.isnan(values[i]) for _, _, (values, _) in figures)]
    rows = [charts.BarRow(label, style, *([values[i] for i in known] for values in both))
            for label, style, both in figures if not all(math.isnan(both[0][i]) for i in known)]
    columns = [f"{channel(PREDICTED[i])} [{CHANNEL_LABELS[PREDICTED[i]][1]}]" for i in known]
    return charts.tabulate_bars(ERROR_CAPTION, columns, rows) if known else Html()


def _path_figures(windows: Sequence[PathWindow]) -> Html:
    """Draw the paths of windows, and state how they were chosen."""
    if not windows:
        return page.small_print(NO_PATH)
    first = windows[0]
    return join([*map(_path_figure, windows), page.small_print(
        f"Worst and median of {first.windows} windows of 2 s of the test recordings, by the "
        f"position error at their end ({MODELS[first.chosen_by]}). A mark each "
        f"{MARK_SPACING:g} s.{_same_path(windows)}")])


def _same_path(windows: Sequence[PathWindow]) -> str:
    """Explain why only one of two lines is visible: causes of sensors do not move the car."""
    without = "refitted" if "refitted" in windows[0].paths else "given"
    same = all("extended" in w.paths and np.allclose(
        w.paths["extended"], w.paths[without], atol=SAME_PATH, equal_nan=True) for w in windows)
    return (f" The causes change these paths by less than {100.0 * SAME_PATH:g} cm." if same
            else "")


def _path_figure(window: PathWindow) -> Html:
    """Draw the paths of one window."""
    lines = [(window.paths[name], STYLES[name]) for name in STYLES if name in window.paths]
    moment = page.link_replay(f"from {window.second:.2f} s", window.file, window.second)
    return page.figure(
        join([f"{window.kind.capitalize()} window: {significant(window.error)} m off after 2 s "
              f"({short(window.file)}, ", moment, ")"]),
        charts.draw_paths(f"Path in the {window.kind} window", "ahead of the start [m]",
                          "to the left [m]", lines, round(MARK_SPACING / window.step)))


def shares(d: Diagnosis) -> Html:
    """Tabulate what each step changes of the error 1 s ahead, by channel."""
    head = ("channel", *(STEP_TITLES[name] for name in list(d.compared)[1:]))
    rows = [(channel(name), *(c.summary for c in changes))
            for name in PREDICTED if (changes := step_changes(d, name))]
    counted = any(c.counts for name in PREDICTED for c in step_changes(d, name))
    return join([page.small_print("Change of the RMSE 1 s ahead by each step" + (
        f", and test recordings better:worse, by {100.0 * MIN_ERROR_CHANGE:g} % or more"
        if counted else "")), table(head, rows)]) if rows else Html()
