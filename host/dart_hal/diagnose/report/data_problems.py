"""Problems of the data: what limits every number of the page, each with its remedy."""

from __future__ import annotations

import re

from dart_hal.diagnose.result import Cause, Diagnosis

from .words import late_commands

NEUTRAL = ("marker frame fitted", "no test recordings", "no motion capture: judged",
           "cannot be known from these recordings", "assumed: ",
           "a copy of another recording", "no motion capture, left out")
"""Beginnings or parts of notes that state how the data were used, and no problem of them."""
SIZES_ASSUMED = "assumed: "
NOT_FITTED = ("The parameters of the model were not fitted (--no-refit): wrong parameters may "
              "appear as causes. Run it without --no-refit unless the parameters were measured.")
LOST = ("Some commands were late or lost. Check the radio link and the load of the computer that "
        "sends them, and record again.")
LEAST_WINDOWS = 2
"""Windows of a recording below which the size of a cause in it says nothing of the others."""


def data_problems(d: Diagnosis) -> list[str]:
    """List the problems of the recordings with a remedy each, the gravest first."""
    notes = [n for n in d.notes if not any(words in n for words in NEUTRAL)]
    out = [f"{LOST} {_sentence(late_commands(d.late_commands))}"] if d.late_commands else []
    out += map(_sentence, notes)
    return sorted(out, key=lambda text: "clocks of command" not in text)


def model_problems(d: Diagnosis) -> list[str]:
    """List what was assumed of the model: its sizes, and its parameters where none was fitted."""
    assumed = [_sentence(n) for n in d.notes if n.startswith(SIZES_ASSUMED)]
    return assumed + [NOT_FITTED] * (not d.refitted)


def neutral_notes(d: Diagnosis) -> list[str]:
    """List the notes that state how the data were used."""
    return [n for n in d.notes if any(words in n for words in NEUTRAL)
            and not n.startswith(SIZES_ASSUMED)]


def valid_sizes(d: Diagnosis, cause: Cause) -> dict[str, tuple[float, float]]:
    """Return the sizes of a cause by recording, without recordings with broken or too few data.

    All of them where none would remain.
    """
    broken = {name for n in d.notes for files, dead, _ in [n.partition(": the ")]
              if dead and "is dead" in n for name in re.split(", | and ", files)}
    good = {name: size for name, size in cause.sizes.items()
            if name not in broken
            and d.files.get(name, {}).get("windows", LEAST_WINDOWS) >= LEAST_WINDOWS}
    return good or dict(cause.sizes)


def _sentence(text: str) -> str:
    """A note as a sentence; names of files keep their first letter."""
    words = text if re.search(r"[/.]", text.split(" ")[0]) else text[:1].upper() + text[1:]
    return f"{words.rstrip('.')}."
