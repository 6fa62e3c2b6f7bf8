"""Requests of a page, written by a verb, to the network: there must be none."""

from __future__ import annotations

import re

EMBEDDED = re.compile(r'base64,[^"]*')
OUTSIDE = re.compile(r"https?://(?!localhost:8642/#t=)|@import|url\(|<script|<link|<iframe")


def strip_data(page: str) -> str:
    """The page without the data that it carries."""
    return EMBEDDED.sub("", page)


def foreign(page: str) -> list[str]:
    """All that a browser would fetch or run."""
    return OUTSIDE.findall(strip_data(page))
