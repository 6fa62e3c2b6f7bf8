"""The page of a diagnosis: its sections and their order."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dart_hal import __version__
from dart_lab.diagnosis.result import Diagnosis
from dart_lab.diagnosis.suggest.result import Suggestion
from dart_lab.diagnosis.suggest.sharpen import ParameterDrive
from dart_lab.report import page as builder
from dart_lab.report.html import Html, join

from . import tables
from .along import ResidualRows
from .causes import cause_section, claims_section, rejected_section, unexplained_section
from .data_problems import neutral_notes
from .explain import is_small
from .glossary import glossary
from .next_drive import next_drives
from .overview import overview, problem_card, sentences, verdict_section

NOT_WRITTEN = "not written; --out-predictor MODEL.TOML writes it"


def write_page(d: Diagnosis, path: str | Path, *, command: str = "",
               answer: Mapping[str, Any] | None = None,
               suggestions: Sequence[Suggestion] | None = None,
               drives: Sequence[ParameterDrive] = ()) -> Path:
    """Write the page; folders are made. command: as typed; answer: JSON to embed.

    answer None embeds ``d.to_json()``; suggestions: of ``suggest``, None where none were
    requested; drives: of ``sharpen``. Errors: OSError.
    """
    return builder.write(path, page(d, command=command, answer=answer, suggestions=suggestions,
                                    drives=drives))


def page(d: Diagnosis, *, command: str = "", answer: Mapping[str, Any] | None = None,
         suggestions: Sequence[Suggestion] | None = None,
         drives: Sequence[ParameterDrive] = ()) -> str:
    """Return the text of the page: verdict and pictures, findings, then all details folded."""
    rows = ResidualRows(d.evidence, d.extended)
    causes = join(cause_section(d, i, rows) for i in range(len(d.causes)))
    sections = {
        "claims": ("Parameters that were wrong" if any(not is_small(c) for c in d.claims)
                   else "Small corrections of parameters", claims_section(d)),
        "causes": ("Causes", causes),
        "unexplained": ("What is not explained", unexplained_section(d, rows)),
        "rejected": ("Effects considered and not accepted", rejected_section(d)),
        "next": ("What to drive next", Html() if suggestions is None
                 else next_drives(suggestions, drives)),
        "predictor": ("The best predictor", tables.best_predictor(d, d.predictor)
                      if d.predictor else Html()),
        "details": ("Details", _details(d, command, answer))}
    shown = {key: section for key, section in sections.items() if section[1]}
    lead = join([verdict_section(d), sentences(d), problem_card(d), overview(d),
                 *map(builder.small_print, neutral_notes(d))])
    return builder.page(f"diagnosis of {d.model}",
                        f"What the model {Path(d.model).name} gets wrong, and why", lead, shown)


def _details(d: Diagnosis, command: str, answer: Mapping[str, Any] | None) -> Html:
    """Fold everything that a reader needs only to check the result."""
    about = {"command": command or "from Python", "dart-hal": __version__,
             "Python": platform.python_version(), "numpy": np.__version__,
             "model given": d.model,
             "extended model": d.written or "not written; --out MODEL.TOML writes it",
             **({"best predictor": d.predictor_written or NOT_WRITTEN} if d.predictor else {})}
    folds = {
        "errors": ("Errors, step by step", tables.errors(d)),
        "ranking": ("Loss reduction of every effect alone", tables.ranking(d)),
        "parameters": ("Parameters that the refit changed", tables.parameters(d)),
        "files": ("Recordings", tables.files(d)),
        "made": ("How this was made", tables.sources(d, about)),
        "glossary": ("Words and method", glossary())}
    numbers = builder.download(d.to_json() if answer is None else answer, "diagnosis.json")
    return join([*(builder.foldable(title, content, id=key)
                   for key, (title, content) in folds.items()), numbers])
