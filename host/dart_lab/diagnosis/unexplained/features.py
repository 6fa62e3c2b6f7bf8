"""What the car did in each window and at each message: the axes along which residuals are judged.

All are taken from the measured motion and the logged commands. They say
where a residual lies and never how large it is, so anything that depends on
them is structure. A window is described by its mean, a message by the mean
over the time in which its encoder counted.
"""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.parameters import GEAR_REVOLUTION, Vehicle
from dart_lab.identification.prediction.actuators import actuated

from ..evidence.drive import READ_OUTS, RecordedDrive
from ..evidence.readings import ENCODER_SAMPLES
from ..evidence.residuals import Evidence

UNITS = MappingProxyType({
    "speed": "m/s", "steering_angle": "rad", "steering_rate": "rad/s", "throttle": "-",
    "acceleration": "m/s2", "lateral_acceleration": "m/s2", "yaw_rate": "rad/s", "time": "s",
    "x": "m", "y": "m", "heading": "rad", "revolution_angle": "turn", "direction": "-",
    "way": "m"})
"""Every feature and its unit. steering_angle: of the road wheels, behind delay, lag and map;
steering_rate: its mean change; time: since the recording began; heading: -pi to pi;
revolution_angle: of the encoder's gear, 0 to 1; direction: 1 left, -1 right, 0 straight on;
way: driven since the recording began."""
STRAIGHT = 0.15
"""rad/s; a mean yaw rate below it is no turn."""
Features = dict[str, FloatArray]


def window_features(evidence: Evidence, p: Vehicle, span: int = READ_OUTS[-1]) -> Features:
    """Features of each window, (n,) by name of UNITS, over its first ``span`` samples.

    p: whose delays, lags and steering map say where the wheels stood.
    """
    def ends(drive: RecordedDrive) -> tuple[FloatArray, FloatArray]:
        first = np.asarray(drive.starts, dtype=np.float64)
        return first, first + span

    return _gathered(evidence, p, ends)


def message_features(evidence: Evidence, p: Vehicle) -> Features:
    """Features of each message, (m,) by name of UNITS, over the WINDOW samples before it."""
    return _gathered(evidence, p, lambda d: (
        d.message_samples - ENCODER_SAMPLES, d.message_samples))


def exogenous(p: Vehicle, features: Features, straight: float) -> Features:
    """Features without what the disturbance itself moves.

    straight [rad]: of steering; half of it is neither left nor right. A gust makes the car
    faster than the model says and accelerates it: residual and measured acceleration go together
    although the model lacks nothing.
    """
    keep = {k: v for k, v in features.items() if k not in ("acceleration", "yaw_rate")}
    keep["lateral_acceleration"] = (keep["speed"]**2 * np.tan(keep["steering_angle"])
                                    / p.body.wheelbase)
    keep["direction"] = np.sign(np.round(keep["steering_angle"] / straight))
    return keep


def _gathered(evidence: Evidence, p: Vehicle,
              ends: Callable[[RecordedDrive], tuple[FloatArray, FloatArray]]) -> Features:
    parts = [_of(drive, p, *ends(drive)) for drive in evidence.drives]
    return {name: np.concatenate([part[name] for part in parts] or [np.empty(0)])
            for name in UNITS}


def _of(drive: RecordedDrive, p: Vehicle, first: FloatArray, last: FloatArray) -> Features:
    """Between samples first and last (n,) of one recording."""
    g = drive.grid
    sample = np.arange(len(g))
    throttle, angle = actuated(p, g, smooth=True)

    def at(series: FloatArray, where: FloatArray) -> FloatArray:
        return np.asarray(np.interp(where, sample, series))

    def mean(series: FloatArray) -> FloatArray:
        total = np.concatenate([[0.0], np.cumsum(0.5 * (series[1:] + series[:-1]))])
        return (at(total, last) - at(total, first)) / (last - first)

    seconds = (last - first) * SAMPLE
    middle = 0.5 * (first + last)
    turn = mean(g.omega)
    turns = np.concatenate([[0.0], np.cumsum(0.5 * (g.v_x[1:] + g.v_x[:-1]))])
    return {
        "speed": mean(g.v_x), "steering_angle": mean(angle),
        "steering_rate": (at(angle, last) - at(angle, first)) / seconds,
        "throttle": mean(throttle),
        "acceleration": (at(g.v_x, last) - at(g.v_x, first)) / seconds - mean(g.omega * g.v_y),
        "lateral_acceleration": ((at(g.v_y, last) - at(g.v_y, first)) / seconds
                                 + mean(g.omega * g.v_x)),
        "yaw_rate": turn, "time": at(g.t, middle), "x": at(g.x, middle), "y": at(g.y, middle),
        "heading": _wrapped(at(g.yaw, middle)),
        "revolution_angle": at(turns * SAMPLE / GEAR_REVOLUTION, middle) % 1.0,
        "direction": np.sign(np.where(np.abs(turn) < STRAIGHT, 0.0, turn)),
        "way": at(turns * SAMPLE, middle)}


def _wrapped(angle: FloatArray) -> FloatArray:
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)

