"""The published laws of a platoon: accelerations of the leader and of a follower.

gap [m]: from the predecessor's tail to the own nose; speed, predecessor_speed [m/s].
"""

from __future__ import annotations

from dart_hal.control.platoon.gains import PlatoonGains


def leader(gains: PlatoonGains, speed: float) -> float:
    """Return the acceleration [m/s2] of the first car, towards the speed of the platoon."""
    return clip(gains, -5.0 * gains.h * gains.k * (speed - gains.v_d))


def acc(gains: PlatoonGains, gap: float, speed: float, predecessor_speed: float) -> float:
    """Return the acceleration [m/s2] by own sensors alone, not clipped."""
    return (-gains.k * (gains.d - gap) - gains.c * (speed - predecessor_speed)
            - gains.k * gains.h * (speed - gains.v_d))


def limit_feed_forward(
    gains: PlatoonGains, gap: float, speed: float, predecessor_speed: float, reported: float
) -> float:
    """Return the part of a reported acceleration [m/s2] that is fed forward.

    Zero if gap and closing speed have used up the distance; otherwise at most k alpha times what
    the linear law would brake with. There is no lower limit.
    """
    closing = speed - predecessor_speed
    if gains.d - gap >= gains.d - gains.c / gains.k * closing:
        return 0.0
    return min(reported, gains.k * (gains.alpha * gains.d + gains.h * (speed - gains.v_d)))


def clip(gains: PlatoonGains, u: float) -> float:
    """Limit an acceleration to what the car can do."""
    return min(max(u, gains.u_min), gains.u_max)
