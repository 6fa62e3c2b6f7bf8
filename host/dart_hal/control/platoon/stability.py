"""Whether disturbances decay along the string: the largest gain from speed to speed.

Linear, sampled every ``dt`` s (position by the old speed), with an actuation delay. With z on the
unit circle and the predecessor's speed as input

    v = dt z^-n / (z - 1) u           p = dt / (z - 1) v
    u = -k (p' - p_p') - c (v' - v_p) - k h v' + share F z^-a (z - 1) / dt v_p

where p', v' are the own motion after the n commands that do not act yet, p_p' the predecessor's at
its speed, F = beta / (1 - (1 - beta) / z), and a the age of a reported acceleration in steps.
"""

from __future__ import annotations

import numpy as np

from dart_hal.control.platoon.gains import PlatoonGains

# Frequencies relative to the Nyquist frequency.
RELATIVE_FREQUENCIES = np.geomspace(1e-3, 1.0, 4000)


def peak_gain(gains: PlatoonGains, dt: float, delay: float, *, feed_forward: bool = True,
              compensated: bool = True, age: float = 0.0) -> float:
    """Return the largest |v / v_p|; at most 1: no disturbance grows from car to car.

    feed_forward: whether the reported acceleration is used, ``age`` s old; compensated: for the
    delay [s].
    """
    n = round(delay / dt)
    age_steps = round(age / dt)
    z = np.exp(1j * np.pi * RELATIVE_FREQUENCIES)
    integral = dt / (z - 1.0)
    speed = integral * z**-n  # own speed for u = 1
    position = integral * speed
    predicted_speed = speed + 0.0
    predicted_position = position + 0.0
    if compensated:
        for j in range(n, 0, -1):
            predicted_position = predicted_position + dt * predicted_speed
            predicted_speed = predicted_speed + dt * z**-j
    predecessor = integral + (n * dt if compensated else 0.0)
    acceleration_path = (
        gains.beta / (1.0 - (1.0 - gains.beta) / z) * gains.share * (z - 1.0) / dt * z**-age_steps
    )
    u = (gains.k * predecessor + gains.c + (acceleration_path if feed_forward else 0.0)) / (
        1.0
        + gains.k * predicted_position
        + gains.c * predicted_speed
        + gains.k * gains.h * predicted_speed
    )
    gain: float = float(np.abs(u * speed).max())
    return gain
