"""Changing direction through an ESC that brakes before it reverses.

Such an ESC takes the first pull below neutral after driving forward as the brake, and lets go of
it only after a rest at neutral; the next pull reverses. One without a brake reverses at once: then
every step here pulls the way that is wanted anyway.
"""

from __future__ import annotations

import math
from enum import Enum

from dart_hal.control.measured import REST_S

# m/s; slower, and the wheels are standing for the next few edges: one edge of 2.1 mm in 35 ms.
AT_REST = 0.06
# Throttle below neutral: beyond a dead band (0.16 at most in hidden cars), not the whole brake.
BRAKE = 0.35
# s; three PWM frames, so that the ESC has seen the pull whatever the speed was.
LEAST_BRAKE_S = 0.06
# s; from 2 m/s a third of the brake takes half a second. Longer, and the speed is not believed.
MOST_BRAKE_S = 1.0
# m/s faster than it was: the pull drives the car backward, so nothing is left to brake.
GAINED = 0.12
# s in reverse without a wheel that turns: the ESC has braked instead, rest once more.
PATIENCE_S = 0.7


class Phase(Enum):
    """What the throttle is held at; FREE: at what the speed law asks for."""

    FREE = "free"
    BRAKE = "brake"
    REST = "rest"


class Reversal:
    """Which throttle an ESC has to see next; call once per control period.

    ``rest`` [s] at neutral between brake and reverse, 0: the ESC knows no brake. ``holding``: the
    throttle is not what the speed law asks for.
    """

    def __init__(self, rest: float = REST_S) -> None:
        self._rest = rest
        self._phase = Phase.FREE
        self._forward = False
        self._since = self._tried = 0.0
        self._slowest = math.inf

    def reset(self) -> None:
        """Begin again at the next pull; that the car was driven forward is kept."""
        self._enter(Phase.FREE)
        self._tried = 0.0

    @property
    def holding(self) -> bool:
        return self._phase is not Phase.FREE

    def throttle(self, wanted: float, speed: float, dt: float) -> float:
        """Throttle instead of ``wanted`` at a speed [m/s] of either sign, ``dt`` s later.

        Forward is never held back, and neutral never filled.
        """
        if wanted >= 0.0 or self._rest == 0.0:
            self.reset()
            self._forward |= wanted > 0.0
            return wanted
        self._since += dt
        if self._phase is Phase.FREE:
            return self._backward(wanted, speed, dt)
        if self._phase is Phase.BRAKE:
            self._slowest = min(self._slowest, abs(speed))
            pulls_back = abs(speed) > self._slowest + GAINED
            stopped = abs(speed) < AT_REST and self._since >= LEAST_BRAKE_S
            if not (stopped or pulls_back or self._since >= MOST_BRAKE_S):
                return -BRAKE
            self._enter(Phase.REST)
        if self._since < self._rest:
            return 0.0
        self._forward = False
        self._enter(Phase.FREE)
        return wanted

    def _backward(self, wanted: float, speed: float, dt: float) -> float:
        if self._forward:
            self._enter(Phase.BRAKE)
            return -BRAKE
        self._tried = self._tried + dt if abs(speed) < AT_REST else 0.0
        if self._tried < PATIENCE_S:
            return wanted
        self._tried = 0.0
        self._enter(Phase.REST)
        return 0.0

    def _enter(self, phase: Phase) -> None:
        self._phase = phase
        self._since = 0.0
        self._slowest = math.inf
