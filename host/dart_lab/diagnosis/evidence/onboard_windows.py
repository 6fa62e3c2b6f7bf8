"""What the sensors of a car would say in each window of a session, by a model.

The state at a start is what the sensors gave, freed of what the model says that
they do wrong; from there on it is the model's alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Grid
from dart_hal.vehicle.compose import signals
from dart_hal.vehicle.delay import first_order_lag
from dart_hal.vehicle.namespace import ARRAY
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.tyres import make_tyres
from dart_lab.identification.prediction.actuators import delay_command, reached, turned
from dart_lab.identification.prediction.commands import spread_over
from dart_lab.identification.prediction.rollout import states
from dart_lab.identification.prediction.sensors import driven, motion, sensed
from dart_lab.identification.prediction.substeps import FINE, fine, fine_rollout

from .onboard_drive import ENCODER_SPAN, MAX_JITTER, MESSAGES_AHEAD, Session
from .space import Timing

BEFORE = 30  # samples ahead of a start: an encoder looks back, a late sensor further
BEYOND = 10  # samples behind a start: a sensor may be early
AFTER = round((MESSAGES_AHEAD * ENCODER_SPAN + MAX_JITTER) / SAMPLE) + 1
STEEPEST = 0.2  # rad; slip of the rear axle at a start


@dataclass(frozen=True, slots=True)
class Actuated:
    """Of a drive, what an actuator did: series (samples,); windows (samples, n), or finer."""

    series: FloatArray
    windows: FloatArray


def pulled(drive: Session, q: Vehicle, timing: Timing) -> Actuated:
    """The throttle of a settled vehicle."""
    series = reaches(drive, q, "throttle", timing)
    return Actuated(series, _along(series, _samples(drive) - timing.late / SAMPLE))


def steered(drive: Session, q: Vehicle, timing: Timing, servo: FloatArray) -> Actuated:
    """The road-wheel angle of a settled vehicle with its servo at (n,): FINE steps a sample."""
    series = turned(q, servo, drive.grid.t, "mean")
    return Actuated(series, fine(series, _samples(drive) - timing.late / SAMPLE))


def reaches(drive: Session, q: Vehicle, channel: str, timing: Timing) -> FloatArray:
    """Where servo or throttle of a settled vehicle are, means over samples (n,)."""
    delay, lag = (getattr(q.delay, f"{channel}{part}") for part in ("_s", "_lag_s"))
    command = spread_over(getattr(drive.grid, channel), timing.spread)
    lagged = first_order_lag(delay_command(command, delay, smooth=True), lag, "mean")
    return reached(q, channel, lagged, drive.grid.t, "mean")


def _samples(drive: Session) -> FloatArray:
    """(samples, n) of each window, from BEFORE its start on."""
    return np.asarray(np.arange(-BEFORE, AFTER + 1)[:, None] + drive.begin)


def predicted(drive: Session, p: Vehicle, q: Vehicle, throttle: Actuated, angle: Actuated
              ) -> FloatArray:
    """What encoder, gyro and accelerometer would have said in each window, (4, MESSAGES_AHEAD, n).

    The model has driven for BEFORE samples when a window starts, which gives it
    a speed sideways; speed and turning are then set right by what was read last.
    """
    g, over = _measured(drive, p, q, throttle.series), _samples(drive)
    tau, delta = throttle.windows, angle.windows
    t, way = _along(g.t, over), _along(np.cumsum(g.v_x) * SAMPLE, over[:1])
    none = np.zeros(len(drive.begin))
    first = np.stack([none, none, *(_along(f, over[0]) for f in (g.yaw, g.v_x, g.v_y, g.omega))])
    long = BEFORE + BEYOND
    lead = _driven(p, first, tau[:long], delta[:FINE * long])
    wheel, gyro, _, _ = _sensors(p, t[:long + 1], lead, tau[:long + 1], way)
    wrong = drive.last - np.stack([np.abs(_mean(wheel, BEFORE + drive.past, ENCODER_SPAN)),
                                   _mean(gyro, BEFORE + drive.past, drive.means)])
    lead = lead[:, :BEFORE + 1]
    lead[3] += wrong[0].mean(axis=0)
    lead[5] += wrong[1, -1]
    rest = _driven(p, lead[:, -1], tau[BEFORE:-1], delta[FINE * BEFORE:-FINE])
    wheel, gyro, a_x, a_y = _sensors(p, t, np.concatenate([lead, rest[:, 1:]], axis=1), tau, way)
    at = BEFORE + drive.spots
    return np.stack([np.abs(_mean(wheel, at, ENCODER_SPAN)), *(_mean(f, at, drive.means)
                                                         for f in (gyro, a_x, a_y))])


def _driven(p: Vehicle, start: FloatArray, tau: FloatArray, delta: FloatArray) -> FloatArray:
    """States (6, samples + 1, n) from a start (6, n) on; delta in FINE steps per sample."""
    after = fine_rollout(p, start, np.repeat(tau, FINE, axis=0), delta, range(1, len(tau) + 1))
    return np.asarray(np.concatenate([start[None], after]).swapaxes(0, 1))


def _sensors(p: Vehicle, t: FloatArray, states: FloatArray, tau: FloatArray,
             way: FloatArray) -> tuple[FloatArray, ...]:
    """As ``sensed`` (samples, n) of states (6, samples, n); way [m] before the first sample."""
    rates = np.gradient(states[3:], SAMPLE, axis=1)
    return sensed(p, driven(p, motion(t, states, rates, way), tau))


def _measured(drive: Session, p: Vehicle, q: Vehicle, throttle: FloatArray) -> Grid:
    """The measured motion without what the effects of p do to the sensors.

    Small changes: an effect is taken off once. The speed sideways is that of a
    car that has been turning like this for a while.
    """
    g = _with_sideways(drive.grid, q)
    if not (signals(p, "wheel") or signals(p, "gyro")):
        return g
    rates = [np.gradient(g.v_x, SAMPLE), 0.0, np.gradient(g.omega, SAMPLE)]
    wheel, gyro, _, _ = sensed(p, driven(p, motion(g.t, states(g), rates), throttle))
    omega = 2.0 * g.omega - gyro
    yaw = np.concatenate([[0.0], np.cumsum(0.5 * (omega[1:] + omega[:-1]) * SAMPLE)])
    freed = replace(g, v_x=2.0 * g.v_x - wheel, omega=omega, yaw=yaw)
    return _with_sideways(freed, q)


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
    long = seconds / SAMPLE
    return (_lookup(way, at) - _lookup(way, at - long)) / long


def _lookup(series: FloatArray, at: FloatArray) -> FloatArray:
    low = np.clip(np.floor(at).astype(np.int64), 0, len(series) - 2)
    share = at - low
    return np.asarray((1.0 - share) * np.take_along_axis(series, low, axis=0)
                      + share * np.take_along_axis(series, low + 1, axis=0))
