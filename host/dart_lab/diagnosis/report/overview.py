"""Top of the page: verdict, paths in two windows, errors by model, share of each step."""

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
from .explain import describe_cause, describe_claim
from .summary import headline, summary_lines, tone
from .words import CHANNEL_LABELS, channel, error_figure

CONSTANT_VELOCITY = "constant velocity"
NOISE_FLOOR = "noise floor"
# Colour and mark of each model in all pictures of the overview.
STYLES = {MEASURED: "car", CONSTANT_VELOCITY: "other", NOISE_FLOOR: "floor", "given": "before",
          "refitted": "refit", "extended": "after"}
MODELS = {"given": "model as given", "refitted": "parameters refitted",
          "extended": "with the causes", NOISE_FLOOR: "noise floor: a model without any fault"}
STEP_TITLES = {"refitted": "by the refit", "extended": "by the causes"}
WHAT_FLOOR = ("Noise floor: the error that a model without any fault would have on these "
              "recordings, from disturbances, measurement noise and the unknown ages of commands.")
MARK_SPACING = 0.5  # s
# m between two lines that cover each other in the picture.
SAME_PATH = 0.01
NO_PATH = "Without motion capture there is no measured path to draw."


def verdict_card(d: Diagnosis) -> Html:
    """Draw the box with the verdict."""
    return page.card(el("p", headline(d), class_="big"), *map(_line, summary_lines(d)),
                     tone=tone(d))


def _line(line: str) -> Html:
    """Draw a line of the summary; its first word is bold where a colon follows."""
    lead, colon, rest = line.partition(": ")
    return el("p", el("strong", f"{lead}: "), rest) if colon and " " not in lead else el("p", line)


def problem_card(d: Diagnosis) -> Html:
    """Draw the box with the limits of all numbers: problems of the data, and of the model."""
    problems = [*data_problems(d), *model_problems(d)]
    return page.card(el("p", "Before you rely on the numbers", class_="big"),
                     page.items(problems), tone="bad") if problems else Html()


def answer_card(d: Diagnosis, *after: Html, report: str = "") -> Html:
    """Draw the box with verdict and findings, each with a link to its evidence on ``report``."""
    found = [(describe_claim(c)["What"], "claims") for c in d.claims]
    found += [(describe_cause(d, i)["What"], f"cause-{i + 1}") for i in range(len(d.causes))]
    return page.card(
        el("p", headline(d), class_="big"),
        page.items((join([what, " ", el("a", "evidence", href=f"{report}#{anchor}")])
                    for what, anchor in found), "ol"), *after, tone=tone(d))


def overview(d: Diagnosis) -> Html:
    """Draw the paths; next to them the errors of all models, and the share of each step."""
    bars = _error_figure(d)
    if not (d.paths or bars):
        return Html()
    shown = [MEASURED] * bool(d.paths) + [
        name for name, errors in _errors(d).items() if errors]
    key = svg.legend([(STYLES[name], MODELS.get(name, name)) for name in shown])
    return join([key, el("div", el("div", _path_figures(d.paths)),
                         el("div", bars, page.small_print(WHAT_FLOOR) if d.noise_floor else Html(),
                            shares(d)), class_="pair")])


def _errors(d: Diagnosis) -> dict[str, dict[str, tuple[float, float]]]:
    """Return by model the RMSE and the median 1 s ahead of each channel that is known."""
    models = {CONSTANT_VELOCITY: d.ctrv, **{name: stage.horizons for name,
                                            stage in d.compared.items()}}
    out = {model: {c: (error_figure(errors, HORIZON, c), error_figure(errors, HORIZON, c, "median"))
                   for c in PREDICTED} for model, errors in models.items()}
    out[NOISE_FLOOR] = {c: (value, math.nan) for c, value in d.noise_floor.items()}
    return {model: {c: both for c, both in errors.items() if not math.isnan(both[0])}
            for model, errors in out.items()}


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
    return page.figure(
        f"{window.kind.capitalize()} window: {significant(window.error)} m off after 2 s "
        f"({short(window.file)}, from {window.second:.2f} s)",
        charts.draw_paths(f"Path in the {window.kind} window", "ahead of the start [m]",
                          "to the left [m]", lines, round(MARK_SPACING / window.step)))


def _error_figure(d: Diagnosis) -> Html:
    """Draw the RMSE of all models 1 s ahead, one group of bars for each channel."""
    models = _errors(d)
    groups = [(f"{channel(name)} [{CHANNEL_LABELS[name][1]}]",
               [(*errors[name], STYLES[model]) for model, errors in models.items()
                if name in errors]) for name in PREDICTED]
    groups = [(words, bars) for words, bars in groups if bars]
    if not groups:
        return Html()
    return page.figure("Error 1 s ahead on the test recordings: RMSE, with a black tick at the "
                       "median; each channel to its own scale",
                       charts.draw_grouped_bars("Error 1 s ahead by channel and model", groups))


def shares(d: Diagnosis) -> Html:
    """Tabulate what each step changes of the error 1 s ahead, by channel."""
    head = ("channel", *(STEP_TITLES[name] for name in list(d.compared)[1:]))
    rows = [(channel(name), *(c.summary for c in changes))
            for name in PREDICTED if (changes := step_changes(d, name))]
    counted = any(c.counts for name in PREDICTED for c in step_changes(d, name))
    return join([page.small_print("Change of the RMSE 1 s ahead by each step" + (
        f", and test recordings better:worse, by {100.0 * MIN_ERROR_CHANGE:g} % or more"
        if counted else "")), table(head, rows)]) if rows else Html()
