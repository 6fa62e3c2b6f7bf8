"""HTML and SVG out of function calls: whatever is plain text is escaped."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Sequence

VOID = frozenset({"br", "hr", "img", "meta"})
SHORT = 24
"""Characters up to which a cell is not broken."""


class Html(str):
    """Text that is markup already, so it is not escaped again."""

    __slots__ = ()


def el(name: str, /, *content: str, **attributes: str | float | None) -> Html:
    """One element. A trailing underscore of an attribute falls away, others become hyphens.

    Errors: ValueError for an attribute that is no finite number: it would not be drawn.
    """
    opened = f"<{name}{''.join(map(_attribute, attributes, attributes.values()))}>"
    if name in VOID:
        return Html(opened)
    return Html(f"{opened}{join(content)}</{name}>")


def join(content: Iterable[str]) -> Html:
    """Pieces one after the other; plain text among them is escaped, and its +- typeset."""
    return Html("".join(c if isinstance(c, Html) else html.escape(c).replace(" +- ", " \u00b1 ")
                        for c in content))


def table(head: Sequence[str], rows: Iterable[Sequence[str]], numbers: int = 99,
          caption: str = "") -> Html:
    """A table that scrolls sideways where it is too wide; nothing where there is no row.

    Columns from ``numbers`` on are set to the right.
    """
    rows = list(rows)
    if not rows:
        return Html()
    def cells(kind: str, row: Sequence[str]) -> Html:
        return el("tr", *(el(kind, cell, class_="n" if i >= numbers else
                             "s" if len(cell) <= SHORT else None) for i, cell in enumerate(row)))

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
