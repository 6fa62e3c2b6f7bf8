"""Residuals of recordings without motion capture: a model against the car's own sensors.

From a state that the sensors give, the model drives on with the logged commands
and says what encoder, gyro and accelerometer should read at each message that
follows. The state is known only as well as the sensors are; that error is alike
in all read-outs of a window, where the whitening finds it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dart_hal.identify.commands import actuated
from dart_hal.recording.dart import Grid
from dart_hal.types import FloatArray
from dart_hal.vehicle.batch import rollout
from dart_hal.vehicle.compose import settled
from dart_hal.vehicle.effect import Now
from dart_hal.vehicle.flat import unchecked
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.motor import make_motor
from dart_hal.vehicle.namespace import ARRAY
from dart_hal.vehicle.parameters import GEAR_REVOLUTION, Vehicle
from dart_hal.vehicle.signals import through
from dart_hal.vehicle.tyres import make_tyres

from .drive import STEP
from .onboard_drive import COUNTED, HEARD, READS, STRAY, Outing, spread
from .residuals import SENSORS, Residuals
from .subsample import FINE, fine

MOTION = ("encoder", "gyro")
BEFORE = 30  # samples ahead of a start: an encoder looks back, a late sensor further
BEYOND = 10  # samples behind a start: a sensor may be early
AFTER = round((READS * COUNTED + STRAY) / STEP) + 1
STEEPEST = 0.2  # rad; slip of the rear axle at a start


class OnboardEvidence:
    """Outings and how the residuals of any model on them are computed.

    As ``residuals.Evidence``, but motion is (n, READS * 2): encoder and gyro at
    each message of a window, and sensors (m, 4) are: accelerometer while driving
    and, in units of its noise then, at rest; gyro at rest; encoder never.
    """

    def __init__(self, drives: Sequence[Outing], l_r: float) -> None:
        self.drives, self.l_r = tuple(drives), l_r
        self.motion_drive = np.repeat(np.arange(len(drives)), [len(d.starts) for d in drives])
        self.sensor_drive = np.repeat(np.arange(len(drives)), [len(d.at) for d in drives])

    @property
    def columns(self) -> dict[str, int]:
        """As ``residuals.Evidence.columns``."""
        end = (READS - 1) * len(MOTION)
        return {**{name: end + i for i, name in enumerate(MOTION)}, "accel_x": -2, "accel_y": -1}

    def columns_at(self, horizon: float) -> dict[str, int]:
        """As ``residuals.Evidence.columns_at``: the speed is the wheel's, turning the gyro's."""
        read = round(horizon / COUNTED) - 1
        names = ("vx", "yaw_rate")
        return {n: read * len(MOTION) + i for i, n in enumerate(names)} if read < READS else {}

    def channel(self, column: int) -> str:
        """Name of a column of the motion, or of -1 - column of the sensors."""
        return MOTION[column % len(MOTION)] if column >= 0 else SENSORS[-1 - column]

    def blocks(self, length: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Stretches of ``length`` [s]: one label for each window (n,) and each message (m,)."""
        def label(drive: NDArray[np.int64], sample: FloatArray) -> NDArray[np.int64]:
            return np.asarray(drive * 100_000 + (sample * STEP // length).astype(np.int64))

        return (label(self.motion_drive, np.concatenate([d.begin for d in self.drives])),
                label(self.sensor_drive, np.concatenate([d.at for d in self.drives])))

    def residuals(self, p: Vehicle, late: float = 0.0, ahead: float = 0.0) -> Residuals:
        """Of the model p with its effects; late, ahead [s] as for ``Evidence.residuals``."""
        d = p.delay
        p = unchecked(p, {"delay": {"steering_s": d.steering_s - ahead,
                                    "throttle_s": d.throttle_s - ahead}}) if ahead else p
        q = settled(p)
        parts = [_of(drive, p, q, late) for drive in self.drives]
        motion, sensors = (np.concatenate(part) for part in zip(*parts, strict=True))
        for k in (0, 1):  # what says nothing of any model still needs a size
            if not np.isfinite(sensors[:, k]).any():
                sensors[:, k] = spread(len(sensors))
        return Residuals(motion, sensors)


def _of(drive: Outing, p: Vehicle, q: Vehicle, late: float) -> tuple[FloatArray, FloatArray]:
    rest = _at_rest(drive, p)
    if not len(drive.begin):
        return np.empty((0, READS * len(MOTION))), rest
    told = _told(drive, p, q, late)
    motion = (told[:2] - drive.said).transpose(2, 1, 0).reshape(len(drive.begin), -1)
    felt = told[2:, HEARD[0]:HEARD[1]].transpose(2, 1, 0).reshape(-1, 2)
    driven = np.full((len(felt), 4), np.nan)
    driven[:, 2:] = felt - drive.read[:len(felt), 2:]
    return motion, np.concatenate([driven, rest])


def _at_rest(drive: Outing, p: Vehicle) -> FloatArray:
    """What gyro and accelerometer say of a standing car, minus what they said; (k, 4)."""
    at = drive.at[drive.still]
    zero = np.zeros(len(at))
    g = drive.grid
    sample = np.arange(len(g))
    now = Now(np.interp(at, sample, g.t), zero, zero, zero, np.interp(at, sample, g.yaw))
    gyro = through(p, "gyro", zero, now, STEP)
    a_x, a_y = through(p, "accel", (zero, zero), now, STEP)
    out = np.stack([zero, gyro, a_x, a_y], axis=1) - drive.read[drive.still]
    out[:, 0] = np.nan
    out[:, 2:] *= drive.felt
    return np.asarray(out)


def _told(drive: Outing, p: Vehicle, q: Vehicle, late: float) -> FloatArray:
    """What encoder, gyro and accelerometer would have said in each window, (4, READS, n).

    The model has driven for BEFORE samples when a window starts, which gives it
    a speed sideways; speed and turning are then set right by what was read last.
    """
    g, throttle, angle = _measured(drive, p, q)
    over = np.arange(-BEFORE, AFTER + 1)[:, None] + drive.begin
    tau = _along(throttle, over - late / STEP)
    delta = fine(angle, over - late / STEP)
    t, way = _along(g.t, over), _along(np.cumsum(g.v_x) * STEP, over[:1])
    none = np.zeros(len(drive.begin))
    first = np.stack([none, none, *(_along(f, over[0]) for f in (g.yaw, g.v_x, g.v_y, g.omega))])
    long = BEFORE + BEYOND
    lead = _driven(p, first, tau[:long], delta[:FINE * long])
    here = Lanes(t[:long + 1], lead, tau[:long + 1], way)
    wheel, gyro, _, _ = here.sensors(p, q)
    wrong = drive.last - np.stack([np.abs(_mean(wheel, BEFORE + drive.past, COUNTED)),
                                   _mean(gyro, BEFORE + drive.past, drive.means)])
    lead = lead[:, :BEFORE + 1]
    lead[3] += wrong[0].mean(axis=0)
    lead[5] += wrong[1, -1]
    rest = _driven(p, lead[:, -1], tau[BEFORE:-1], delta[FINE * BEFORE:-FINE])
    whole = Lanes(t, np.concatenate([lead, rest[:, 1:]], axis=1), tau, way)
    wheel, gyro, a_x, a_y = whole.sensors(p, q)
    at = BEFORE + drive.spots
    return np.stack([np.abs(_mean(wheel, at, COUNTED)), *(_mean(f, at, drive.means)
                                                         for f in (gyro, a_x, a_y))])


def _driven(p: Vehicle, start: FloatArray, tau: FloatArray, delta: FloatArray) -> FloatArray:
    """States (6, samples + 1, n) from a start (6, n) on; delta in FINE steps per sample."""
    at = range(FINE, FINE * len(tau) + 1, FINE)
    after = rollout(p, start, np.repeat(tau, FINE, axis=0), delta, at=at, sample=STEP / FINE,
                    substeps=1)
    return np.asarray(np.concatenate([start[None], after]).swapaxes(0, 1))


@dataclass(frozen=True, slots=True)
class Lanes:
    """Windows side by side: t, throttle tau (samples, n), states (6, samples, n), and the
    way [m] before the first sample (1, n)."""

    t: FloatArray
    states: FloatArray
    tau: FloatArray
    way: FloatArray

    def sensors(self, p: Vehicle, q: Vehicle) -> tuple[FloatArray, ...]:
        """What wheel [m/s], gyro and accelerometer (x, y) show at each sample, (samples, n)."""
        yaw, v_x, v_y, omega = self.states[2:]
        rates = np.gradient(self.states[3:], STEP, axis=1)
        a_x, a_y = rates[0] - omega * v_y, rates[1] + omega * v_x
        force = make_motor(q.motor, ARRAY)(self.tau, v_x) + make_friction(q.friction, ARRAY)(v_x)
        turns = (self.way + np.cumsum(v_x, axis=0) * STEP) / GEAR_REVOLUTION
        now = Now(self.t, v_x, v_y, omega, yaw, a_x, a_y, rates[2], force, turns)
        wheel = through(p, "wheel", np.array(v_x), now, STEP)
        gyro = through(p, "gyro", np.array(omega), now, STEP)
        return (wheel, gyro, *through(p, "accel", (a_x, a_y), now, STEP))


def _measured(drive: Outing, p: Vehicle, q: Vehicle) -> tuple[Grid, FloatArray, FloatArray]:
    """The measured motion without what the effects of p do to the sensors, and the actuators.

    Small changes: an effect is taken off once. The speed sideways is that of a
    car that has been turning like this for a while.
    """
    throttle, angle = actuated(p, drive.grid, smooth=True)
    g = _with_sideways(drive.grid, q)
    rates = [np.gradient(f, STEP) for f in (g.v_x, g.omega)]
    force = make_motor(q.motor, ARRAY)(throttle, g.v_x) + make_friction(q.friction, ARRAY)(g.v_x)
    now = Now(g.t, g.v_x, g.v_y, g.omega, g.yaw, rates[0] - g.omega * g.v_y, g.omega * g.v_x,
              rates[1], force, np.cumsum(g.v_x) * STEP / GEAR_REVOLUTION)
    wheel = through(p, "wheel", g.v_x, now, STEP)
    gyro = through(p, "gyro", g.omega, now, STEP)
    if wheel is g.v_x and gyro is g.omega:
        return g, throttle, angle
    omega = 2.0 * g.omega - gyro
    yaw = np.concatenate([[0.0], np.cumsum(0.5 * (omega[1:] + omega[:-1]) * STEP)])
    freed = replace(g, v_x=2.0 * g.v_x - wheel, omega=omega, yaw=yaw)
    return _with_sideways(freed, q), throttle, angle


def _with_sideways(g: Grid, q: Vehicle) -> Grid:
    """v_y of the centre of mass in a steady turn: the rear axle slips until it holds."""
    body = q.body
    if q.kind == "kinematic":
        return replace(g, v_y=body.l_r * g.omega)
    _, rear = make_tyres(q.tyres, body, ARRAY)
    stiffness = float(rear(np.array(1e-3))) / 1e-3
    pull = body.mass * g.v_x * g.omega * body.l_f / body.wheelbase
    slip = np.clip(pull / stiffness, -STEEPEST, STEEPEST)
    return replace(g, v_y=body.l_r * g.omega - np.tan(slip) * g.v_x)


def _along(series: FloatArray, at: FloatArray) -> FloatArray:
    """The series (n,) at samples of any shape, linear in between, its ends held."""
    return np.interp(at.ravel(), np.arange(len(series)), series).reshape(at.shape)


def _mean(series: FloatArray, at: FloatArray, seconds: float) -> FloatArray:
    """Mean of each lane of a series (samples, n) over the ``seconds`` before at (k, n)."""
    if seconds == 0.0:
        return _lookup(series, at)
    way = np.concatenate([np.zeros((1, series.shape[1])),
                          np.cumsum(0.5 * (series[1:] + series[:-1]), axis=0)])
    long = seconds / STEP
    return (_lookup(way, at) - _lookup(way, at - long)) / long


def _lookup(series: FloatArray, at: FloatArray) -> FloatArray:
    low = np.clip(np.floor(at).astype(np.int64), 0, len(series) - 2)
    share = at - low
    return np.asarray((1.0 - share) * np.take_along_axis(series, low, axis=0)
                      + share * np.take_along_axis(series, low + 1, axis=0))
