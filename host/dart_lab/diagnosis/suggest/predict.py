"""Predicted curves of the pair that a drive separates least."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.fitting.robust import MAD_TO_SIGMA
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evidence.drive import prepare_drive
from dart_lab.identification.evidence.onboard import ONBOARD_MOTION
from dart_lab.identification.evidence.readings import SENSORS
from dart_lab.identification.evidence.residuals import MOTION, Residuals

from .evidence import MOCAP
from .race import DriveSimulation
from .result import DrivePrediction, Pair

CHANNEL_UNITS = {"v_x": "m/s", "v_y": "m/s", "omega": "rad/s", "encoder": "m/s", "gyro": "rad/s",
         "accel_x": "m/s2", "accel_y": "m/s2"}
Curves = dict[str, tuple[FloatArray, FloatArray]]


def predict_hardest_pair(simulation: DriveSimulation,
                         pairs: Sequence[Pair]) -> DrivePrediction | None:
    """Predict the first part of the drive for the pair with the smallest separation.

    Returns None if there is no pair or the drive has no data.
    """
    if not pairs:
        return None
    hardest = min(pairs, key=lambda pair: pair.after)
    fitted = simulation.fitted_confounder(hardest.effect, hardest.confounder)
    if fitted is None:
        return None
    truth, confounder = (_curves(simulation, p) for p in (simulation.question.cars[hardest.effect],
                                                          fitted.car))
    channel, noise = _channel(simulation, truth, confounder)
    commands = simulation.drive.commands[0]
    t = np.asarray(np.arange(len(commands.throttle)) * SAMPLE, dtype=np.float64)
    curves = {hardest.effect: truth[channel][1], hardest.confounder: confounder[channel][1]}
    return DrivePrediction(t, commands.throttle, commands.steering, channel, CHANNEL_UNITS[channel],
                      truth[channel][0], curves, noise)


def _channel(simulation: DriveSimulation, truth: Curves, confounder: Curves) -> tuple[str, float]:
    """Find the channel in which two cars differ most relative to its noise, and that noise."""
    motion = MOTION if simulation.setting.needs == MOCAP else ONBOARD_MOTION
    found = list(zip((*motion, *SENSORS), _noise_scales(simulation.setting.final_residuals,
                                                        len(motion)).tolist(), strict=True))
    # On board, encoder and gyro are both motion and sensors: the noise of the motion is used,
    # unless the car is at rest.
    scales = dict(found if not simulation.has_motion else reversed(found))
    differences = {name: float(np.sqrt(np.mean((truth[name][1] - confounder[name][1])**2))) / size
           for name, size in scales.items()}
    best = max(differences, key=lambda name: differences[name])
    return best, scales[best]


def _noise_scales(final_residuals: Residuals, columns: int) -> FloatArray:
    """Robust standard deviation of each channel, the motion at its first time; inf if unknown."""
    with np.errstate(invalid="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a channel without any reading
        both = [np.nanmedian(np.abs(part), axis=0) for part in (final_residuals.motion[:, :columns],
                                                                final_residuals.sensors)]
    return np.nan_to_num(MAD_TO_SIGMA * np.concatenate(both), nan=np.inf) + 1e-6


def _curves(simulation: DriveSimulation, p: Vehicle) -> Curves:
    """Times [s] and values by channel of the drive, as measured by mocap and sensors."""
    recording = simulation.recording(p)
    setting = simulation.setting
    m = recording.messages
    out = {"encoder": (m.t, m.speed), "gyro": (m.t, m.yaw_rate), "accel_x": (m.t, m.accel_x),
           "accel_y": (m.t, m.accel_y)}
    if setting.needs == MOCAP:
        g = prepare_drive(recording, setting.l_r, setting.reference).grid
        out |= {name: (g.t, np.asarray(getattr(g, name))) for name in MOTION}
    return out
