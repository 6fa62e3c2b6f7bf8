"""From commands to the inputs of the actuators: quanta, dead band, pure delay.

A pure delay is a queue. A delay that is no whole number of steps makes the
command change in the middle of a step; the step is cut there, so the answer is
that of the exact switching time, whatever the step.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

from dart_hal.vehicle.namespace import Value
from dart_lab.sim.light.config import Actuators
from dart_lab.sim.light.ops import Ops

EXACT = 1e-9
"""s; switching times closer to a step than this are at it."""


@dataclass(frozen=True, slots=True)
class Piece:
    """A part of a step, and how many steps old the commands are that act in it."""

    duration: float
    throttle: int
    steering: int


def pieces(step: float, throttle_delay: float, steering_delay: float) -> tuple[Piece, ...]:
    """A step [s] cut where a delayed command [s] switches: one to three pieces.

    >>> pieces(0.01, 0.0, 0.025)
    (Piece(duration=0.005, throttle=0, steering=3), Piece(duration=0.005, throttle=0, steering=2))
    """
    (whole_t, switch_t), (whole_s, switch_s) = (
        _split(d, step) for d in (throttle_delay, steering_delay))
    cuts = sorted({0.0, switch_t, switch_s, step})
    return tuple(Piece(round(b - a, 12), whole_t + (a < switch_t), whole_s + (a < switch_s))
                 for a, b in pairwise(cuts) if b - a > EXACT)


def _split(delay: float, step: float) -> tuple[int, float]:
    """Whole steps of a delay, and the time in a step at which the command switches."""
    whole = math.floor((delay + EXACT) / step)
    rest = delay - whole * step
    return whole, rest if rest > EXACT else 0.0


def make_shaping(p: Actuators, ops: Ops) -> Callable[[Value, Value], tuple[Value, Value]]:
    """``shape(throttle, steering)``: clipped to -1..1, in whole quanta, without the dead band."""
    f, choose = ops.f, ops.choose

    def rounded(v: Value, quantum: float) -> Value:
        return f.floor(v / quantum + 0.5) * quantum if quantum > 0.0 else v

    def shape(throttle: Value, steering: Value) -> tuple[Value, Value]:
        tau = rounded(f.fmax(-1.0, f.fmin(1.0, throttle)), p.throttle_quantum)
        if p.dead_band > 0.0:
            tau = choose(f.fabs(tau) <= p.dead_band, 0.0 * tau, tau)
        return tau, rounded(f.fmax(-1.0, f.fmin(1.0, steering)), p.steering_quantum)

    return shape


def make_slew(rate: float, ops: Ops) -> Callable[[Value, Value, float], tuple[Value, Value]]:
    """``slew(position, target, duration) -> (new position, mean over the duration)``.

    The position moves towards the target at most at ``rate`` [1/s]. The mean is
    that of the exact ramp; it is what the equations see during a piece of a step.
    """
    f = ops.f

    def slew(position: Value, target: Value, duration: float) -> tuple[Value, Value]:
        most = rate * duration
        moved = f.fmax(-most, f.fmin(most, target - position))
        return position + moved, position + moved - 0.5 * moved * f.fabs(moved) / most

    return slew
