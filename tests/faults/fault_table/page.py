"""docs/results/fault_table.md: written from the rows, the layers and the figures that were kept."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from fault_table.judge import Verdict
from fault_table.layers import LAYERS
from fault_table.row import Case, Row
from fault_table.table import ROWS

CHECKOUT = Path(__file__).resolve().parents[3]
PAGE = CHECKOUT / "docs" / "results" / "fault_table.md"
FIGURES = Path(__file__).parent / "figures.json"

HEAD = Path(__file__).parent / "page_head.md"


def key(row: int, case: Case) -> str:
    return f"{row} {case.world} {case.what}"


def load_figures() -> dict[str, dict[str, Any]]:
    """Figures of the last full run; null is never."""
    if not FIGURES.is_file():
        return {}
    found: dict[str, dict[str, Any]] = json.loads(FIGURES.read_text(encoding="utf-8"))
    return found


def keep(verdicts: list[tuple[Row, Verdict]]) -> None:
    """Add these figures to those that are kept; cases that are gone are forgotten."""
    figures = load_figures()
    for row, verdict in verdicts:
        figures[key(row.number, verdict.case)] = {
            "measured": _number(verdict.measured.value),
            "control": _number(verdict.control.value) if verdict.control else None}
    known = [key(row.number, case) for row in ROWS for case in row.cases]
    ordered = {name: figures[name] for name in known if name in figures}
    FIGURES.write_text(json.dumps(ordered, indent=1) + "\n", encoding="utf-8")


def _number(value: float) -> float | str:
    if math.isnan(value):
        return "broke down"
    return "never" if math.isinf(value) else round(value, 3)


def _format_figure(figures: dict[str, Any], name: str, unit: str) -> str:
    value = figures.get(name)
    if value is None:
        return "-"
    return value if isinstance(value, str) else f"{value:.4g} {unit}"


def text() -> str:
    """The page."""
    figures = load_figures()
    lines = ["| # | fault | reaction | world | case | limit | last measured | "
             "without | then |", "|---|---|---|---|---|---|---|---|---|"]
    for row in ROWS:
        for n, case in enumerate(row.cases):
            own = figures.get(key(row.number, case), {})
            head = f"{row.number} | {row.fault} | {row.reaction}" if n == 0 else " | | "
            world = case.world + (", hil" if case.hil else "")
            lines.append(f"| {head} | {world} | {case.what} | {case.limit:.4g} {case.unit} | "
                         f"{_format_figure(own, 'measured', case.unit)} | "
                         f"{' + '.join(case.control)} | "
                         f"{_format_figure(own, 'control', case.unit)} |")
    lines += ["", "## Layers and their switches\n",
              "The suite removes a layer by replacing a name of the product, or by changing",
              "sources of the firmware before the build. The product itself has no such switch.\n",
              "| layer | what it does | what is taken away |", "|---|---|---|"]
    for layer in LAYERS.values():
        where = f"`{layer.target}`" if layer.target else ", ".join(
            f"`firmware/{name}`" for name in dict.fromkeys(c[0] for c in layer.changes))
        lines.append(f"| `{layer.name}` | {layer.does} | {where} |")
    return HEAD.read_text(encoding="utf-8") + "\n".join(lines) + "\n"


def write() -> None:
    """Write the page."""
    PAGE.write_text(text(), encoding="utf-8")
