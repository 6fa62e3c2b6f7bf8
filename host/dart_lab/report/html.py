"""HTML and SVG from function calls; plain text is escaped."""

from __future__ import annotations

import html
import math
import re
from collections.abc import Iterable, Sequence

# Elements without an end tag.
VOID = frozenset({"br", "hr", "img", "meta", "wbr"})
# Characters up to which a table cell is kept on one line.
MAX_UNBROKEN_CELL = 24
# Markup within a cell, which has no width.
TAG = re.compile("<[^>]*>")


class Html(str):
    """Text that is markup, so it is not escaped."""

    __slots__ = ()


def el(name: str, /, *content: str, **attributes: str | float | None) -> Html:
    """Return one element.

    A trailing underscore of an attribute name is removed, the others become hyphens.

    Errors: ValueError for an attribute that is no finite number: it would not be drawn.
    """
    opened = f"<{name}{''.join(map(_attribute, attributes, attributes.values()))}>"
    if name in VOID:
        return Html(opened)
    return Html(f"{opened}{join(content)}</{name}>")


def join(content: Iterable[str]) -> Html:
    """Join pieces; plain text among them is escaped and typeset."""
    return Html("".join(c if isinstance(c, Html) else html.escape(_typeset(c)) for c in content))


def _typeset(text: str) -> str:
    """Set +-, -> and per cent so that no line breaks at them."""
    for plain, typeset in ((" +- ", "\u00a0\u00b1\u00a0"), (" -> ", "\u00a0\u2192\u00a0"),
                           (" %", "\u00a0%")):
        text = text.replace(plain, typeset)
    return text


def table(head: Sequence[str], rows: Iterable[Sequence[str]], numbers: int = 99,
          caption: str = "") -> Html:
    """Return a table that scrolls sideways if it is too wide; empty without rows.

    Columns from ``numbers`` on are aligned right, except for long cells. A long cell breaks
    anywhere, so that a path does not widen the table, but keeps a width of some words.
    """
    rows = list(rows)
    if not rows:
        return Html()
    def cells(kind: str, row: Sequence[str]) -> Html:
        out = []
        for i, cell in enumerate(row):
            text = TAG.sub("", cell) if isinstance(cell, Html) else cell
            long = len(text) > MAX_UNBROKEN_CELL
            number = i >= numbers and (kind == "th" or not long)
            out.append(el(kind, cell, class_="n" if number else "l" if long else "s"))
        return el("tr", *out)

    top = [el("caption", caption)] * bool(caption) + [el("thead", cells("th", head))] * any(head)
    return el("div", el("table", *top, el("tbody", *(cells("td", row) for row in rows))),
              class_="wide", tabindex="0")


def _attribute(name: str, value: str | float | None) -> str:
    if value is None:
        return ""
    if isinstance(value, (int, float)):
        if not math.isfinite(value):
            raise ValueError(f"attribute {name} is {value}")
        value = f"{value:.6g}"
    return f' {name.rstrip("_").replace("_", "-")}="{html.escape(value)}"'
