"""HTML page of ``dart-hal identify --html``: the tables of the terminal, and pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dart_lab.identification.outcome import Identification
from dart_lab.identification.write import why_unsound
from dart_lab.pages.identify_table import (
    group_notes,
    list_columns,
    list_parameters,
    list_residuals,
)
from dart_lab.report import page
from dart_lab.report.html import Html, el, join, table
from dart_lab.report.numbers import join_names
from dart_lab.report.page import image


def write_page(outcome: Identification, figures: Mapping[str, Any], missing: Mapping[str, str],
               path: Path, *, command: str, answer: Mapping[str, Any],
               cautions: Sequence[str] = ()) -> Path:
    """Write the page.

    figures: by name. missing: reasons for missing figures, by name. cautions: about the sizes of
    the car. Errors: OSError.
    """
    files = outcome.files
    drawn = [page.figure(name.replace("_", " "), image(f, name)) for name, f in figures.items()]
    return page.write(path, page.page("identification", "The car, identified from recordings",
                                      _result(outcome, cautions), {
        "pictures": ("Data, fit, and the paper's curve", join([
            *drawn, *(page.small_print(f"No picture of {name}: {why}.")
                      for name, why in missing.items())])),
        "fits": ("Parameters", _tables(outcome)),
        "notes": ("Notes", page.items(f"{', '.join(names)}: {note}"
                                      for note, names in group_notes(outcome).items())),
        "files": ("Recordings", table(
            ("file", "samples used", "left out", "why"),
            [(name, str(r.used), str(r.dropped), "; ".join(r.why)) for name, r in files.items()])),
        "made": ("How this was made", join([el("p", el("code", command)),
                                            page.download(answer, "identification.json")]))}))


def _result(outcome: Identification, cautions: Sequence[str]) -> Html:
    doubts = {name: why for name, fit in outcome.fits.items() if (why := why_unsound(fit))}
    sound = [name for name in outcome.fits if name not in doubts]
    sentence = (f"Identified: {join_names(sound, 'and')}." if sound
                else "Nothing could be identified.")
    return page.card(el("p", sentence, class_="big"),
                     page.notices([*cautions, *(f"{name}: {why}" for name, why in doubts.items())]),
                     good=bool(sound) and not doubts)


def _tables(outcome: Identification) -> Html:
    rows = [[el("strong", row[0]), *row[1:]] if not row[1] else row
            for row in list_parameters(outcome)]
    fits = list_residuals(outcome)
    return join([table(list_columns(outcome), rows, caption="+- one standard error"),
                 table(list(fits[0]), [list(f.values()) for f in fits], 1, "residuals")
                 if fits else Html()])
