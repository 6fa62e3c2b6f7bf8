"""Links of the handbook lead somewhere, its folders are by kind, and it is one whole."""

from __future__ import annotations

import re

import handbook
import pytest
from handbook import DOCS, ROOT

SECTIONS = {"tutorials", "notebooks", "gallery", "build_guide", "how_to", "use_cases", "reference",
            "explanation", "contributing", "results"}
WORDS = 900  # of the README


@pytest.mark.parametrize("page", handbook.pages(), ids=lambda p: str(p.relative_to(ROOT)))
def test_every_link_leads_somewhere(page):
    assert handbook.broken_links(page, page.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("link", ["how_to/nothing.md", "how_to/faq.md#why-not", "#nowhere"])
def test_a_broken_link_is_detected(link):
    text = f"# Head\n\nSee [this]({link}) and [that](#head).\n"
    assert handbook.broken_links(DOCS / "index.md", text) == [link]


def list_pages() -> list[str]:
    text = (DOCS / "index.md").read_text(encoding="utf-8")
    return [line for toc in re.findall(r"```\{toctree\}\n(.*?)```", text, re.DOTALL)
            for line in toc.splitlines() if line and not line.startswith(":")]


def test_every_page_has_its_place_by_kind():
    found = {str(p.relative_to(DOCS).with_suffix("")) for p in handbook.pages()
             if DOCS in p.parents and p != DOCS / "index.md"}
    found |= {f"notebooks/{p.stem}" for p in (DOCS / "notebooks").glob("*.ipynb")}
    assert found == set(list_pages())
    assert {name.split("/")[0] for name in found} == SECTIONS


def readme() -> str:
    return (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_readme_is_short():
    assert len(readme().split()) <= WORDS


FIGURE = re.compile(r"(?<![\w./-])\d+(?:[.,]\d+)?(?![\w/])")


def test_a_result_in_the_readme_is_next_to_its_command():
    """Bold figures are results: each card has a command that makes it again."""
    cards = [row for row in readme().splitlines() if row.startswith("| **")]
    assert len(cards) == 5
    for row in cards:
        assert FIGURE.search(re.sub(r"`[^`]*`", "", row)), row
        assert re.search(r"`(?:make|dart-hal|python) [^`]+`", row), row


def test_results_state_when_they_were_measured():
    undated = [p.name for p in (DOCS / "results").glob("*.md")
               if not re.search(r"\b20\d\d\b", "\n".join(
                   p.read_text(encoding="utf-8").splitlines()[:40]))]
    assert undated == []
