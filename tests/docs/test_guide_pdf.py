"""The guide as one PDF: every page, the log, the bill, and sheets at full size."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "docs"), str(ROOT / "hardware")]


@pytest.mark.slow
def test_the_pdf_holds_the_guide(tmp_path):
    pytest.importorskip("sphinx")
    weasyprint = pytest.importorskip("weasyprint")
    import guide
    import guide_pdf

    file = guide_pdf.page(tmp_path)
    text = file.read_text(encoding="utf-8")
    for step in guide.steps():
        assert f"{step.id}: " in text
    for image in re.findall(r'<img[^>]* src="([^":]+)"', text):
        assert (file.parent / image).is_file(), image
    pages = weasyprint.HTML(str(file)).render(presentational_hints=True).pages
    assert len(pages) > 50
    a4 = [210 / 25.4 * 96, 297 / 25.4 * 96]  # CSS pixels
    for page in pages[-len(guide_pdf.SHEETS):]:
        assert [page.width, page.height] == pytest.approx(a4, abs=0.1)
