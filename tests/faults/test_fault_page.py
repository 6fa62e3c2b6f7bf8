"""The page in the handbook matches the rows."""

from __future__ import annotations

from fault_table import page
from fault_table.table import LAYERS, ROWS


def test_the_page_is_written_from_the_rows():
    assert page.PAGE.read_text(encoding="utf-8") == page.text(), 'make faults ARGS="--page"'


def test_every_row_and_layer_is_on_it():
    text = page.text()
    assert all(f"| {row.number} | {row.fault} |" in text for row in ROWS)
    assert all(f"| `{name}` |" in text for name in LAYERS)


def test_a_row_that_changes_is_detected():
    """The control of the first."""
    assert page.text().replace("kill -9", "kill -15") != page.PAGE.read_text(encoding="utf-8")


def test_the_handbook_links_it():
    index = page.PAGE.parents[1] / "index.md"
    assert "\nresults/fault_table\n" in index.read_text(encoding="utf-8")
