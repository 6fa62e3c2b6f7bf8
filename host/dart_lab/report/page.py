"""The page builder: one self-contained HTML file out of sections, cards, tables and figures."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

from dart_hal.core.plain_json import plain

from .html import Html, el, join
from .style import CSS

Sections = Mapping[str, tuple[str, Html]]
"""What a page is made of, in order: key (the anchor) -> (heading, content)."""
PX_PER_INCH, LEAST_PX_PER_INCH = 88, 52
"""Size of a picture on a page, and the smallest with legible words: below it, it scrolls."""


def page(title: str, heading: str, lead: Html, sections: Sections) -> str:
    """The text of a page: heading, lead, a list of contents, then every section."""
    contents = el("nav", *(el("a", name, href=f"#{key}") for key, (name, _) in sections.items()),
                  aria_label="contents")
    body = [el("section", el("h2", name), content, id=key)
            for key, (name, content) in sections.items()]
    head = el("head", el("meta", charset="utf-8"),
              el("meta", name_="viewport", content_="width=device-width, initial-scale=1"),
              el("meta", name_="color-scheme", content_="light dark"),
              el("title", f"DART-HAL {title}"), el("style", Html(CSS)))
    return "<!doctype html>\n" + el("html", head, el("body", el("h1", heading), lead, contents,
                                                     *body), lang="en") + "\n"


def write(path: str | Path, whole: str) -> Path:
    """Write a page; folders are made. Errors: OSError."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(whole, encoding="utf-8")
    return path


def card(*lines: Html, good: bool = False, tone: str = "", kind: str = "verdict") -> Html:
    """Draw a box marked by its colour. kind: verdict, cause; tone: good, found, bad, by ``good``
    where it is empty."""
    return el("div", *lines, class_=f"{kind} {tone or ('good' if good else 'bad')}")


def notices(lines: Iterable[str]) -> Html:
    """What the reader has to know before the numbers."""
    return join(el("p", line, class_="notice") for line in lines)


def text(words: str) -> Html:
    """A paragraph; nothing where there are no words."""
    return el("p", words) if words else Html()


def soft(words: str) -> Html:
    """A remark in small print."""
    return el("p", words, class_="soft")


def items(lines: Iterable[str], name: str = "ul", **attributes: str) -> Html:
    """A list; nothing where there is no line."""
    entries = [el("li", line) for line in lines]
    return el(name, *entries, **attributes) if entries else Html()


def figure(caption: str, picture: Html) -> Html:
    """A picture under its caption."""
    return el("figure", el("figcaption", caption), picture)


def image(figure: Any, name: str) -> Html:
    """The figure inside of a page; name: what a screen reader says."""
    buffer = BytesIO()
    figure.savefig(buffer, format="png", dpi=130, metadata={"Software": None})
    data = base64.b64encode(buffer.getvalue()).decode("ascii")
    wide, least = (round(figure.get_figwidth() * px) for px in (PX_PER_INCH, LEAST_PX_PER_INCH))
    return el("div", el("img", alt=name, src=f"data:image/png;base64,{data}",
                        style=f"width:{wide}px;min-width:{least}px"), class_="wide", tabindex="0")


def figures(drawn: Sequence[Html]) -> Html:
    """Figures beside each other as far as there is room; nothing where there is none."""
    return el("div", *drawn, class_="figures") if drawn else Html()


def fold(title: str, *content: str, **attributes: str) -> Html:
    """Content that opens by a click on its title; open on paper."""
    return el("details", el("summary", title), *content, **attributes)


def download(answer: Mapping[str, Any], name: str) -> Html:
    """A button that saves all numbers of the page as JSON."""
    numbers = json.dumps(plain(answer), indent=1, allow_nan=False).encode()
    data = base64.b64encode(numbers).decode("ascii")
    return el("p", el("a", f"All numbers of this page as JSON ({len(numbers) / 1e3:.0f} kB)",
                      href=f"data:application/json;base64,{data}", download=name,
                      class_="button"))
