"""Sessions, and averages over them: what differs between them is part of the error.

A session is a day and a folder, or an outing. Battery, trim of the ESC and floor change
between sessions, and errors that know only what is inside of them would
promise too much.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime, timedelta

import numpy as np

from dart_hal.identify.submodels.groups import day_of
from dart_hal.recording.dart import Recording
from dart_hal.types import FloatArray

GAP = timedelta(hours=1)
_MOMENT = re.compile(r"(?<!\d)(\d\d)_(\d\d)_(20\d\d)_(\d\d)_(\d\d)_\d\d")
TOLD = 0.3  # std over value of a session that takes part in the spread between them


def session_of(recording: Recording) -> str:
    """Date and folder, or the folder alone where no date is known."""
    day = day_of(recording)
    return f"{day.isoformat()} {_folder(recording)}" if day else _folder(recording)


def _folder(recording: Recording) -> str:
    parent = recording.path.absolute().parent
    return parent.parent.name if parent.name == "csv" else parent.name


def outings(recordings: Sequence[Recording]) -> list[str]:
    """Label of each recording: one for all that began within an hour of the one before.

    What the motor hangs on (battery, trim) lasts for an outing, whatever the
    folders are; without a time of day date and folder stand for it.
    """
    out = [session_of(r) for r in recordings]
    timed = sorted((began, i) for i, r in enumerate(recordings)
                   if (began := _began(r)) is not None)
    outing: list[int] = []
    for place, (began, i) in enumerate(timed):
        outing.append(i)
        if place + 1 == len(timed) or timed[place + 1][0] - began > GAP:
            folders = dict.fromkeys(_folder(recordings[k]) for k in outing)
            for k in outing:
                out[k] = f"{_began(recordings[outing[0]]):%Y-%m-%d %H:%M} " + " + ".join(folders)
            outing = []
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


def wider(first: FloatArray, second: FloatArray) -> FloatArray:
    """The smallest covariance (k, k) that in no direction is narrower than either."""
    if not (np.isfinite(first).all() and np.isfinite(second).all()):
        return first
    size = np.sqrt(np.maximum(np.diag(first), 1e-300))
    unit = np.outer(size, size)
    value, vector = np.linalg.eigh((second - first) / unit)
    return np.asarray(first + (vector * np.maximum(value, 0.0)) @ vector.T * unit)


def excess(x: FloatArray, variance: FloatArray) -> float:
    """Variance between x (s,) beyond their own (s,), by DerSimonian and Laird."""
    if len(x) < 2:
        return 0.0
    weight = 1.0 / variance
    off = x - weight @ x / weight.sum()
    spare = weight.sum() - (weight**2).sum() / weight.sum()
    return max(0.0, float((weight @ off**2 - len(x) + 1) / spare))


def random_effects(x: FloatArray, covariance: FloatArray
                   ) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(mean (k,), covariance (k, k), variance between (k,)) of x (s, k) with (s, k, k).

    Each session weighs by its own covariance plus the spread between them.
    """
    between = _between(x, covariance)
    precision = np.linalg.inv(covariance + np.diag(between))
    total = np.linalg.inv(precision.sum(axis=0))
    mean = total @ np.einsum("dij,dj->i", precision, x)
    off = x - mean
    chi2 = float(np.einsum("di,dij,dj->", off, precision, off))
    freedom = max((len(x) - 1) * x.shape[1], 1)
    return np.asarray(mean), np.asarray(total * max(1.0, chi2 / freedom)), between


def _between(x: FloatArray, covariance: FloatArray) -> FloatArray:
    """Variance (k,) between sessions beyond what their own errors explain."""
    out = np.zeros(x.shape[1])
    for i in range(x.shape[1]):
        own = covariance[:, i, i]
        told = np.sqrt(own) < TOLD * np.maximum(np.abs(x[:, i]), 1e-3)
        if told.sum() < 2:
            continue
        out[i] = excess(x[told, i], own[told])
    return out
