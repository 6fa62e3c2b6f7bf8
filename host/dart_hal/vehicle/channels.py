"""Signals on their way through the effects that change them: whole series, or tick by tick.

A signal is an array or a float, or a tuple of them where a channel has several
(accel, pose). ``transform_signal`` and ``Stepper`` give the same numbers. A vehicle
without an effect on a channel gives back what it was given, itself.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import replace
from itertools import repeat
from typing import Any

import numpy as np

from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.compose import apply_parameter_effects, signals
from dart_hal.vehicle.delay import DelayRing, delay_series
from dart_hal.vehicle.effect import ActiveEffect, Now, PureDelay, Signal, Stateful
from dart_hal.vehicle.flat import PARAMETER_GROUPS
from dart_hal.vehicle.namespace import ARRAY, SCALAR
from dart_hal.vehicle.parameters import Vehicle

# Samples that are processed at once; a steering signal reverses after some hundreds.
PLAY_CHUNK = 1024


def transform_signal(p: Vehicle, channel: str, signal: Any, now: Now, dt: float) -> Any:
    """A series behind the effects on its channel: an array (n,) or (n, lanes), or a tuple.

    Sample i is at i * dt [s]; fields of ``now`` are numbers, (n,) or (n, lanes).
    Where parameters of the vehicle are arrays (lanes,), so is the result (n,
    lanes). Angles must not wrap round. Before the first sample it is held.
    """
    chain = signals(p, channel)
    if not chain:
        return signal
    p = apply_parameter_effects(p)
    if lanes := _batch_size(p):
        now = Now(*(_repeat_in_batch(field, lanes) for field in now))
        signal = (tuple(_repeat_in_batch(part, lanes) for part in signal)
                  if isinstance(signal, tuple)
                  else _repeat_in_batch(signal, lanes))
    for a, hook in chain:
        signal = _transform_series(p, a, hook, signal, now, dt)
    return signal


def split_final_delay(p: Vehicle, channel: str) -> tuple[Vehicle, float]:
    """The vehicle without what delays a channel at the end of its chain, and these delays [s].

    A reader at times of its own reads that much earlier instead: to shift a
    series twice, by parts of a sample, would smooth it.
    """
    seconds = 0.0
    kept = list(p.effects)
    # From the end of the chain back to the first effect that does more than delay.
    for a, hook in reversed(signals(p, channel)):
        if not isinstance(hook, PureDelay):
            break
        seconds += float(hook.seconds(*a.values))
        kept.remove(a)
    return (replace(p, effects=tuple(kept)), seconds) if len(kept) < len(p.effects) else (p, 0.0)


class Stepper:
    """The same for one car in a simulator: called once every dt [s] with floats.

    ``active``: whether any effect is on the channel. Raises UsageError for an
    effect that would have to know the future.
    """

    def __init__(self, p: Vehicle, channel: str, dt: float) -> None:
        chain = signals(p, channel)
        self.active = bool(chain)
        p = apply_parameter_effects(p)
        self._steps = [_make_stepper(p, a, hook, dt) for a, hook in chain]

    def __call__(self, signal: Any, now: Now) -> Any:
        """The signal behind the effects: a float or a tuple of floats."""
        for step in self._steps:
            signal = step(signal, now)
        return signal


def _transform_series(p: Vehicle, a: ActiveEffect, hook: Signal, signal: Any, now: Now,
                      dt: float) -> Any:
    if isinstance(hook, PureDelay):
        return delay_series(signal, hook.seconds(*a.values), dt)
    if isinstance(hook, Stateful):
        return _run_stateful(p, a, hook, signal, now, dt)
    return hook.make(p, ARRAY, *a.values)(signal, now)


def _run_stateful(p: Vehicle, a: ActiveEffect, hook: Stateful, signal: FloatArray, now: Now,
              dt: float) -> FloatArray:
    """Sample by sample: over floats for one car, which is faster, else over rows of lanes."""
    single = signal.ndim == 1
    first, step = hook.make(p, SCALAR if single else ARRAY, dt, *a.values)
    # Shortcuts for one car: backlash in blocks; effects that depend on the signal alone only where
    # it changes.
    if single and hook.play is not None:
        return _run_play(signal, hook.play(*a.values))
    if single and hook.blind:
        slack = hook.slack(dt, *a.values) if hook.slack else 0.0
        return _run_on_change(signal, first, step, slack)
    rows = signal.tolist() if single else signal
    out = np.empty_like(signal, dtype=np.float64)
    state: list[Any] = list(first(rows[0])) if len(rows) else []
    fields = [field if np.ndim(field) > 0 else repeat(field) for field in now]
    for i, (row, here) in enumerate(zip(rows, map(Now, *fields), strict=False)):
        out[i], *state = step(row, here, *state)
    return out


def _run_on_change(signal: FloatArray, first: Callable[..., Any], step: Callable[..., Any],
           slack: float) -> FloatArray:
    """Steps only where something happens: most commands are held for many samples.

    Where neither the signal nor the state moves, nothing will until the signal does. Where the
    state has caught up with the signal, it follows it until that changes by more than ``slack``.
    """
    out = signal.astype(np.float64)
    here = Now()
    n = len(signal)
    if not n:
        return out
    values = signal.tolist()
    change = np.abs(np.diff(signal))
    # Samples at which the signal moves at all, and at which it moves by more than the slack.
    moves, jumps = ([*(np.flatnonzero(change > by) + 1).tolist(), n] for by in (0.0, slack))
    state = list(first(values[0]))
    i = 0
    while i < n:
        out[i], *after = step(values[i], here, *state)
        value = values[i]
        i += 1
        # Caught up: the output is the signal itself up to the next jump.
        if after == [value]:
            i = jumps[bisect_left(jumps, i)]
            after = [values[i - 1]]
        # Nothing moves: the output stays the same until the signal moves.
        elif after == state:
            begin = i
            i = moves[bisect_left(moves, i)]
            out[begin:i] = out[begin - 1]
        state = after
    return out


def _run_play(signal: FloatArray, play: float) -> FloatArray:
    """Compute backlash of half width ``play`` in blocks, bit-identical to single steps.

    1. Pushed up, the state is the running maximum of signal - play and the state before.
    2. This ends where signal + play is below the state: the signal has crossed the play.
    3. From there it is pushed down, which is the same for -signal.
    """
    n = len(signal)
    out = np.empty(n)
    i = 0
    side = 1.0  # 1: the signal pushes the state up, -1: down
    held = float(signal[0]) if n else 0.0
    while i < n:
        part = side * signal[i:i + PLAY_CHUNK]
        state = np.maximum.accumulate(np.maximum(part - play, side * held))
        crossed = part + play < state
        end = int(crossed.argmax()) if crossed.any() else len(part)
        out[i:i + end] = side * state[:end]
        held = float(out[i + end - 1]) if end else held
        side = side if end == len(part) else -side
        i += end
    return out


def _make_stepper(p: Vehicle, a: ActiveEffect, hook: Signal, dt: float
                  ) -> Callable[[Any, Now], Any]:
    if isinstance(hook, PureDelay):
        return _make_delay(a, float(hook.seconds(*a.values)), dt)
    if not isinstance(hook, Stateful):
        return hook.make(p, SCALAR, *a.values)
    first, step = hook.make(p, SCALAR, dt, *a.values)
    memory: list[Any] = []

    def advance(signal: Any, now: Now) -> Any:
        out, *memory[:] = step(signal, now, *(memory or first(signal)))
        return out

    return advance


def _make_delay(a: ActiveEffect, seconds: float, dt: float) -> Callable[[Any, Now], Any]:
    """The signal ``seconds`` later. Raises UsageError for a time in the future."""
    ring = DelayRing(seconds, dt)
    if ring.whole < 0:
        raise UsageError(f"{a.name} of {seconds} s would need the future",
                         found=f"{seconds} s", expected="0 s or more in a running car",
                         remedy=f"give {a.name} another sign, or apply it to a recording")
    return lambda signal, now: ring.step(signal)


def _batch_size(p: Vehicle) -> int:
    """Number of lanes of the arrays among the parameters, 0 without any."""
    groups = (getattr(p, name) for name in PARAMETER_GROUPS)
    parts = [v for g in groups for v in map(g.__getattribute__, g.__slots__)]
    parts += [v for a in p.effects for v in a.values]
    return max((v.shape[0] for v in parts if isinstance(v, np.ndarray) and v.shape), default=0)


def _repeat_in_batch(series: Any, lanes: int) -> Any:
    """(n,) as (n, lanes); numbers and what has lanes already as they are."""
    if np.ndim(series) != 1:
        return series
    return np.repeat(np.asarray(series)[:, None], lanes, axis=1)
