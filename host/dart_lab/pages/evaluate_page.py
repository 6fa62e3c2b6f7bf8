"""HTML page of ``dart-hal evaluate --html``: errors, pictures, recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dart_lab.identification.evaluation import CHANNELS, ERROR_UNITS, HORIZONS, Evaluation
from dart_lab.identification.evaluation.pictures import TITLES, figures
from dart_lab.pages.evaluate_table import CHANNEL_TITLES, describe_gains, list_cautions
from dart_lab.report import charts, page
from dart_lab.report.html import Html, el, join, table
from dart_lab.report.numbers import join_names, significant
from dart_lab.report.page import image

ERROR_COLUMNS = [f"{head} [{unit}]" for head, unit in zip(CHANNEL_TITLES, ERROR_UNITS, strict=True)]
FIGURE_TITLES = {"errors": "Error over the horizon, and by recording",
                 "windows": "Six windows, good to bad",
                 "kinematic_limit": "Where the kinematic model ends"}


def write_page(e: Evaluation, path: Path, answer: Mapping[str, Any],
               cautions: Sequence[str] = ()) -> Path:
    """Write the page; answer: JSON to embed; cautions: about the sizes of the car.

    Errors: OSError, UsageError without matplotlib.
    """
    drawn = [page.figure(FIGURE_TITLES[name], image(figure, FIGURE_TITLES[name]))
             for name, figure in figures(e).items()]
    heading, *gains = describe_gains(e)
    limit = e.limit.sentences() if e.limit is not None else []
    result = page.card(el("p", _verdict(e), class_="big"),
                       page.notices([*cautions, *(f"Caution: {w}" for w in list_cautions(e))]),
                       good=all(g.low > 0.0 for g in e.gain_over_ctrv(1.0).values()))
    folded = page.foldable(heading[:1].upper() + heading[1:].rstrip(":"), page.items(gains))
    by_file = [row for file in e.model.slices for row in _rows(e, file, 1.0, file)]
    files = [(name, str(use.windows), "; ".join(use.why)) for name, use in e.prepared.files.items()]
    return page.write(path, page.page(
        f"evaluation of {e.vehicle.name}",
        f"How well {e.vehicle.name} ({e.vehicle.kind}) predicts, open loop",
        join([result, _draw_errors(e), folded]), {
            "errors": ("Errors by horizon", _error_table(
                [row for h in HORIZONS for row in _rows(e, f"after {h:g} s", h, None)])),
            "pictures": ("Pictures", join(drawn)),
            "limit": ("How far the kinematic model reaches", page.items(limit)),
            "recordings": ("Errors after 1 s by recording", _error_table(by_file)),
            "files": ("Recordings", table(("file", "windows", "why"), files)),
            "numbers": ("All numbers", page.download(answer, "evaluation.json"))}))


def _verdict(e: Evaluation) -> str:
    """State which channels are predicted better than by constant velocity, and which worse.

    A channel counts where the 95 % interval of its gain excludes 0.
    """
    gains = dict(zip(CHANNELS, e.gain_over_ctrv(1.0).values(), strict=True))
    better = [TITLES[c] for c, g in gains.items() if g.low > 0.0]
    worse = [TITLES[c] for c, g in gains.items() if g.high < 0.0]
    parts = [f"{join_names(names, 'and')} {word} than constant velocity"
             for names, word in ((better, "better"), (worse, "worse")) if names]
    if not parts:
        return f"{e.vehicle.name} and constant velocity do not differ significantly, 1 s ahead."
    return f"{e.vehicle.name} predicts {', but '.join(parts)}, 1 s ahead."


def _draw_errors(e: Evaluation) -> Html:
    """Draw the RMSE 1 s ahead of constant velocity and the model; ticks are medians."""
    rows = [charts.BarRow(name, style, [score.rmse(1.0)[c] for c in CHANNELS],
                          [score.median(1.0)[c] for c in CHANNELS])
            for name, style, score in (("constant velocity", "other", e.ctrv),
                                       (e.vehicle.name, "after", e.model))]
    return charts.tabulate_bars("Error left 1 s ahead: RMSE, each column to its own scale; black "
                                "tick: median", ERROR_COLUMNS, rows)


def _error_table(rows: Sequence[Sequence[str]]) -> Html:
    return table(("", "", "windows", *ERROR_COLUMNS), rows, 2,
                 "RMSE, in brackets the median; CTRV: constant turn rate and velocity")


def _rows(e: Evaluation, name: str, horizon: float, file: str | None) -> list[list[str]]:
    """Return the row of the model and the row of constant turn rate and velocity (CTRV)."""
    n = str(e.model.errors[..., e.model.slices[file] if file else slice(None)].shape[-1])
    rows = []
    for start, score in ((name, "model", n), e.model), (("", "CTRV", ""), e.ctrv):
        rmse = score.rmse(horizon, file)
        median = score.median(horizon, file)
        rows.append([*start, *(f"{significant(rmse[c])} ({significant(median[c])})"
                               for c in CHANNELS)])
    return rows
