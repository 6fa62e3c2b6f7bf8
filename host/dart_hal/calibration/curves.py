"""Sub-models of the paper with their analytic Jacobians, over numpy arrays.

The equations are those of ``vehicle``, without its bounds: a solver also
walks through values that no car can have. Each function takes the parameters
x (k,) and inputs (n,), and gives the value (n,) and d value / d x (n, k).
"""

from __future__ import annotations

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.motor import SHARPNESS
from dart_hal.vehicle.steering import BLEND

Curve = tuple[FloatArray, FloatArray]


def friction(x: FloatArray, v: FloatArray) -> Curve:
    """x: a [N], b [s/m], c [N s/m]; v [m/s] -> force [N]."""
    a, b, c = x
    bend = np.tanh(b * v)
    slopes = np.stack([-bend, -a * v * (1.0 - bend**2), -v], axis=1)
    return -(a * bend + c * v), slopes


def motor(x: FloatArray, tau: FloatArray, v: FloatArray) -> Curve:
    """x: d [N], e [N s/m], g; throttle tau, v [m/s] -> force [N]."""
    d, e, g = x
    u = tau + g
    bend = np.tanh(SHARPNESS * u)
    open_ = 0.5 * u * (bend + 1.0)
    gain = d - e * v
    slope_u = 0.5 * (bend + 1.0) + 0.5 * SHARPNESS * u * (1.0 - bend**2)
    return gain * open_, np.stack([open_, -v * open_, gain * slope_u], axis=1)


def steering(x: FloatArray, s: FloatArray) -> Curve:
    """x: k_left, a_left [rad], s0, a_right [rad], k_right; command s -> angle [rad]."""
    k_left, a_left, s0, a_right, k_right = x
    c = s + s0
    blend = np.tanh(BLEND * c)
    w = 0.5 * (blend + 1.0)
    left = np.tanh(k_left * c)
    right = np.tanh(k_right * c)
    bend_left = 1.0 - left**2
    bend_right = 1.0 - right**2
    by_c = (0.5 * BLEND * (1.0 - blend**2) * (a_left * left - a_right * right)
            + w * a_left * k_left * bend_left + (1.0 - w) * a_right * k_right * bend_right)
    slopes = [w * a_left * bend_left * c, w * left, by_c, (1.0 - w) * right,
              (1.0 - w) * a_right * bend_right * c]
    return w * a_left * left + (1.0 - w) * a_right * right, np.stack(slopes, axis=1)


def pacejka(x: FloatArray, alpha: FloatArray) -> Curve:
    """x: D [N], C, B [1/rad], E; slip angle alpha [rad] -> force [N]."""
    D, C, B, E = x
    y = B * alpha
    bend = np.arctan(y)
    z = y - E * (y - bend)
    angle = np.arctan(z)
    sine = np.sin(C * angle)
    cosine = np.cos(C * angle)
    by_z = D * C * cosine / (1.0 + z**2)
    by_b = alpha * (1.0 - E * (1.0 - 1.0 / (1.0 + y**2)))
    slopes = [sine, D * cosine * angle, by_z * by_b, by_z * (bend - y)]
    return D * sine, np.stack(slopes, axis=1)


def pacejka_without_e(x: FloatArray, alpha: FloatArray) -> Curve:
    """The same with E = 0; x: D, C, B."""
    value, slopes = pacejka(np.append(x, 0.0), alpha)
    return value, slopes[:, :3]


def saturation(x: FloatArray, alpha: FloatArray) -> Curve:
    """D tanh(B alpha); x: D [N], B [1/rad]."""
    D, B = x
    bend = np.tanh(B * alpha)
    return D * bend, np.stack([bend, D * alpha * (1.0 - bend**2)], axis=1)


def linear(x: FloatArray, alpha: FloatArray) -> Curve:
    """x: cornering stiffness [N/rad]; slip angle alpha [rad] -> force [N]."""
    return x[0] * alpha, alpha[:, None]


def linear_with_offset(x: FloatArray, alpha: FloatArray) -> Curve:
    """x: cornering stiffness [N/rad], slip offset [rad]."""
    shifted = alpha + x[1]
    return x[0] * shifted, np.stack([shifted, np.full(len(alpha), x[0])], axis=1)
