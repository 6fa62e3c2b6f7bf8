"""Which recordings belong together, and how the maps of such groups differ.

A session is a day and a folder, or what was driven in one go. Battery, trim of the ESC, linkage
and floor change between sessions: errors that know only one of them would promise too much, and
a fit over all of them is a mean that no car ever had.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import date, datetime, timedelta
from itertools import combinations

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Recording

GAP = timedelta(hours=1)
_MONTH_FIRST = re.compile(r"(?<!\d)(\d\d)_(\d\d)_(20\d\d)(?!\d)")
_YEAR_FIRST = re.compile(r"(?<!\d)(20\d\d)-(\d\d)-(\d\d)(?!\d)")
_MOMENT = re.compile(r"(?<!\d)(\d\d)_(\d\d)_(20\d\d)_(\d\d)_(\d\d)_\d\d")
MAX_DAYS = 3
MAX_DIFFERENCE = 1.0  # deg rms; more is seen on the floor as another radius
BIN = 0.1  # of command: what counts as the same command
MIN_IN_BIN = 20  # samples, 2 s
MIN_BINS = 2


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


@dataclass(slots=True)
class Group:
    """Recordings of one day and folder: commands (n,) and residuals (n,) rad of its samples."""

    label: str
    day: date | None
    command: list[FloatArray] = field(default_factory=list)
    residual: list[FloatArray] = field(default_factory=list)

    def means(self) -> dict[int, tuple[float, int]]:
        """(mean residual [deg], samples) by bin of command."""
        command, residual = np.concatenate(self.command), np.concatenate(self.residual)
        key = np.round(command / BIN).astype(int)
        return {int(k): (float(np.degrees(residual[key == k].mean())), int((key == k).sum()))
                for k in np.unique(key) if (key == k).sum() >= MIN_IN_BIN}


def groups_of(parts: Sequence[tuple[Recording, FloatArray, FloatArray]]) -> list[Group]:
    """Groups of (recording, command (n,), residual (n,) rad), oldest first, undated last."""
    found: dict[str, Group] = {}
    for recording, command, residual in parts:
        label = session_of(recording)
        group = found.setdefault(label, Group(label, day_of(recording)))
        group.command.append(command)
        group.residual.append(residual)
    return sorted(found.values(), key=lambda g: (g.day or date.max, g.label))


def cautions(groups: Sequence[Group]) -> list[str]:
    """What speaks against one map for all groups; empty when nothing does."""
    said = []
    days = [g.day for g in groups if g.day is not None]
    if days and (max(days) - min(days)).days > MAX_DAYS:
        said.append(f"caution: one map out of {(max(days) - min(days)).days} days, between which "
                    "trim, tyres and floor may have changed: "
                    + ", ".join(g.label for g in groups))
    found = sorted(((*difference(a, b), a.label, b.label) for a, b in combinations(groups, 2)),
                   reverse=True)
    large = [pair for pair in found if pair[0] > MAX_DIFFERENCE]
    if large:
        rms, mean, first, second = large[0]
        more = f"; so do {len(large) - 1} other pair(s) of groups" if len(large) > 1 else ""
        said.append(f"caution: at the same commands {second} lies {rms:.1f} deg rms "
                    f"({mean:+.1f} in the mean) from {first}: another trim, floor, speed or side "
                    f"of approach; fit them apart{more}")
    return said


def difference(first: Group, second: Group) -> tuple[float, float]:
    """(rms, mean) [deg] of second minus first over the commands that both hold; else zeros."""
    a, b = first.means(), second.means()
    shared = sorted(a.keys() & b.keys())
    if len(shared) < MIN_BINS:
        return 0.0, 0.0
    step = np.array([b[k][0] - a[k][0] for k in shared])
    weight = np.array([min(a[k][1], b[k][1]) for k in shared], dtype=np.float64)
    weight /= weight.sum()
    return float(np.sqrt(weight @ step**2)), float(weight @ step)
