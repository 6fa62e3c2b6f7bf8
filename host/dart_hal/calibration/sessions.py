"""Group recordings by session, and compare the steering maps of the groups.

A session is a day and a folder, or the recordings of one drive. Battery, trim of the ESC, linkage
and floor change between sessions. Standard errors from a single session are therefore too small. A
fit over several sessions is a mean that no car ever had.
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

SESSION_GAP = timedelta(hours=1)
_MONTH_FIRST = re.compile(r"(?<!\d)(\d\d)_(\d\d)_(20\d\d)(?!\d)")
_YEAR_FIRST = re.compile(r"(?<!\d)(20\d\d)-(\d\d)-(\d\d)(?!\d)")
_MOMENT = re.compile(r"(?<!\d)(\d\d)_(\d\d)_(20\d\d)_(\d\d)_(\d\d)_\d\d")
MAX_MAP_DAYS = 3
# deg rms; a larger difference shows on the floor as another radius.
MAX_GROUP_DIFFERENCE = 1.0
# Width of a bin of commands that count as equal.
COMMAND_BIN = 0.1
# Samples of a bin: 2 s; bins that two groups have to share.
MIN_BIN_SAMPLES = 20
MIN_SHARED_BINS = 2


def day_of(recording: Recording) -> date | None:
    """Day by the clock of the mocap, or by the file name; None if unknown (own runs)."""
    if recording.when is not None:
        return recording.when.date()
    name = recording.path.name
    try:
        if found := _MONTH_FIRST.search(name):
            month, day, year = map(int, found.groups())
            return date(year, month, day)
        if found := _YEAR_FIRST.search(name):
            return date(*map(int, found.groups()))
    except ValueError:  # digits that are not a date
        pass
    return None


def session_of(recording: Recording) -> str:
    """Label of date and folder, or of the folder if no date is known."""
    day = day_of(recording)
    return f"{day.isoformat()} {_folder(recording)}" if day else _folder(recording)


def _folder(recording: Recording) -> str:
    parent = recording.path.absolute().parent
    return parent.parent.name if parent.name == "csv" else parent.name


def sessions_of(recordings: Sequence[Recording]) -> list[str]:
    """Label the session of each recording: it started within an hour of the previous one.

    Battery and trim last for a session, across folders. Without a time of day, date and folder are
    used instead.
    """
    out = [session_of(r) for r in recordings]
    timed = sorted((began, i) for i, r in enumerate(recordings)
                   if (began := _began(r)) is not None)
    session: list[int] = []
    for position, (began, i) in enumerate(timed):
        session.append(i)
        if position + 1 == len(timed) or timed[position + 1][0] - began > SESSION_GAP:
            folders = dict.fromkeys(_folder(recordings[k]) for k in session)
            for k in session:
                out[k] = f"{_began(recordings[session[0]]):%Y-%m-%d %H:%M} " + " + ".join(folders)
            session = []
    return out


def _began(recording: Recording) -> datetime | None:
    """Start by the file name, or by the clock of the mocap."""
    found = _MOMENT.search(recording.path.name)
    when = recording.when
    if found is None:
        return None if when is None else when.replace(tzinfo=None)
    month, day, year, hour, minute = map(int, found.groups())
    try:
        return datetime(year, month, day, hour, minute)
    except ValueError:  # digits that are not a time
        return None


@dataclass(slots=True)
class RecordingGroup:
    """Recordings of one day and folder: commands (n,) and residuals (n,) rad of its samples."""

    label: str
    day: date | None
    command: list[FloatArray] = field(default_factory=list)
    residual: list[FloatArray] = field(default_factory=list)

    def means(self) -> dict[int, tuple[float, int]]:
        """Return {bin of command: (mean residual [deg], samples)}."""
        command = np.concatenate(self.command)
        residual = np.concatenate(self.residual)
        key = np.round(command / COMMAND_BIN).astype(int)
        return {int(k): (float(np.degrees(residual[key == k].mean())), int((key == k).sum()))
                for k in np.unique(key) if (key == k).sum() >= MIN_BIN_SAMPLES}


def make_groups(parts: Sequence[tuple[Recording, FloatArray, FloatArray]]) -> list[RecordingGroup]:
    """Group (recording, command (n,), residual (n,) rad), oldest first, undated last."""
    found: dict[str, RecordingGroup] = {}
    for recording, command, residual in parts:
        label = session_of(recording)
        group = found.setdefault(label, RecordingGroup(label, day_of(recording)))
        group.command.append(command)
        group.residual.append(residual)
    return sorted(found.values(), key=lambda g: (g.day or date.max, g.label))


def cautions(groups: Sequence[RecordingGroup]) -> list[str]:
    """Describe what is against one map for all groups; empty if nothing is."""
    found = []
    days = [g.day for g in groups if g.day is not None]
    if days and (max(days) - min(days)).days > MAX_MAP_DAYS:
        found.append(f"caution: one map from {(max(days) - min(days)).days} days, between which "
                     "trim, tyres and floor may have changed: "
                     + ", ".join(g.label for g in groups))
    pairs = sorted(((*difference(a, b), a.label, b.label) for a, b in combinations(groups, 2)),
                   reverse=True)
    large = [pair for pair in pairs if pair[0] > MAX_GROUP_DIFFERENCE]
    if large:
        rms, mean, first, second = large[0]
        more = f"; so do {len(large) - 1} other pair(s) of groups" if len(large) > 1 else ""
        found.append(f"caution: at the same commands {second} differs by {rms:.1f} deg rms "
                     f"({mean:+.1f} on average) from {first}: another trim, floor, speed or side "
                     f"of approach; fit them separately{more}")
    return found


def difference(first: RecordingGroup, second: RecordingGroup) -> tuple[float, float]:
    """(rms, mean) [deg] of second minus first over common commands; zeros for too few."""
    a = first.means()
    b = second.means()
    shared = sorted(a.keys() & b.keys())
    if len(shared) < MIN_SHARED_BINS:
        return 0.0, 0.0
    step = np.array([b[k][0] - a[k][0] for k in shared])
    weight = np.array([min(a[k][1], b[k][1]) for k in shared], dtype=np.float64)
    weight /= weight.sum()
    return float(np.sqrt(weight @ step**2)), float(weight @ step)
