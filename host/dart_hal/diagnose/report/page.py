"""The report: what is on the page of a diagnosis, in which order."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dart_hal import __version__
from dart_hal.diagnose.result import Cause, Claim, Diagnosis
from dart_hal.diagnose.suggest.result import Suggestion
from dart_hal.diagnose.suggest.sharpen import Sharper
from dart_hal.report import page as builder
from dart_hal.report.html import Html, el, join
from dart_hal.report.numbers import listed

from . import tables
from .along import Rows
from .causes import (
    cause_section,
    claims_section,
    possible_section,
    unexplained_section,
)
from .glossary import glossary
from .next_drive import next_drives
from .words import claim, overall, sentence, structure, verdict


def write_page(d: Diagnosis, path: str | Path, *, command: str = "",
               answer: Mapping[str, Any] | None = None,
               suggestions: Sequence[Suggestion] | None = None,
               drives: Sequence[Sharper] = ()) -> Path:
    """Write the page; folders are made. command: as typed; answer: JSON to embed.

    answer None embeds ``d.to_json()``; suggestions: of ``suggest``, None where
    nobody asked; drives: of ``sharpen``. Errors: OSError.
    """
    return builder.write(path, page(d, command=command, answer=answer, suggestions=suggestions,
                                    drives=drives))


def page(d: Diagnosis, *, command: str = "", answer: Mapping[str, Any] | None = None,
         suggestions: Sequence[Suggestion] | None = None,
         drives: Sequence[Sharper] = ()) -> str:
    """The text of the page."""
    rows = Rows(d.evidence, d.extended)
    found = join(cause_section(d, i, rows) for i in range(len(d.causes)))
    about = {"command": command or "from Python", "dart-hal": __version__,
             "Python": platform.python_version(), "numpy": np.__version__,
             "model given": d.model, "extended model": d.written or "not written",
             **({"best predictor": d.predictor_written or "not written"} if d.predictor else {})}
    sections = {
        "claims": ("Parameters that were wrong", claims_section(d)),
        "causes": ("The causes, and their evidence",
                   found or el("p", "No effect of the catalogue was named.")),
        "possible": ("Possible, not shown above", possible_section(d)),
        "unexplained": ("What is not explained", unexplained_section(d, rows)),
        "moments": ("Moments at which it errs most", tables.moments(d)),
        "errors": ("Errors, step by step", tables.errors(d)),
        **({"predictor": ("The best predictor", tables.best_predictor(d, d.predictor))}
           if d.predictor else {}),
        "ranking": ("Every effect by what it would take away", tables.ranking(d)),
        "considered": ("Considered and not named", tables.considered(d)),
        "parameters": ("Base parameters that moved", tables.parameters(d)),
        "files": ("Recordings", tables.files(d)),
        "made": ("How this was made", join([
            tables.sources(d, about),
            builder.download(d.to_json() if answer is None else answer, "diagnosis.json")])),
        "glossary": ("Words and method", glossary())}
    if suggestions is not None:
        after = list(sections).index("errors")
        parts = list(sections.items())
        next_ = ("next", ("What to drive next", next_drives(suggestions, drives)))
        sections = dict([*parts[:after], next_, *parts[after:]])
    return builder.page(f"diagnosis of {d.model}",
                        f"What the model {d.model} gets wrong, and why", _result(d), sections)


def _result(d: Diagnosis) -> Html:
    gained = overall(d) if d.verdict != "nothing_wrong" else ""
    back = f"Named at first and withdrawn: {listed(d.withdrawn, 'and')}." if d.withdrawn else ""
    return answer_card(d, builder.text(gained), builder.notices(d.notes), builder.text(back))


def _would_decide(d: Diagnosis) -> str:
    """What would decide what these recordings cannot."""
    found: list[Claim | Cause] = [*d.claims, *d.causes]
    unsure = [c for c in found if c.cannot_be_told_from]
    return f"What would decide what these data cannot: {unsure[0].experiment}" if unsure else ""


def answer_card(d: Diagnosis, *after: Html, report: str = "") -> Html:
    """Verdict and causes in sentences, each with a link to its evidence on the page ``report``."""
    causes = (join([sentence(c), " ", el("a", "evidence", href=f"{report}#cause-{i}")])
              for i, c in enumerate(d.causes, 1))
    wrong = (join([claim(c), " ", el("a", "evidence", href=f"{report}#claims")]) for c in d.claims)
    unknown = (join(["Unknown: ", structure(u), ". ",
                     el("a", "picture", href=f"{report}#unexplained")]) for u in d.unexplained)
    return builder.card(el("p", verdict(d), class_="big"), builder.items([*wrong, *causes], "ol"),
                        builder.items(unknown), builder.text(_would_decide(d)), *after,
                        good=d.verdict in ("nothing_wrong", "explained", "parameters_only"))
