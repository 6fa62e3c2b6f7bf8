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
    """Return the recordings with the frames of their markers, if known or identified.

    1. Recordings of one day, or without a date of one folder, share one mounting: their frame is
       fitted together.
    2. If the own fit of a recording differs from that by more than 3 standard errors, its mounting
       differs and it keeps its own fit. So do then the other recordings of that day.
    3. A given, calibrated or published frame is used unchanged; a note reports a fit that
       contradicts it.
    4. A recording of an unnamed car that identifies no frame takes the known one of its day, with a
       caution.

    given: frame of all recordings; None: known or fitted. Recordings without motion capture, and
    results of this function, are returned unchanged.
    """
    open_ones = [r for r in recordings if r.mocap is not None and not r.framed]
    fits = _fit_mountings(open_ones)
    return [_attach_frame(r, given, *fits[id(r)], _find_frame_of_day(r, open_ones))
            if id(r) in fits else r for r in recordings]


def _fit_mountings(recordings: Sequence[Recording]) -> dict[int, tuple[Reference | None, str]]:
    """Return by id of a recording its fitted frame and the name of the fitted data."""
    # 1. Group the recordings by day and car.
    mountings: dict[str, list[Recording]] = {}
    for r in recordings:
        mountings.setdefault(mounting(r), []).append(r)
    found: dict[int, tuple[Reference | None, str]] = {}
    for name, members in mountings.items():
        if len(members) == 1:
            found[id(members[0])] = fit_reference(members), "this recording"
            continue
        # 2. Fit the frame to all of a group, and to each of it alone.
        pooled = fit_reference(members)
        alone = [fit_reference([r]) for r in members]
        # 3. A recording whose own fit contradicts that of the group has another mounting.
        differences = [own is not None and (pooled is None or difference(own, pooled) != "")
                       for own in alone]
        for r, own, differs in zip(members, alone, differences, strict=True):
            if differs:
                found[id(r)] = own, f"this recording, not like the others of {name}"
            else:  # if mountings differ, a recording without a fit may have either
                found[id(r)] = (own if any(differences) else pooled,
                                f"{len(members)} recordings of {name}")
    return found


def mounting(recording: Recording) -> str:
    """Return the key of a mounting of the markers: day, else folder, and car."""
    when = recording.when
    day = f"{when:%Y-%m-%d}" if when else str(recording.path.parent)
    owner = "DART" if recording.published else recording.car.name if recording.car else ""
    return f"{day} ({owner})" if owner else day


def _find_frame_of_day(recording: Recording, others: Sequence[Recording]) -> Reference | None:
    """Return the one calibrated or published frame of its day; None for a named car.

    others: recordings whose frames were not fitted.
    """
    when = recording.when
    if recording.car is not None or when is None:
        return None
    known = {reference_for(r) for r in others if r.car is None and r.when is not None
             and r.when.date() == when.date()} - {None}
    return known.pop() if len(known) == 1 else None


def _attach_frame(recording: Recording, given: Reference | None, fitted: Reference | None,
                  fitted_to: str, of_day: Reference | None) -> Recording:
    known = given or reference_for(recording)
    notes = list(recording.notes)
    # A frame that was measured is not replaced by a fit, which may follow a wrong model.
    if known is not None:
        if fitted is not None and (differs := difference(known, fitted)):
            notes.append(Note(
                f"caution: marker frame ({known.source}) differs from the fit to {fitted_to}: "
                f"{differs}; fitted {fitted}. A wrong frame shows as side slip: check which one "
                "is right",
                kind="marker_differs"))
    elif fitted is not None:
        notes.append(Note(f"marker frame fitted to {fitted_to}: {fitted}; --reference gives "
                          "another", kind="marker"))
    elif of_day is not None:
        notes.append(Note(
            f"caution: marker frame of other recordings of {recording.when:%Y-%m-%d} ("
            f"{of_day.source}): this drive identifies none. Right if it is of the same car with "
            "the same markers; --reference gives another", kind="marker_of_day"))
    else:
        notes.append(Note(f"marker frame not identified: it needs {NEEDED}; {OPTION}",
                          kind="reference_unknown"))
    marker = known or fitted or of_day
    return replace(recording, marker=marker, notes=tuple(notes), framed=True)
