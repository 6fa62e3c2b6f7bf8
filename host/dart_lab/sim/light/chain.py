"""Inputs of the actuators from commands: quanta, dead band, pure delay.

A pure delay is a queue. With a delay that is not a whole number of steps the command changes within
a step. The step is split there, so the result is that of the exact switching time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

from dart_hal.vehicle.namespace import Value
from dart_lab.sim.light.config import Actuators
from dart_lab.sim.light.ops import Ops

# Switching times closer to a step than this are at the step [s].
TIME_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True)
class StepPiece:
    """A part of a step [s], and the ages in steps of the commands that act in it."""

    duration: float
    throttle: int
    steering: int


def split_step(step: float, throttle_delay: float, steering_delay: float) -> tuple[StepPiece, ...]:
    """Split a step [s] where a delayed command [s] switches, into one to three pieces.

    >>> [(p.duration, p.throttle, p.steering) for p in split_step(0.01, 0.0, 0.025)]
    [(0.005, 0, 3), (0.005, 0, 2)]
    """
    (whole_t, switch_t), (whole_s, switch_s) = (
        _split_delay(d, step) for d in (throttle_delay, steering_delay))
    # Before its switching time within the step a command is one step older.
    cuts = sorted({0.0, switch_t, switch_s, step})
    return tuple(StepPiece(round(b - a, 12), whole_t + (a < switch_t), whole_s + (a < switch_s))
                 for a, b in pairwise(cuts) if b - a > TIME_TOLERANCE)


def _split_delay(delay: float, step: float) -> tuple[int, float]:
    """Return the whole steps of a delay, and the time in a step at which the command switches."""
    whole = math.floor((delay + TIME_TOLERANCE) / step)
    rest = delay - whole * step
    return whole, rest if rest > TIME_TOLERANCE else 0.0


def make_command_shaping(p: Actuators, ops: Ops) -> Callable[[Value, Value], tuple[Value, Value]]:
    """Make ``shape(throttle, steering)``: clip to -1..1, round to quanta, apply the dead band."""
    f = ops.f
    choose = ops.choose

    def quantise(v: Value, quantum: float) -> Value:
        return f.floor(v / quantum + 0.5) * quantum if quantum > 0.0 else v

    def shape(throttle: Value, steering: Value) -> tuple[Value, Value]:
        tau = quantise(f.fmax(-1.0, f.fmin(1.0, throttle)), p.throttle_quantum)
        if p.dead_band > 0.0:
            tau = choose(f.fabs(tau) <= p.dead_band, 0.0 * tau, tau)
        return tau, quantise(f.fmax(-1.0, f.fmin(1.0, steering)), p.steering_quantum)

    return shape


def make_slew(rate: float, ops: Ops) -> Callable[[Value, Value, float], tuple[Value, Value]]:
    """Make ``slew(position, target, duration) -> (new position, mean over the duration)``.

    The position moves towards the target with at most ``rate`` [1/s]. The mean is that of the exact
    ramp and is the input of the equations of motion. With a move d of at most m it is
    position + d - d |d| / (2 m).
    """
    f = ops.f

    def slew(position: Value, target: Value, duration: float) -> tuple[Value, Value]:
        limit = rate * duration
        # The ramp lasts |moved| / rate, then the position is constant.
        moved = f.fmax(-limit, f.fmin(limit, target - position))
        return position + moved, position + moved - 0.5 * moved * f.fabs(moved) / limit

    return slew
