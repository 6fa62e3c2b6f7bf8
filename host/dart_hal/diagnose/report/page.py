"""The report: one HTML page without anything from outside, made from a Diagnosis."""

from __future__ import annotations

import base64
import json
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dart_hal import __version__
from dart_hal.diagnose.onboard import OnboardEvidence
from dart_hal.diagnose.result import Diagnosis
from dart_hal.diagnose.suggest.result import Suggestion

from . import svg, tables
from .along import Rows
from .causes import cause_section, unexplained_section
from .charts import ranking, staircase
from .glossary import glossary
from .html import Html, el, join
from .next_drive import next_drives
from .style import CSS
from .words import listed, sentence, share_of, verdict

GOOD = ("nothing_wrong", "explained", "parameters_only")


def write_page(d: Diagnosis, path: str | Path, *, command: str = "",
               answer: Mapping[str, Any] | None = None,
               suggestions: Sequence[Suggestion] | None = None) -> Path:
    """Write the page; folders are made. command: as typed; answer: JSON to embed.

    answer None embeds ``d.to_json()``; suggestions: of ``suggest``, None where
    nobody asked. Errors: OSError.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(page(d, command=command, answer=answer, suggestions=suggestions),
                    encoding="utf-8")
    return path


def page(d: Diagnosis, *, command: str = "", answer: Mapping[str, Any] | None = None,
         suggestions: Sequence[Suggestion] | None = None) -> str:
    """The text of the page."""
    sections = _sections(d, command, d.to_json() if answer is None else answer)
    if suggestions is not None:
        sections = {"next": ("What to drive next", next_drives(suggestions)), **sections}
    contents = el("nav", *(el("a", name, href=f"#{key}") for key, (name, _) in sections.items()),
                  aria_label="contents")
    body = [el("h1", f"What the model {d.model} gets wrong, and why"), _result(d), contents]
    body += [el("section", el("h2", name), content, id=key)
             for key, (name, content) in sections.items()]
    head = el("head", el("meta", charset="utf-8"),
              el("meta", name_="viewport", content_="width=device-width, initial-scale=1"),
              el("meta", name_="color-scheme", content_="light dark"),
              el("title", f"DART-HAL diagnosis of {d.model}"), el("style", Html(CSS)))
    return "<!doctype html>\n" + el("html", head, el("body", *body), lang="en") + "\n"


def _result(d: Diagnosis) -> Html:
    """What somebody reads who reads nothing else."""
    lines = [el("p", verdict(d), class_="big")]
    if d.causes:
        lines.append(el("ol", *(el("li", sentence(c), " ", el("a", "evidence",
                                                             href=f"#cause-{i + 1}"))
                                for i, c in enumerate(d.causes))))
    overall = [share_of(g) for g in d.gain.values()]
    if overall and d.verdict != "nothing_wrong":
        lines.append(el("p", "Against the model as it was given, at 1 s, on recordings it has not "
                             f"seen, the extended model {listed(overall, 'and')}."))
    lines += [el("p", note, class_="notice") for note in d.notes]
    if d.withdrawn:
        lines.append(el("p", f"Named at first and withdrawn: {listed(d.withdrawn, 'and')}."))
    return el("div", *lines, class_="verdict " + ("good" if d.verdict in GOOD else "bad"))


def _sections(d: Diagnosis, command: str, answer: Mapping[str, Any]
              ) -> dict[str, tuple[str, Html]]:
    rows = Rows(d.evidence, d.extended)
    found = join([cause_section(d, i, rows) for i in range(len(d.causes))]) if d.causes else (
        el("p", "No effect of the catalogue was named."))
    return {
        "errors": ("Errors, step by step", _errors(d)),
        "causes": ("The causes, and their evidence", found),
        "unexplained": ("What is not explained", unexplained_section(d, rows)),
        "ranking": ("Every effect by what it would take away", _ranking(d)),
        "considered": ("Considered and not named", tables.considered(d)),
        "parameters": ("Base parameters that moved", tables.parameters(d)),
        "files": ("Recordings", tables.files(d)),
        "made": ("How this was made", _made(d, command, answer)),
        "glossary": ("Words and method", glossary())}


def _errors(d: Diagnosis) -> Html:
    steps = el("ol", *(el("li", s.label) for s in d.stages), start="0", class_="soft")
    pictures = staircase(d)
    shown = [steps, el("div", *pictures, class_="figures")] if pictures else []
    if isinstance(d.evidence, OnboardEvidence):
        shown.append(el("p", "Without motion capture: speed as the encoder reads it and yaw rate "
                             "as the gyro reads it; nothing else can be judged.", class_="soft"))
    return join([*shown, tables.gains(d), tables.errors(d)])


def _ranking(d: Diagnosis) -> Html:
    if not d.causes and not d.considered:
        return el("p", "No effect was tried.")
    key = svg.legend([("after", "named"), ("other", "not named")])
    said = (("Each effect alone, before anything was named: relatives of a cause gain nearly as "
             "much, until it is in the model. " if d.ranking else "")
            + "How much counts differs from effect to effect, see the p-values below.")
    return join([ranking(d), key, el("p", said, class_="soft")])


def _made(d: Diagnosis, command: str, answer: Mapping[str, Any]) -> Html:
    about = {"command": command or "from Python", "dart-hal": __version__,
             "Python": platform.python_version(), "numpy": np.__version__,
             "model given": d.model, "extended model": d.written or "not written"}
    text = json.dumps(_plain(answer), indent=1, allow_nan=False)
    data = base64.b64encode(text.encode()).decode("ascii")
    return join([tables.sources(d, about), el("p", el(
        "a", f"All numbers of this page as JSON ({len(text) / 1e3:.0f} kB)", class_="button",
        href=f"data:application/json;base64,{data}", download="diagnosis.json"))])


def _plain(value: Any) -> Any:
    """JSON's types only; what is no number is null."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value
