"""Marker frames of several recordings: given, known, or fitted to all of one mounting.

Every verb calls ``with_marker_frames`` once on all its recordings. Each of them then carries its
frame, with a note that states it with its standard errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from .model import Note, Recording, Reference
from .reference import NEEDED, OPTION, difference, fit_reference, reference_for


def with_marker_frames(recordings: Sequence[Recording], given: Reference | None = None
                       ) -> list[Recording]:
    """The recordings with the frame of their markers, as far as it is known or can be fitted.

    1. Recordings of one day and folder tree share one mounting: their frame is fitted together.
    2. A recording whose own fit differs from that by more than 3 standard errors was mounted
       otherwise, and keeps its own.
    3. What was given, calibrated or published is used as it is; where the fit contradicts it, a
       note says so.

    given: frame of all recordings; None: known or fitted. Recordings without motion capture, or
    that have been through this function, come back unchanged.
    """
    open_ones = [r for r in recordings if r.mocap is not None and not r.framed]
    fits = _fitted(open_ones)
    return [_framed(r, given, *fits[id(r)]) if id(r) in fits else r for r in recordings]


def _fitted(recordings: Sequence[Recording]) -> dict[int, tuple[Reference | None, str]]:
    """By id of a recording, its fitted frame and what it was fitted to."""
    mountings: dict[str, list[Recording]] = {}
    for r in recordings:
        mountings.setdefault(mounting(r), []).append(r)
    found: dict[int, tuple[Reference | None, str]] = {}
    for name, members in mountings.items():
        pooled = fit_reference(members)
        together = (f"{len(members)} recordings of {name}" if len(members) > 1
                    else "this recording")
        for r in members:
            alone = fit_reference([r]) if len(members) > 1 else None
            apart = alone is not None and (pooled is None or difference(alone, pooled) != "")
            found[id(r)] = (alone, f"this recording, not like the others of {name}") if apart else (
                pooled, together)
    return found


def mounting(recording: Recording) -> str:
    """What the recordings of one mounting of the markers share: the day, else the folder."""
    when = recording.when
    return f"{when:%Y-%m-%d}" if when else str(recording.path.parent)


def _framed(recording: Recording, given: Reference | None, fitted: Reference | None, fitted_to: str
            ) -> Recording:
    known = given or reference_for(recording)
    notes = list(recording.notes)
    if known is not None:
        if fitted is not None and (differs := difference(known, fitted)):
            notes.append(Note(
                f"caution: marker frame ({known.source}) differs from the fit to {fitted_to}: "
                f"{differs}; fitted {fitted}. A wrong frame shows as side slip: check which one "
                "is right",
                kind="marker_differs"))
    elif fitted is not None:
        notes.append(Note(f"marker frame fitted to {fitted_to}: {fitted}" + unmeasured(fitted)
                          + " (--reference gives another)", kind="marker"))
    else:
        notes.append(Note(f"marker frame not identified: it needs {NEEDED}; {OPTION}",
                          kind="reference_unknown"))
    marker = known or fitted
    return replace(recording, marker=marker, notes=tuple(notes), framed=True)


def unmeasured(frame: Reference) -> str:
    """Says that L_y was not measured, where it was not."""
    return "" if frame.std is None or frame.std[2] == frame.std[2] else " (L_y not measured)"
