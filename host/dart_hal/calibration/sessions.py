"""Which session a recording belongs to: a day and a folder, or what was driven in one go.

Battery, trim of the ESC and floor change between sessions, and errors that know
only what is inside of them would promise too much.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import date, datetime, timedelta

from dart_hal.recording.dart import Recording

GAP = timedelta(hours=1)
_MONTH_FIRST = re.compile(r"(?<!\d)(\d\d)_(\d\d)_(20\d\d)(?!\d)")
_YEAR_FIRST = re.compile(r"(?<!\d)(20\d\d)-(\d\d)-(\d\d)(?!\d)")
_MOMENT = re.compile(r"(?<!\d)(\d\d)_(\d\d)_(20\d\d)_(\d\d)_(\d\d)_\d\d")


def day_of(recording: Recording) -> date | None:
    """The day by the mocap's clock, else by the file's name, else None (our runs hold none)."""
    if recording.when is not None:
        return recording.when.date()
    name = recording.path.name
    try:
        if found := _MONTH_FIRST.search(name):
            month, day, year = map(int, found.groups())
            return date(year, month, day)
        if found := _YEAR_FIRST.search(name):
            return date(*map(int, found.groups()))
    except ValueError:  # digits that are no date
        pass
    return None


def session_of(recording: Recording) -> str:
    """Date and folder, or the folder alone where no date is known."""
    day = day_of(recording)
    return f"{day.isoformat()} {_folder(recording)}" if day else _folder(recording)


def _folder(recording: Recording) -> str:
    parent = recording.path.absolute().parent
    return parent.parent.name if parent.name == "csv" else parent.name


def sessions_of(recordings: Sequence[Recording]) -> list[str]:
    """Label of each recording: one for all that began within an hour of the one before.

    What the motor hangs on (battery, trim) lasts for a session, whatever the
    folders are; without a time of day date and folder stand for it.
    """
    out = [session_of(r) for r in recordings]
    timed = sorted((began, i) for i, r in enumerate(recordings)
                   if (began := _began(r)) is not None)
    session: list[int] = []
    for place, (began, i) in enumerate(timed):
        session.append(i)
        if place + 1 == len(timed) or timed[place + 1][0] - began > GAP:
            folders = dict.fromkeys(_folder(recordings[k]) for k in session)
            for k in session:
                out[k] = f"{_began(recordings[session[0]]):%Y-%m-%d %H:%M} " + " + ".join(folders)
            session = []
    return out


def _began(recording: Recording) -> datetime | None:
    """When by the file's name, else by the mocap's clock."""
    found = _MOMENT.search(recording.path.name)
    when = recording.when
    if found is None:
        return None if when is None else when.replace(tzinfo=None)
    month, day, year, hour, minute = map(int, found.groups())
    try:
        return datetime(year, month, day, hour, minute)
    except ValueError:  # digits that are no time
        return None
