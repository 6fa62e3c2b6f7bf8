"""Predict what the sensors of a car read in each window of a stretch without motion capture.

The state at the start of a window is measured by the sensors and corrected for the sensor errors
of the model. From there on the model predicts alone.
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
from dart_lab.identification.prediction.actuators import (
    apply_command_effects,
    delay_command,
    road_wheel_angle,
)
from dart_lab.identification.prediction.commands import spread_over
from dart_lab.identification.prediction.rollout import states
from dart_lab.identification.prediction.sensors import add_drive_force, motion, read_sensors
from dart_lab.identification.prediction.substeps import SUBSTEPS, average_substeps, rollout_substeps

from .onboard_drive import ENCODER_MEAN_S, MAX_JITTER_S, MESSAGES_AHEAD, OnboardStretch
from .space import MessageTiming

LEAD_SAMPLES = 30  # samples before a start: an encoder averages, a sensor may be late
LAST_LEAD_SAMPLES = 10  # samples after a start: a sensor may be early
WINDOW_SAMPLES = round((MESSAGES_AHEAD * ENCODER_MEAN_S + MAX_JITTER_S) / SAMPLE) + 1
MAX_SLIP_ANGLE = 0.2  # rad; of the rear axle at a start
SMALL_SLIP = 1e-3  # rad; slip at which the cornering stiffness is taken


@dataclass(frozen=True, slots=True)
class ActuatorOutput:
    """Output of an actuator: series (samples,); windows (samples, n), or finer."""

    series: FloatArray
    windows: FloatArray


def throttle_output(drive: OnboardStretch, q: Vehicle, timing: MessageTiming) -> ActuatorOutput:
    """Return the throttle output of a vehicle with its effects."""
    series = actuator_means(drive, q, "throttle", timing)
    return ActuatorOutput(
        series, _interpolate(series, _samples(drive) - timing.message_age / SAMPLE))


def steering_output(drive: OnboardStretch, q: Vehicle, timing: MessageTiming, servo: FloatArray
                    ) -> ActuatorOutput:
    """Return the road-wheel angle with all effects, in FINE steps per sample; servo (n,)."""
    series = road_wheel_angle(q, servo, drive.grid, "mean")
    return ActuatorOutput(series,
                          average_substeps(series, _samples(drive) - timing.message_age / SAMPLE))


def actuator_means(drive: OnboardStretch, q: Vehicle, channel: str, timing: MessageTiming
                   ) -> FloatArray:
    """Return servo or throttle of a vehicle with its effects, means over samples (n,)."""
    delay, lag = (getattr(q.delay, f"{channel}{part}") for part in ("_s", "_lag_s"))
    command = spread_over(getattr(drive.grid, channel), timing.age_spread)
    lagged = first_order_lag(delay_command(command, delay, smooth=True), lag, "mean")
    return apply_command_effects(q, channel, lagged, drive.grid, "mean")


def _samples(drive: OnboardStretch) -> FloatArray:
    """Return the samples (samples, n) of each window, from LEAD_SAMPLES before its start on."""
    return np.asarray(np.arange(-LEAD_SAMPLES, WINDOW_SAMPLES + 1)[:, None] + drive.window_starts)


@dataclass(frozen=True, slots=True)
class WindowMotion:
    """Predicted states (6, samples, n) of windows, and distance [m] driven before them (1, n)."""

    states: FloatArray
    distance: FloatArray


def window_times(drive: OnboardStretch) -> FloatArray:
    """Return the times (samples, n) [s] of the samples of each window."""
    return _interpolate(drive.grid.t, _samples(drive))


def predict_motion(drive: OnboardStretch, p: Vehicle, q: Vehicle, t: FloatArray,
                   throttle: ActuatorOutput, angle: ActuatorOutput) -> WindowMotion:
    """Predict the motion in each window, on which effects on the accelerometer have no influence.

    t: of ``window_times``.

    1. Roll the model out over LEAD_SAMPLES before the start, which gives it a lateral speed.
    2. Correct its speed and yaw rate at the start by the readings of the messages up to there.
    3. Roll it out over the window.
    """
    g = _correct_motion(drive, p, q, throttle.series)
    samples = _samples(drive)
    tau = throttle.windows
    delta = angle.windows
    distance = _interpolate(np.cumsum(g.v_x) * SAMPLE, samples[:1])
    none = np.zeros(len(drive.window_starts))
    # 1. The lead starts at the measured yaw, speed, lateral speed and yaw rate.
    first = np.stack([none, none,
                      *(_interpolate(f, samples[0]) for f in (g.yaw, g.v_x, g.v_y, g.omega))])
    n_lead = LEAD_SAMPLES + LAST_LEAD_SAMPLES
    lead = _roll_out(p, first, tau[:n_lead], delta[:SUBSTEPS * n_lead])
    wheel, gyro = _sense_motion(p, t[:n_lead + 1], lead, tau[:n_lead + 1], distance)
    # 2. Prediction and readings before the start: the speed is corrected by their mean difference,
    #    the yaw rate by that of the last message.
    past = LEAD_SAMPLES + drive.past_offsets
    error = drive.past_readings - np.stack([np.abs(_trailing_mean(wheel, past, ENCODER_MEAN_S)),
                                            _trailing_mean(gyro, past, drive.mean_s)])
    lead = lead[:, :LEAD_SAMPLES + 1]
    lead[3] += error[0].mean(axis=0)
    lead[5] += error[1, -1]
    # 3. The window itself.
    rest = _roll_out(p, lead[:, -1], tau[LEAD_SAMPLES:-1], delta[SUBSTEPS * LEAD_SAMPLES:-SUBSTEPS])
    return WindowMotion(np.concatenate([lead, rest[:, 1:]], axis=1), distance)


def predict_sensors(drive: OnboardStretch, p: Vehicle, t: FloatArray, motion: WindowMotion,
                    throttle: ActuatorOutput) -> FloatArray:
    """Predict encoder, gyro, a_x and a_y in each window, (4, MESSAGES_AHEAD, n).

    t: of ``window_times``; motion: of ``predict_motion``.
    """
    wheel, gyro, a_x, a_y = _sense(p, t, motion.states, throttle.windows, motion.distance)
    ends = LEAD_SAMPLES + drive.message_offsets
    return np.stack([np.abs(_trailing_mean(wheel, ends, ENCODER_MEAN_S)),
                     *(_trailing_mean(f, ends, drive.mean_s) for f in (gyro, a_x, a_y))])


def _roll_out(p: Vehicle, start: FloatArray, tau: FloatArray, delta: FloatArray) -> FloatArray:
    """Return states (6, samples + 1, n) from a start (6, n); delta in FINE steps per sample."""
    after = rollout_substeps(p, start, np.repeat(tau, SUBSTEPS, axis=0), delta,
                             range(1, len(tau) + 1))
    return np.asarray(np.concatenate([start[None], after]).swapaxes(0, 1))


def _sense_motion(p: Vehicle, t: FloatArray, states: FloatArray, tau: FloatArray,
                  distance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return encoder and gyro of states as ``_sense``, which are speed and yaw rate if unchanged.
    """
    if not (signals(p, "wheel") or signals(p, "gyro")):
        return states[3], states[5]
    wheel, gyro, _, _ = _sense(p, t, states, tau, distance)
    return wheel, gyro


