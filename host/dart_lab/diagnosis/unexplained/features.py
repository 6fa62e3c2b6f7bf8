"""Features: the motion in each window and at each message, on which residuals may depend.

All are computed from the measured motion and the logged commands, not from a prediction. A
dependence of the residuals on them is structure, but for those that the disturbance itself changes,
which ``exogenous`` removes or replaces. A window is described by its mean, a message by the mean
over the time in which its encoder counted.
"""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart.mocap import wrap
from dart_hal.vehicle.parameters import GEAR_REVOLUTION, Vehicle
from dart_hal.vehicle.scale import find_scale
from dart_lab.identification.evidence.drive import READ_OUTS, RecordedDrive
from dart_lab.identification.evidence.readings import ENCODER_SAMPLES
from dart_lab.identification.evidence.residuals import Evidence
from dart_lab.identification.prediction.actuators import actuator_outputs

MAX_STRAIGHT_ANGLE = 0.03  # rad of steering; half of it is neither left nor right
# Every feature and its unit. steering_angle: of the road wheels, after delay, lag and map;
# steering_rate: its mean change; time: since the start of the recording; heading: -pi to pi;
# revolution_angle: of the gear with the encoder, 0 to 1; direction: 1 left, -1 right, 0 straight;
# way: distance driven since the start of the recording.
FEATURE_UNITS = MappingProxyType({
    "speed": "m/s", "steering_angle": "rad", "steering_rate": "rad/s", "throttle": "-",
    "acceleration": "m/s2", "lateral_acceleration": "m/s2", "yaw_rate": "rad/s", "time": "s",
    "x": "m", "y": "m", "heading": "rad", "revolution_angle": "turn", "direction": "-",
    "way": "m"})
# rad/s, of a car of 1:10: a smaller mean yaw rate counts as straight.
MIN_TURN_RATE = 0.15
Features = dict[str, FloatArray]


def window_features(evidence: Evidence, p: Vehicle, span: int = READ_OUTS[-1]) -> Features:
    """Features of each window, (n,) by name of FEATURE_UNITS, over its first ``span`` samples.

    p: vehicle with the delays, lags and steering map that give the angle of the wheels.
    """
    def ends(drive: RecordedDrive) -> tuple[FloatArray, FloatArray]:
        first = np.asarray(drive.starts, dtype=np.float64)
        return first, first + span

    return _collect_features(evidence, p, ends)


def message_features(evidence: Evidence, p: Vehicle) -> Features:
    """Features of each message, (m,) by name, over the ENCODER_SAMPLES before it."""
    return _collect_features(evidence, p, lambda d: (d.message_samples - ENCODER_SAMPLES,
                                                     d.message_samples))


def exogenous(p: Vehicle, features: Features) -> Features:
    """Select features that the disturbance itself does not change, and recompute two of them.

    A gust accelerates the car and makes it faster than predicted: residual and measured
    acceleration are correlated although the model is right. Lateral acceleration and direction are
    therefore computed from speed and steering. The direction is 0 below half of MAX_STRAIGHT_ANGLE.
    """
    keep = {k: v for k, v in features.items() if k not in ("acceleration", "yaw_rate")}
    keep["lateral_acceleration"] = (keep["speed"]**2 * np.tan(keep["steering_angle"])
                                    / p.body.wheelbase)
    keep["direction"] = np.sign(np.round(keep["steering_angle"] / MAX_STRAIGHT_ANGLE))
    return keep


def _collect_features(evidence: Evidence, p: Vehicle,
                      ends: Callable[[RecordedDrive], tuple[FloatArray, FloatArray]]) -> Features:
    """Concatenate the features of all drives; ends: first and last samples of windows."""
    parts = [_drive_features(drive, p, *ends(drive)) for drive in evidence.drives]
    return {name: np.concatenate([part[name] for part in parts] or [np.empty(0)])
            for name in FEATURE_UNITS}


def _drive_features(drive: RecordedDrive, p: Vehicle, first: FloatArray,
                    last: FloatArray) -> Features:
    """Features between samples first and last (n,) of one recording."""
    g = drive.grid
    sample = np.arange(len(g))
    throttle, angle = actuator_outputs(p, g, smooth=True)

    def sample_at(series: FloatArray, position: FloatArray) -> FloatArray:
        return np.asarray(np.interp(position, sample, series))

    def mean(series: FloatArray) -> FloatArray:
        # Mean between two times that are no samples: difference of the integral (trapezoidal rule).
        total = np.concatenate([[0.0], np.cumsum(0.5 * (series[1:] + series[:-1]))])
        return (sample_at(total, last) - sample_at(total, first)) / (last - first)

    seconds = (last - first) * SAMPLE
    middle = 0.5 * (first + last)
    yaw_rate = mean(g.omega)
    straight = MIN_TURN_RATE * find_scale(p.body).yaw_rate
    distance = np.concatenate([[0.0], np.cumsum(0.5 * (g.v_x[1:] + g.v_x[:-1]))])
    return {
        "speed": mean(g.v_x), "steering_angle": mean(angle),
        "steering_rate": (sample_at(angle, last) - sample_at(angle, first)) / seconds,
        "throttle": mean(throttle),
        "acceleration": ((sample_at(g.v_x, last) - sample_at(g.v_x, first)) / seconds
                         - mean(g.omega * g.v_y)),
        "lateral_acceleration": ((sample_at(g.v_y, last) - sample_at(g.v_y, first)) / seconds
                                 + mean(g.omega * g.v_x)),
        "yaw_rate": yaw_rate, "time": sample_at(g.t, middle),
        "x": sample_at(g.x, middle), "y": sample_at(g.y, middle),
        "heading": wrap(sample_at(g.yaw, middle)),
        "revolution_angle": sample_at(distance * SAMPLE / GEAR_REVOLUTION, middle) % 1.0,
        "direction": np.sign(np.where(np.abs(yaw_rate) < straight, 0.0, yaw_rate)),
        "way": sample_at(distance * SAMPLE, middle)}
