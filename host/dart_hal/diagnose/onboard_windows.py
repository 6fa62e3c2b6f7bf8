"""What the sensors of a car would say in each window of an outing, by a model.

The state at a start is what the sensors gave, freed of what the model says that
they do wrong; from there on it is the model's alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dart_hal.identify.commands import angle_behind, throttle_behind
from dart_hal.recording.dart import Grid
from dart_hal.types import FloatArray
from dart_hal.vehicle.batch import rollout
from dart_hal.vehicle.channels import through
from dart_hal.vehicle.effect import Now
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.motor import make_motor
from dart_hal.vehicle.namespace import ARRAY
from dart_hal.vehicle.parameters import GEAR_REVOLUTION, Vehicle
from dart_hal.vehicle.tyres import make_tyres

from .drive import STEP, spread_over
from .onboard_drive import COUNTED, READS, STRAY, Outing
from .space import Timing
from .subsample import FINE, METHOD, fine

BEFORE = 30  # samples ahead of a start: an encoder looks back, a late sensor further
BEYOND = 10  # samples behind a start: a sensor may be early
AFTER = round((READS * COUNTED + STRAY) / STEP) + 1
STEEPEST = 0.2  # rad; slip of the rear axle at a start


def told(drive: Outing, p: Vehicle, q: Vehicle, timing: Timing) -> FloatArray:
    """What encoder, gyro and accelerometer would have said in each window, (4, READS, n).

    The model has driven for BEFORE samples when a window starts, which gives it
    a speed sideways; speed and turning are then set right by what was read last.
    """
    g, throttle, angle = _measured(drive, p, q, timing.spread)
    over = np.arange(-BEFORE, AFTER + 1)[:, None] + drive.begin
    tau = _along(throttle, over - timing.late / STEP)
    delta = fine(angle, over - timing.late / STEP)
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
                    substeps=1, method=METHOD)
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


def _measured(drive: Outing, p: Vehicle, q: Vehicle,
              spread: float) -> tuple[Grid, FloatArray, FloatArray]:
    """The measured motion without what the effects of p do to the sensors, and the actuators.

    Small changes: an effect is taken off once. The speed sideways is that of a
    car that has been turning like this for a while.
    """
    g = drive.grid
    throttle = throttle_behind(p, spread_over(g.throttle, spread), g.t, smooth=True, means=True)
    angle = angle_behind(p, spread_over(g.steering, spread), g.t, smooth=True, means=True)
    g = _with_sideways(g, q)
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
