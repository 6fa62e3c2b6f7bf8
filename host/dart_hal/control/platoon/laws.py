"""The published laws of a platoon: which acceleration the leader and a follower ask for.

gap [m]: from the predecessor's tail to the own nose; speed, ahead [m/s]: own and predecessor's.
"""

from __future__ import annotations

from dart_hal.control.platoon.gains import Gains


def leader(gains: Gains, speed: float) -> float:
    """Acceleration [m/s2] of the first car, towards the platoon's speed."""
    return clipped(gains, -5.0 * gains.h * gains.k * (speed - gains.v_d))


def acc(gains: Gains, gap: float, speed: float, ahead: float) -> float:
    """Acceleration [m/s2] by own sensors alone, not clipped."""
    return (-gains.k * (gains.d - gap) - gains.c * (speed - ahead)
            - gains.k * gains.h * (speed - gains.v_d))


def limited(gains: Gains, gap: float, speed: float, ahead: float, told: float) -> float:
    """What of a told acceleration [m/s2] may be fed forward.

    None of it where gap and closing speed have used up the distance; and no more than k alpha of
    what the linear law would brake with. There is no lower limit.
    """
    closing = speed - ahead
    if gains.d - gap >= gains.d - gains.c / gains.k * closing:
        return 0.0
    return min(told, gains.k * (gains.alpha * gains.d + gains.h * (speed - gains.v_d)))


def cacc(gains: Gains, gap: float, speed: float, ahead: float, told: float) -> float:
    """Acceleration [m/s2] with the limited feed-forward of what was told, not clipped."""
    return acc(gains, gap, speed, ahead) + limited(gains, gap, speed, ahead, told)


def clipped(gains: Gains, u: float) -> float:
    """Within what the car can do; last of all."""
    return min(max(u, gains.u_min), gains.u_max)
