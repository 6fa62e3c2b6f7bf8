"""Page builder: one self-contained HTML file with sections, cards, tables and figures."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

from dart_hal.car.viewers import VIEWER_PORT
from dart_hal.core.plain_json import plain

from .html import Html, el, join
from .style import CSS

# Sections of a page in order: anchor -> (heading, content).
Sections = Mapping[str, tuple[str, Html]]
# Size of a picture on a page, and the smallest size with legible text; on a narrower page the
# picture scrolls.
PX_PER_INCH = 88
MIN_PX_PER_INCH = 52


def page(title: str, heading: str, lead: Html, sections: Sections) -> str:
    """Return the text of a page: heading, lead, list of contents, sections."""
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
    """Write a page; missing folders are created. Errors: OSError."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(whole, encoding="utf-8")
    return path


def card(*lines: Html, good: bool = False, tone: str = "", kind: str = "verdict") -> Html:
    """Return a box with a coloured border.

    kind: verdict, cause. tone: good, found or bad; if it is empty, ``good`` decides.
    """
    return el("div", *lines, class_=f"{kind} {tone or ('good' if good else 'bad')}")


def notices(lines: Iterable[str]) -> Html:
    """Return notices, for the top of a page."""
    return join(el("p", line, class_="notice") for line in lines)


def text(words: str) -> Html:
    """Return a paragraph; empty for an empty text."""
    return el("p", words) if words else Html()


def small_print(words: str) -> Html:
    """Return a remark in small print."""
    return el("p", words, class_="soft")


def link_replay(words: str, file: str, second: float) -> str:
    """Return words that link to a moment of a run, on the page that ``dart-hal view FILE`` serves.

    second: since the start of the run. Words about a recording that this page cannot play stay
    plain.
    """
    if not file.endswith(".mcap"):
        return words
    return el("a", words, href=f"http://localhost:{VIEWER_PORT}/#t={second:.2f}",
              title=f"while dart-hal view {file} runs")


def items(lines: Iterable[str], name: str = "ul", **attributes: str) -> Html:
    """Return a list; empty without lines."""
    entries = [el("li", line) for line in lines]
    return el(name, *entries, **attributes) if entries else Html()


def figure(caption: str, picture: Html) -> Html:
    """Return a picture under its caption."""
    return el("figure", el("figcaption", caption), picture)


def image(figure: Any, name: str) -> Html:
    """Embed a matplotlib figure as PNG; name: text for screen readers."""
    buffer = BytesIO()
    figure.savefig(buffer, format="png", dpi=130, metadata={"Software": None})
    data = base64.b64encode(buffer.getvalue()).decode("ascii")
    width, min_width = (round(figure.get_figwidth() * px) for px in (PX_PER_INCH, MIN_PX_PER_INCH))
    return el("div", el("img", alt=name, src=f"data:image/png;base64,{data}",
                        style=f"width:{width}px;min-width:{min_width}px"),
              class_="wide", tabindex="0")


def figures(drawn: Sequence[Html]) -> Html:
    """Return figures in as many columns as fit; empty without figures."""
    return el("div", *drawn, class_="figures") if drawn else Html()


def foldable(title: str, *content: str, **attributes: str) -> Html:
    """Return content that a click on its title opens; it is open on paper."""
    return el("details", el("summary", title), *content, **attributes)


def download(answer: Mapping[str, Any], name: str) -> Html:
    """Return a button that saves all numbers of the page as JSON."""
    numbers = json.dumps(plain(answer), indent=1, allow_nan=False).encode()
    data = base64.b64encode(numbers).decode("ascii")
    return el("p", el("a", f"All numbers of this page as JSON ({len(numbers) / 1e3:.0f} kB)",
                      href=f"data:application/json;base64,{data}", download=name,
                      class_="button"))
