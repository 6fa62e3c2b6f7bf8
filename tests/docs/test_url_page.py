"""The page of the URLs lists every option that a scheme takes, and no other."""

from __future__ import annotations

import re

import pytest
from handbook import DOCS

from dart_hal.core.errors import UsageError
from dart_hal.devices.links.base import open_backend

URLS_PAGE = (DOCS / "reference" / "urls.md").read_text(encoding="utf-8")


def options(title: str) -> set[str]:
    """Names in the first table of options of a section."""
    section = URLS_PAGE.split(f"\n## {title}\n", 1)[1].split("\n## ", 1)[0]
    rows = section.partition("| option |")[2].partition("\n\n")[0]
    return set(re.findall(r"^\| `(\w+)` \|", rows, re.MULTILINE))


def list_names(url: str) -> set[str]:
    """Names that a scheme lists when it refuses one that it does not know."""
    with pytest.raises(UsageError, match="has no option colour") as refused:
        open_backend(f"{url}?colour=1")
    expected = str(refused.value.expected)
    return set() if expected == "no options" else set(expected.split(", "))


@pytest.mark.parametrize(("title", "url"), [
    ("sim", "sim://"), ("avr", "avr://default"), ("serial and hwgrep", "serial:///dev/none"),
    ("serial and hwgrep", "hwgrep://1A86:7523"), ("replay", "replay://run.mcap")])
def test_the_options_of_a_scheme(title, url):
    assert options(title) == list_names(url)


def test_an_option_that_is_not_listed_is_detected():
    assert options("sim") != list_names("avr://default")
