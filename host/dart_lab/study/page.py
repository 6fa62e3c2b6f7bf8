"""The page of a study: one verdict for each stage, then its table."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from dart_lab.report import charts, page
from dart_lab.report.html import Html, el, join, table

from .stages import DIAGNOSIS_PAGE, STAGES, StageResult

PAGE = "index.html"
# Colour of each model in the first picture.
STYLES = {"start": "before", "fitted": "after", "constant velocity": "other"}


# Stages whose table is the result; those of the others open by a click.
OPEN_TABLES = ("validation",)


def _show_table(result: StageResult) -> Html:
    """Return the table of a stage."""
    if not result.rows:
        return Html()
    shown = table(result.rows[0], result.rows[1:], numbers=0)
    return shown if result.stage in OPEN_TABLES else page.foldable("table", shown)


def write_study_page(results: Mapping[str, StageResult], path: Path, car: str) -> Path:
    """Write the page of all stages that were run. Raises OSError."""
    sections = {}
    for stage, question in STAGES.items():
        result = results.get(stage)
        if result is None:
            content = page.small_print(f"not run: --stage {stage}")
        else:
            content = join((
                page.card(el("p", result.verdict), good=result.sound,
                          tone="" if result.sound else "bad"),
                page.items(result.lines),
                _show_table(result),
                el("p", el("a", "the whole report of the diagnosis", href=DIAGNOSIS_PAGE))
                if stage == "diagnosis" else Html()))
        sections[stage] = (f"{stage.capitalize()}: {question}", content)
    verdicts = page.items(f"{stage}: {result.verdict}" for stage, result in results.items())
    lead = join((_draw_validation(results), verdicts))
    return page.write(path, page.page(f"study of {car}", f"Study of {car}", lead, sections))


def _draw_validation(results: Mapping[str, StageResult]) -> Html:
    """Draw the errors of the models that the validation compares; empty if it was not run."""
    result = results.get("validation")
    if result is None or len(result.rows) < 2:
        return Html()
    (_, *models), *rows = result.rows
    bars = [charts.BarRow(name, STYLES.get(name, "car"), [float(row[i + 1]) for row in rows])
            for i, name in enumerate(models)]
    return charts.tabulate_bars("Error left 1 s ahead on the test recordings: RMSE, each column to "
                                "its own scale", [row[0] for row in rows], bars)