def _sense(p: Vehicle, t: FloatArray, states: FloatArray, tau: FloatArray,
           distance: FloatArray) -> tuple[FloatArray, ...]:
    """Return sensor signals (samples, n) of states; distance [m] before the first sample."""
    rates = np.gradient(states[3:], SAMPLE, axis=1)
    now = motion(t, states, rates, distance)
    # The force at the wheels is only read by effects.
    affected = any(signals(p, channel) for channel in ("wheel", "gyro", "accel"))
    return read_sensors(p, add_drive_force(p, now, tau) if affected else now)


def _correct_motion(drive: OnboardStretch, p: Vehicle, q: Vehicle, throttle: FloatArray) -> Grid:
    """Return the measured motion without the sensor effects of p, with a lateral speed.

    The effects are small, so their change of the readings is subtracted once.
    """
    g = _add_steady_v_y(drive.grid, q)
    if not (signals(p, "wheel") or signals(p, "gyro")):
        return g
    rates = [np.gradient(g.v_x, SAMPLE), 0.0, np.gradient(g.omega, SAMPLE)]
    wheel, gyro, _, _ = read_sensors(p, add_drive_force(p, motion(g.t, states(g), rates), throttle))
    # An effect changes a reading by f(x) - x, at x = reading to first order: reading - (f(reading)
    # - reading) is the value without it.
    omega = 2.0 * g.omega - gyro
    yaw = np.concatenate([[0.0], np.cumsum(0.5 * (omega[1:] + omega[:-1]) * SAMPLE)])
    freed = replace(g, v_x=2.0 * g.v_x - wheel, omega=omega, yaw=yaw)
    return _add_steady_v_y(freed, q)


def _add_steady_v_y(g: Grid, q: Vehicle) -> Grid:
    """Add the lateral speed of the centre of mass in a steady turn.

        v_y = l_r omega - v_x tan(alpha_r),  alpha_r = m v_x omega l_f / (l C_r)

    C_r: cornering stiffness of the rear axle. A kinematic car has no slip.
    """
    body = q.body
    if q.kind == "kinematic":
        return replace(g, v_y=body.l_r * g.omega)
    _, rear = make_tyres(q.tyres, body, ARRAY)
    stiffness = float(rear(np.array(SMALL_SLIP))) / SMALL_SLIP
    # Balance of moments in a steady turn: the rear axle carries l_f / l of the lateral force m v
    # omega.
    force = body.mass * g.v_x * g.omega * body.l_f / body.wheelbase
    slip = np.clip(force / stiffness, -MAX_SLIP_ANGLE, MAX_SLIP_ANGLE)
    return replace(g, v_y=body.l_r * g.omega - np.tan(slip) * g.v_x)


def _interpolate(series: FloatArray, samples: FloatArray) -> FloatArray:
    """Interpolate a series (n,) linearly at samples of any shape; its ends are held."""
    return np.interp(samples.ravel(), np.arange(len(series)), series).reshape(samples.shape)


def _trailing_mean(series: FloatArray, ends: FloatArray, seconds: float) -> FloatArray:
    """Return means of each window of a series (samples, n) over ``seconds`` before ends (k, n)."""
    if seconds == 0.0:
        return _lookup(series, ends)
    integral = np.concatenate([np.zeros((1, series.shape[1])),
                               np.cumsum(0.5 * (series[1:] + series[:-1]), axis=0)])
    length = seconds / SAMPLE
    return (_lookup(integral, ends) - _lookup(integral, ends - length)) / length


def _lookup(series: FloatArray, samples: FloatArray) -> FloatArray:
    """Interpolate each window of a series (samples, n) linearly at samples (k, n)."""
    low = np.clip(np.floor(samples).astype(np.int64), 0, len(series) - 2)
    share = samples - low
    return np.asarray((1.0 - share) * np.take_along_axis(series, low, axis=0)
                      + share * np.take_along_axis(series, low + 1, axis=0))
