"""The bill of materials: the paper's rows as the paper sums them."""

import csv
from pathlib import Path

ROOT = Path(__file__).parents[2]


def rows() -> list[dict[str, str]]:
    with (ROOT / "hardware" / "bom.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_the_papers_eight_rows_add_up_to_its_total():
    paper = [r for r in rows() if r["tier"] == "paper"]
    assert len(paper) == 8
    assert sum(int(r["quantity"]) * float(r["unit_price_eur"]) for r in paper) == 670.0


def test_every_row_is_complete():
    for row in rows():
        wanted = ("tier", "part", "quantity", "unit_price_eur", "purpose", "search_for")
        missing = [k for k in wanted if not row[k]]
        assert not missing, f"{row['part']}: {', '.join(missing)} missing"


def test_gpl_stays_in_the_emulator():
    """simavr is GPL-3: only the bridge that links it carries that licence."""
    marked = {p.relative_to(ROOT).parts[:2] for folder in ("firmware", "host")
              for p in (ROOT / folder).rglob("*") if p.suffix in {".c", ".h", ".cpp", ".py"}
              and "build" not in p.parts
              and "GPL-3.0-or-later" in p.read_text(encoding="utf-8")[:80]}
    assert marked == {("firmware", "emulator")}
