"""Problems of the data that limit all numbers of the page, each with its remedy."""

from __future__ import annotations

from dart_lab.diagnosis.result import Cause, Diagnosis
from dart_lab.diagnosis.servo import TYRE_CAUTION
from dart_lab.identification.evaluation.cases import short

from .words import PARTS_OF_THE_CAR, late_commands

SIZES_ASSUMED = "assumed: "
# Parts of notes that state how the data were used, without a problem.
NEUTRAL = ("marker frame fitted", "marker frame was fitted", "no test recordings", ", left out",
           "judged by the car's own sensors", "cannot be known from these recordings",
           "in the training recordings, so their errors cannot be judged",
           "not candidates, because the motor has a speed loop", PARTS_OF_THE_CAR)
DEAD_ENCODER = "encoder dead"
# Remedy by the beginning of a message of the reader of a recording.
BROKEN = {
    DEAD_ENCODER: "Check plug, ring and distance of the encoder, and record again.",
    "false lock of the mocap": "Check cameras and markers, and record again: a constant pose "
                               "of a car that drives is not used."}
NOT_FITTED = ("The parameters of the model were not fitted (--no-refit): wrong parameters may "
              "appear as causes. Run it without --no-refit unless the parameters were measured.")
COMMANDS_LOST = ("Some commands were late or lost. Check the radio link and the load of the "
                 "computer that sends them, and record again.")
# Minimum windows of a recording for a size of its own: the spread of one is unknown.
MIN_WINDOWS_OF_SIZE = 2


def data_problems(d: Diagnosis) -> list[str]:
    """List the problems of the recordings with a remedy each, the most severe first."""
    out = [f"{n[:1].upper()}{n[1:].rstrip('.')}." for n in d.notes if not (
        n.startswith(SIZES_ASSUMED) or n == TYRE_CAUTION or "encoder is dead" in n
        or n in neutral_notes(d))]
    if d.late_commands:
        out.append(f"{COMMANDS_LOST} {late_commands(d.late_commands)}.")
    return out + [f"{why[:1].upper()}{why[1:]}, in {short(name)}. {remedy}"
                  for name, use in d.files.items() for why in use.get("why", ())
                  for beginning, remedy in BROKEN.items() if why.startswith(beginning)]


def model_problems(d: Diagnosis) -> list[str]:
    """List what limits the model: assumed sizes, parameters that were not fitted, cautions."""
    assumed = [f"{n[0].upper()}{n[1:]}." for n in d.notes
               if n.startswith(SIZES_ASSUMED) or n == TYRE_CAUTION]
    return assumed + [NOT_FITTED] * (not d.refitted)


def neutral_notes(d: Diagnosis) -> list[str]:
    """List the notes that state how the data were used."""
    return [n for n in d.notes if any(words in n for words in NEUTRAL)]


def valid_sizes(d: Diagnosis, cause: Cause) -> dict[str, tuple[float, float]]:
    """Return the sizes of a cause by recording, without recordings with broken or too few data.

    All of them where none would remain.
    """
    def is_valid(name: str) -> bool:
        use = d.files.get(name, {})
        return (use.get("windows", MIN_WINDOWS_OF_SIZE) >= MIN_WINDOWS_OF_SIZE
                and not any(why.startswith(DEAD_ENCODER) for why in use.get("why", ())))

    return {n: size for n, size in cause.sizes.items() if is_valid(n)} or dict(cause.sizes)
