"""Fits of several sessions into one: what differs between them is part of the error.

A session is a day and a folder. Battery, trim of the ESC and floor change
between sessions; one pooled fit would be wrong for each of them and say so
nowhere. So every session is fitted by itself, and they are averaged with the
spread between them as a variance of its own (DerSimonian and Laird's
random-effects mean, the covariance of each session kept whole).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dart_hal.identify.submodels.groups import day_of
from dart_hal.identify.submodels.straight import HIGH, LOW, NAMES, Straight
from dart_hal.recording.dart import Recording
from dart_hal.types import FloatArray

WIDE = np.array([5.0, 30.0, 3.0, 60.0, 20.0, 0.2, 0.3, 0.3])
"""Std that stands for "nothing": of a parameter that a session cannot tell."""
TOLD = 0.3  # std over value of a session that takes part in the spread between them


def session_of(recording: Recording) -> str:
    """Date and folder, or the folder alone where no date is known."""
    day = day_of(recording)
    parent = recording.path.absolute().parent
    folder = parent.parent.name if parent.name == "csv" else parent.name
    return f"{day.isoformat()} {folder}" if day else folder


def combine(parts: Mapping[str, Straight]) -> tuple[Straight, list[str]]:
    """(random-effects mean over sessions, notes). One session: itself."""
    if len(parts) == 1:
        return next(iter(parts.values())), []
    done = {name: f for name, f in parts.items() if f.converged}
    left = [f"{name}: no convergence, left out" for name in parts if name not in done]
    parts = done or parts
    if len(parts) == 1:
        return next(iter(parts.values())), left
    fits = list(parts.values())
    free = tuple(n for n in NAMES if any(n in f.free for f in fits))
    rows = [NAMES.index(n) for n in free]
    mean, covariance, between = random_effects(
        np.stack([f.x[rows] for f in fits]),
        np.stack([_widened(f)[np.ix_(rows, rows)] for f in fits]))
    full = fits[0].x.copy()
    full[rows] = np.clip(mean, LOW[rows], HIGH[rows])
    out = np.zeros((len(NAMES), len(NAMES)))
    out[np.ix_(rows, rows)] = covariance
    best = np.max([f.independent for f in fits if set(free) <= set(f.free)] or
                  [f.independent for f in fits], axis=0)
    result = Straight(free, full, out, np.asarray(best),
                      np.concatenate([f.residual for f in fits]),
                      bool(done), ())
    return result, _notes(parts, free, between) + (left if done else [])


def _widened(f: Straight) -> FloatArray:
    """Covariance (8, 8) with a wide variance where the session tells nothing."""
    out = f.covariance.copy()
    for i, name in enumerate(NAMES):
        if name not in f.free or name in f.stopped or not out[i, i] < WIDE[i] ** 2:
            out[i, :] = out[:, i] = 0.0
            out[i, i] = WIDE[i] ** 2
    return np.asarray(out + np.diag(1e-10 * WIDE**2))


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
        weight, value = 1.0 / own[told], x[told, i]
        off = value - weight @ value / weight.sum()
        spare = weight.sum() - (weight**2).sum() / weight.sum()
        out[i] = max(0.0, float((weight @ off**2 - told.sum() + 1) / spare))
    return out


def _notes(parts: Mapping[str, Straight], free: tuple[str, ...], between: FloatArray) -> list[str]:
    spread = [f"{n} {np.sqrt(v):.3g}" for n, v in zip(free, between, strict=True) if v > 0.0]
    out = [f"{len(parts)} sessions fitted apart and averaged; rmse is that of their own fits"]
    if spread:
        out.append("the sessions differ by more than their errors, standard deviation between "
                   "them: " + ", ".join(spread))
    for session, f in parts.items():
        told = [n for n in NAMES[:6] if n in f.free and f.std(n) < TOLD * abs(f.value(n))]
        if told:
            out.append(f"{session}: " + ", ".join(f"{n} {f.value(n):.3g} +- {f.std(n):.2g}"
                                              for n in told))
    return out
