"""The page of the error catalogue, generated from the classes."""

from __future__ import annotations

import inspect

from dart_hal.core.errors import CATALOGUE

ERRORS_HEAD = """# Errors

Every error names what happened, what was found, the likely cause, and the remedy. With `--json` a
verb exits with 2 and prints it as
`{"error": {"code", "what", "found", "expected", "likely", "try", "read"}}`. The classes live in
`dart_hal.core.errors`; each also inherits the builtin that a caller would expect. This page is
generated from them (`dart-hal wire --write`).

| code | class | what it means | likely | try |
|---|---|---|---|---|
"""


def render_errors() -> str:
    """Return the Markdown page of the catalogue, in the order of the codes."""
    rows = []
    for code, kind in sorted(CATALOGUE.items()):
        first = (inspect.getdoc(kind) or "").splitlines()[0]
        cells = (code, f"`{kind.__name__}`", first, kind.likely_default or "-",
                 f"`{kind.remedy_default}`" if kind.remedy_default else "see the message")
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return ERRORS_HEAD + "\n".join(rows) + "\n"
