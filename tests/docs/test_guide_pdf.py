"""The guide as one PDF: every page, the log, the bill, and sheets at full size."""

from __future__ import annotations

import re
import sys

import pytest

from tests.common import ROOT

sys.path[:0] = [str(ROOT / "docs"), str(ROOT / "hardware")]


@pytest.mark.parametrize("name", ["routing_minimal", "routing_cutoff"])
def test_a_plan_is_printed_at_its_own_size(name):
    """Read as text: what prints them is installed by `make guide` alone."""
    style = (ROOT / "docs" / "guide_pdf.py").read_text(encoding="utf-8")
    [svg] = (ROOT / "hardware" / "wiring").glob(f"{name}*.svg")
    wide, high = re.search(r"width='(\d+)mm' height='(\d+)mm'",
                           svg.read_text(encoding="utf-8")).groups()
    assert f'img[src*="{name}"] {{ width: {wide}mm !important }}' in style
    assert int(high) <= 297 - 2 * 8, "one sheet of A4"


@pytest.mark.long
def test_the_pdf_holds_the_guide(tmp_path):
    pytest.importorskip("sphinx")
    weasyprint = pytest.importorskip("weasyprint")
    import guide
    import guide_pdf

    file = guide_pdf.page(tmp_path)
    text = file.read_text(encoding="utf-8")
    for step in guide.steps():
        assert f"{step.id}: " in text
    assert text.count('<div class="tall">') == 1, "the routing plan has a sheet of its own"
    for image in re.findall(r'<img[^>]* src="([^":]+)"', text):
        assert (file.parent / image).is_file(), image
    pages = weasyprint.HTML(str(file)).render(presentational_hints=True).pages
    assert len(pages) > 50
    a4 = [210 / 25.4 * 96, 297 / 25.4 * 96]  # CSS pixels
    for page in pages[-len(guide_pdf.SHEETS):]:
        assert [page.width, page.height] == pytest.approx(a4, abs=0.1)
