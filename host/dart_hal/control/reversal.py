"""Change of direction with an ESC that brakes before it reverses.

After driving forward, such an ESC interprets the first pulse below neutral as braking until it has
been at neutral for a while; the next pulse reverses. An ESC without a brake reverses at once: then
every step here drives in the requested direction.
"""

from __future__ import annotations

import math
from enum import Enum

from dart_hal.control.measured import DEFAULT_REVERSE_REST

# Speed below which the wheels stop within the next edges [m/s]: one edge of 2.1 mm in 35 ms.
REST_SPEED = 0.06
# Throttle below neutral: beyond a dead band (0.16 at most in hidden cars), less than the full
# brake.
BRAKE_THROTTLE = 0.35
# Shortest braking [s]; three PWM frames, so that the ESC has received the pulse at any speed.
MIN_BRAKE_TIME = 0.06
# Longest braking [s]: a third of the brake needs half a second from 2 m/s. Beyond, the speed is
# doubted.
MAX_BRAKE_TIME = 1.0
# Increase of the speed [m/s] that shows that the pulse drives the car backward.
MAX_SPEED_GAIN = 0.12
# Time in reverse without a turning wheel [s], after which the ESC has braked instead: rest again.
MAX_IDLE_REVERSE_TIME = 0.7


class ReversalPhase(Enum):
    """State of the sequence; FREE: the throttle of the speed law is used."""

    FREE = "free"
    BRAKE_THROTTLE = "brake"
    REST = "rest"


class Reversal:
    """Sequence brake, rest, reverse; call once per control period.

    ``rest`` [s]: time at neutral between brake and reverse, 0: the ESC has no brake. ``holding``:
    whether the throttle differs from that of the speed law.
    """

    def __init__(self, rest: float = DEFAULT_REVERSE_REST) -> None:
        self._rest = rest
        self._phase = ReversalPhase.FREE
        self._forward = False
        self._phase_time = self._idle_reverse_time = 0.0
        self._min_speed = math.inf

    def reset(self) -> None:
        """Restart with the next pulse; whether the car was driven forward is kept."""
        self._enter(ReversalPhase.FREE)
        self._idle_reverse_time = 0.0

    @property
    def holding(self) -> bool:
        return self._phase is not ReversalPhase.FREE

    def throttle(self, requested: float, speed: float, dt: float) -> float:
        """Return the throttle for a requested one at a speed [m/s] of either sign, ``dt`` s later.

        Forward and neutral are never changed. Requests below neutral after driving forward pass
        through

            FREE -> BRAKE (until at rest, MIN_BRAKE_TIME at least) -> REST (``rest`` s) -> FREE
        """
        if requested >= 0.0 or self._rest == 0.0:
            self.reset()
            self._forward |= requested > 0.0
            return requested
        self._phase_time += dt
        if self._phase is ReversalPhase.FREE:
            return self._backward(requested, speed, dt)
        if self._phase is ReversalPhase.BRAKE_THROTTLE:
            self._min_speed = min(self._min_speed, abs(speed))
            pulls_back = abs(speed) > self._min_speed + MAX_SPEED_GAIN
            stopped = abs(speed) < REST_SPEED and self._phase_time >= MIN_BRAKE_TIME
            if not (stopped or pulls_back or self._phase_time >= MAX_BRAKE_TIME):
                return -BRAKE_THROTTLE
            self._enter(ReversalPhase.REST)
        if self._phase_time < self._rest:
            return 0.0
        self._forward = False
        self._enter(ReversalPhase.FREE)
        return requested

    def _backward(self, requested: float, speed: float, dt: float) -> float:
        """Begin with the brake after forward; rest again if the wheels do not turn in reverse."""
        if self._forward:
            self._enter(ReversalPhase.BRAKE_THROTTLE)
            return -BRAKE_THROTTLE
        self._idle_reverse_time = self._idle_reverse_time + dt if abs(speed) < REST_SPEED else 0.0
        if self._idle_reverse_time < MAX_IDLE_REVERSE_TIME:
            return requested
        self._idle_reverse_time = 0.0
        self._enter(ReversalPhase.REST)
        return 0.0

    def _enter(self, phase: ReversalPhase) -> None:
        self._phase = phase
        self._phase_time = 0.0
        self._min_speed = math.inf
