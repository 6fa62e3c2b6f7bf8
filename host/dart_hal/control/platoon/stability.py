"""Whether a disturbance fades along the string: the largest gain from speed to speed.

Linear, sampled each ``dt`` s (position by the old speed), actuation ``delay`` s late. With z on the
unit circle and the predecessor's speed as input

    v = dt z^-n / (z - 1) u           p = dt / (z - 1) v
    u = -k (p' - p_p') - c (v' - v_p) - k h v' + share F z^-a (z - 1) / dt v_p

where p', v' are the own motion through the n commands under way, p_p' the predecessor's at its
speed, F = beta / (1 - (1 - beta) / z), and a the steps that a told acceleration is old.
"""

from __future__ import annotations

import numpy as np

from dart_hal.control.platoon.gains import Gains

# Of the Nyquist frequency.
FREQUENCIES = np.geomspace(1e-3, 1.0, 4000)


def peak(gains: Gains, dt: float, delay: float, *, told: bool = True,
         compensated: bool = True, age: float = 0.0) -> float:
    """Largest |v / v_p|; at most 1: a disturbance grows from no car to the next.

    told: with the feed-forward, ``age`` s old; compensated: for the delay [s].
    """
    n = round(delay / dt)
    old = round(age / dt)
    z = np.exp(1j * np.pi * FREQUENCIES)
    integral = dt / (z - 1.0)
    speed = integral * z**-n  # own, of one unit of u
    way = integral * speed
    coming = speed + 0.0
    where = way + 0.0
    if compensated:
        for j in range(n, 0, -1):
            where = where + dt * coming
            coming = coming + dt * z**-j
    ahead = integral + (n * dt if compensated else 0.0)
    forward = gains.beta / (1.0 - (1.0 - gains.beta) / z) * gains.share * (z - 1.0) / dt * z**-old
    u = ((gains.k * ahead + gains.c + (forward if told else 0.0))
         / (1.0 + gains.k * where + gains.c * coming + gains.k * gains.h * coming))
    gain: float = float(np.abs(u * speed).max())
    return gain
