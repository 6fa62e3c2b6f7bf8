"""The pair that a drive separates least, as curves: what each of the two would show."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.fitting.robust import MAD_TO_SIGMA
from dart_hal.vehicle.parameters import Vehicle

from ..evidence.drive import prepare_drive
from ..evidence.onboard import ONBOARD_MOTION as READ
from ..evidence.readings import SENSORS
from ..evidence.residuals import MOTION, Residuals
from .evidence import MOCAP
from .race import Race
from .result import Pair, Prediction

UNITS = {"v_x": "m/s", "v_y": "m/s", "omega": "rad/s", "encoder": "m/s", "gyro": "rad/s",
         "accel_x": "m/s2", "accel_y": "m/s2"}
Curves = dict[str, tuple[FloatArray, FloatArray]]


def predict(race: Race, pairs: Sequence[Pair]) -> Prediction | None:
    """Of the first part of the drive; None where it tells nothing."""
    if not pairs:
        return None
    hardest = min(pairs, key=lambda pair: pair.after)
    mimic = race.mimic(hardest.effect, hardest.confounder)
    if mimic is None:
        return None
    truth, confounder = (_curves(race, p) for p in (race.question.cars[hardest.effect], mimic.car))
    channel, noise = _channel(race, truth, confounder)
    commands = race.drive.commands[0]
    t = np.asarray(np.arange(len(commands.throttle)) * SAMPLE, dtype=np.float64)
    says = {hardest.effect: truth[channel][1], hardest.confounder: confounder[channel][1]}
    return Prediction(t, commands.throttle, commands.steering, channel, UNITS[channel],
                      truth[channel][0], says, noise)


def _channel(race: Race, truth: Curves, confounder: Curves) -> tuple[str, float]:
    """(the channel in which two cars differ most, in units of its noise; that noise)."""
    motion = MOTION if race.setting.needs == MOCAP else READ
    found = list(zip((*motion, *SENSORS), _sizes(race.setting.rest, len(motion)).tolist(),
                     strict=True))
    # on board, encoder and gyro are motion: that noise counts, unless the car stands
    sizes = dict(found if not race.moves else reversed(found))
    far = {name: float(np.sqrt(np.mean((truth[name][1] - confounder[name][1])**2))) / size
           for name, size in sizes.items()}
    best = max(far, key=lambda name: far[name])
    return best, sizes[best]


def _sizes(rest: Residuals, columns: int) -> FloatArray:
    """Robust standard deviation of each channel, motion at its first read-out; inf: unknown."""
    with np.errstate(invalid="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a channel without any reading
        both = [np.nanmedian(np.abs(part), axis=0) for part in (rest.motion[:, :columns],
                                                                rest.sensors)]
    return np.nan_to_num(MAD_TO_SIGMA * np.concatenate(both), nan=np.inf) + 1e-6


def _curves(race: Race, p: Vehicle) -> Curves:
    """(times [s], values) by channel of the drive, as mocap and sensors would show it."""
    recording, setting = race.recording(p), race.setting
    m = recording.messages
    out = {"encoder": (m.t, m.speed), "gyro": (m.t, m.yaw_rate), "accel_x": (m.t, m.accel_x),
           "accel_y": (m.t, m.accel_y)}
    if setting.needs == MOCAP:
        g = prepare_drive(recording, setting.l_r, setting.reference).grid
        out |= {name: (g.t, np.asarray(getattr(g, name))) for name in MOTION}
    return out
