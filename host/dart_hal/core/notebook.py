"""Format a value for a notebook: a title and a row for each property."""

from __future__ import annotations

from collections.abc import Iterable


def card(title: str, rows: Iterable[tuple[str, str]]) -> str:
    """Return an HTML table of plain text; colours are those of the notebook."""
    from html import escape

    body = "".join(f"<tr><th style='text-align:left'>{escape(name)}</th>"
                   f"<td style='text-align:left'>{escape(value)}</td></tr>"
                   for name, value in rows)
    return f"<table><caption><b>{escape(title)}</b></caption><tbody>{body}</tbody></table>"
