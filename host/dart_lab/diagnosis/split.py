"""Hold out stretches of recordings: some train, those between them test.

Driving changes within a recording: left in one minute and right in the next, first slow, then
fast. The last part alone is therefore another manoeuvre than the first. So stretches alternate,
and they are placed where the commands excite all of them most equally:

    a = sum over steering and throttle of std(in the stretch) / std(in all)
    b = |mean steering where it trains - mean where it tests| / std(in all)
    places = argmax (min over stretches of a) - b

The recording stays whole, so commands before a stretch act on it and a battery runs down from its
beginning. ``Recording.spans`` holds the stretches that are judged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Recording
from dart_hal.recording.dart.spans import Spans, span_index

# A disturbance has 0.15 s of memory, so it does not reach from one stretch into the next, and
# neither does the smoothing.
# Gap between two stretches [s].
GUARD_S = 1.0
# Four cycles in a minute, each with 5 s of test.
# Time from one training stretch to the next [s].
CYCLE_S = 15.0
# A window of 2 s and the smoothing at its ends.
# Shortest stretch [s].
MIN_STRETCH_S = 2.5
# Shifts of the cycle that are compared.
N_SHIFTS = 10
# Standard deviation below which a command is constant.
MIN_COMMAND_STD = 1e-3
SpanPair = tuple[Spans, Spans]


def hold_out(recordings: Sequence[Recording], share: float
             ) -> tuple[list[Recording], list[Recording]]:
    """Split recordings into those to train on and the same ones to test on.

    share: fraction of the time of each recording that tests. A recording that is too short for two
    cycles is cut once; of several such, every second one tests at its beginning, so that each part
    of a manoeuvre is in both sets.
    """
    sides = [split(r, share, reverse=i % 2 == 1) for i, r in enumerate(recordings)]
    return [train for train, _ in sides], [test for _, test in sides]


def split(r: Recording, share: float, reverse: bool = False) -> tuple[Recording, Recording]:
    """Split a recording into training and test spans; reverse: a short one tests first."""
    t = r.messages.arrival
    begin = float(t[0])
    end = float(t[-1])
    cycles = int((end - begin) // CYCLE_S)
    train, test = (_cut_once(begin, end, share, reverse) if cycles < 2
                   else _find_best_places(r, begin, end, cycles, share))
    return replace(r, spans=tuple(train)), replace(r, spans=tuple(test))


def _cut_once(begin: float, end: float, share: float, reverse: bool) -> SpanPair:
    """Cut once: the test comes last, or first."""
    cut = begin + (share if reverse else 1.0 - share) * (end - begin)
    first = [(begin, cut - (0.0 if reverse else GUARD_S))]
    last = [(cut + (GUARD_S if reverse else 0.0), end)]
    return (last, first) if reverse else (first, last)


def _find_best_places(r: Recording, begin: float, end: float, cycles: int, share: float
                      ) -> SpanPair:
    """Find the shift of the cycle at which all stretches are excited most equally."""
    period = (end - begin) / cycles
    shifts = np.arange(N_SHIFTS) * period / N_SHIFTS
    layouts = [_alternate(begin, end, period, share, float(shift)) for shift in shifts]
    return max(layouts, key=lambda sides: _excitation_score(r, *sides))


def _alternate(begin: float, end: float, period: float, share: float, shift: float) -> SpanPair:
    """Alternate training and test stretches, GUARD_S between them, ``shift`` seconds earlier."""
    tests = share * (period - 2.0 * GUARD_S)
    trains = period - 2.0 * GUARD_S - tests
    sides: SpanPair = ([], [])
    start = begin - shift
    while start < end:
        for side, first, length in ((0, start, trains), (1, start + trains + GUARD_S, tests)):
            inside = max(first, begin), min(first + length, end)
            if inside[1] - inside[0] >= MIN_STRETCH_S:
                sides[side].append(inside)  # type: ignore[attr-defined]
        start += period
    return sides


def _excitation_score(r: Recording, train: Spans, test: Spans) -> float:
    """Return a - b of the module docstring: least excitation minus difference in steering."""
    t = r.messages.arrival
    if not train or not test:
        return -np.inf
    commands = [c for c in (r.messages.steering, r.messages.throttle)
                if np.std(c) > MIN_COMMAND_STD]
    least = min((sum(_std(c[_rows(t, span)]) / float(np.std(c)) for c in commands)
                 for span in (*train, *test)), default=0.0)
    steering = r.messages.steering
    means = [float(np.mean(steering[span_index(side, t) >= 0])) for side in (train, test)]
    return least - abs(means[0] - means[1]) / max(float(np.std(steering)), MIN_COMMAND_STD)


def _rows(t: FloatArray, span: tuple[float, float]) -> slice:
    """Return the rows of a span."""
    first, last = np.searchsorted(t, span)
    return slice(int(first), int(last) + 1)


def _std(values: FloatArray) -> float:
    """Return the standard deviation, 0 without values."""
    return float(np.std(values)) if len(values) else 0.0
