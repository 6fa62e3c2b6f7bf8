"""Stretches of recordings held out: some train, those between them test.

A drive changes: it steers to the left in one minute and to the right in the next, first slow, then
fast. Its last part alone is another drive than its first. So stretches alternate, and their places
are those at which all of them are excited most alike, by the commands alone:

    a = sum over steering and throttle of std(in the stretch) / std(in all)
    b = |mean steering where it trains - mean where it tests| / std(in all)
    places = argmax (min over stretches of a) - b

The recording stays whole, so commands before a stretch act on it and a battery runs down from its
beginning; what may be judged is in ``Recording.spans``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Recording
from dart_hal.recording.dart.spans import Spans, span_index

GUARD = 1.0
"""s between two stretches: what disturbed one, with 0.15 s of memory, does not disturb the next,
and nothing is smoothed from one into the other."""
CYCLE = 15.0
"""s from one stretch that trains to the next: four of them in a minute, each with 5 s to test."""
SHORTEST = 2.5
"""s of a stretch: a window of 2 s and the smoothing at its ends."""
PLACES = 10
"""Shifts of the cycle that are compared."""
STILL = 1e-3
"""Standard deviation of a command that does not change."""
Sides = tuple[Spans, Spans]


def hold_out(recordings: Sequence[Recording], share: float
             ) -> tuple[list[Recording], list[Recording]]:
    """(recordings to train on, the same to test on): a share of the time of each tests.

    A recording that is too short for two cycles is cut once; of several such, every other one tests
    at its beginning, so that each part of a manoeuvre is on both sides.
    """
    sides = [split(r, share, reverse=i % 2 == 1) for i, r in enumerate(recordings)]
    return [train for train, _ in sides], [test for _, test in sides]


def split(r: Recording, share: float, reverse: bool = False) -> tuple[Recording, Recording]:
    """(where it trains, where it tests); reverse: a short one tests at its beginning."""
    t = r.messages.arrival
    begin = float(t[0])
    end = float(t[-1])
    cycles = int((end - begin) // CYCLE)
    train, test = (_once(begin, end, share, reverse) if cycles < 2
                   else _best_places(r, begin, end, cycles, share))
    return replace(r, spans=tuple(train)), replace(r, spans=tuple(test))


def _once(begin: float, end: float, share: float, reverse: bool) -> Sides:
    """Cut once: the test comes last, or first."""
    cut = share if reverse else 1.0 - share
    at = begin + cut * (end - begin)
    first = [(begin, at - (0.0 if reverse else GUARD))]
    last = [(at + (GUARD if reverse else 0.0), end)]
    return (last, first) if reverse else (first, last)


def _best_places(r: Recording, begin: float, end: float, cycles: int, share: float) -> Sides:
    period = (end - begin) / cycles
    shifts = np.arange(PLACES) * period / PLACES
    layouts = [_alternating(begin, end, period, share, float(shift)) for shift in shifts]
    return max(layouts, key=lambda sides: _alike_excited(r, *sides))


def _alternating(begin: float, end: float, period: float, share: float, shift: float) -> Sides:
    """Stretches that train and test by turns, GUARD apart, moved ahead by a shift."""
    tests = share * (period - 2.0 * GUARD)
    trains = period - 2.0 * GUARD - tests
    sides: Sides = ([], [])
    at = begin - shift
    while at < end:
        for side, first, length in ((0, at, trains), (1, at + trains + GUARD, tests)):
            inside = max(first, begin), min(first + length, end)
            if inside[1] - inside[0] >= SHORTEST:
                sides[side].append(inside)  # type: ignore[attr-defined]
        at += period
    return sides


def _alike_excited(r: Recording, train: Spans, test: Spans) -> float:
    """How much the least excited stretch is, less how far the two sides steer apart."""
    t = r.messages.arrival
    if not train or not test:
        return -np.inf
    commands = [c for c in (r.messages.steering, r.messages.throttle) if np.std(c) > STILL]
    least = min((sum(_spread(c[_rows(t, span)]) / float(np.std(c)) for c in commands)
                 for span in (*train, *test)), default=0.0)
    steering = r.messages.steering
    means = [float(np.mean(steering[span_index(side, t) >= 0])) for side in (train, test)]
    return least - abs(means[0] - means[1]) / max(float(np.std(steering)), STILL)


def _rows(t: FloatArray, span: tuple[float, float]) -> slice:
    first, last = np.searchsorted(t, span)
    return slice(int(first), int(last) + 1)


def _spread(values: FloatArray) -> float:
    return float(np.std(values)) if len(values) else 0.0
