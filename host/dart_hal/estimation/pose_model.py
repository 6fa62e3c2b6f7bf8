"""Extended Kalman filter of the pose, one step: motion, standstill, measured pose.

The state of the rear axle and the errors of the sensors, (13,):

    x, y [m], yaw [rad, unwrapped], speed [m/s], yaw rate [rad/s],
    gyro bias [rad/s], gyro scale, travel scale [relative],
    slip gain [rad of rear slip angle per m/s2 of lateral acceleration],
    marker lx, ly [m] from the rear axle, theta [rad], latency [s] of the source

with  speed = (1 + travel scale) wheel speed,  yaw rate = (1 + gyro scale) (gyro - bias).
Wheels and gyro are inputs of the motion, not measurements of a state that is integrated: travel
from edge counts does not drift. The errors have no dynamics; they are estimated from poses, the
bias also at rest.

A measured pose is that of the marker, ``latency`` before its time stamp:

    x + lx cos(yaw) - ly sin(yaw),  y + lx sin(yaw) + ly cos(yaw),  yaw - theta

Bends make the position of the marker observable, changes of speed the latency.

Source: Thrun, Burgard, Fox, Probabilistic Robotics (2005), chapters 3.3 and 5.4; the update is
Joseph's form.
"""

from __future__ import annotations

from math import cos, sin, tau
from typing import NamedTuple

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.estimation.gyro import (
    BIAS_WALK,
    CORRELATION_FACTOR,
    GYRO_GATE,
    GYRO_QUANTUM,
    SETTLING_TIME,
)
from dart_hal.estimation.odometry import (
    GYRO_LATENCY,
    NO_GYRO_RATE_SHARE,
    NO_GYRO_RATE_STD,
    MotionStep,
    OdometryNoise,
)

(X, Y, YAW, SPEED, RATE, BIAS, GYRO, TRAVEL, SLIP,
 LX, LY, THETA, LATENCY) = range(STATES := 13)

# m, rad: standard deviation of a start that defines the origin.
START_STD = 1e-3
# m/s of the wheel speed over a frame: the counts of 20 uneven edges a turn.
SPEED_STD = 0.02
# rad/s of one sample of the gyro: 4e-4 rad/s per sqrt(Hz) at 100 Hz.
GYRO_SAMPLE_STD = 4e-3
# s per sqrt(s), times the yaw rate: effect of the age of a gyro sample on the yaw. ``odometry`` has
# ``OdometryNoise.gyro_age`` times the *change* of the yaw rate instead, and less where ``ImuClock``
# knows the age; this filter does not use that. Between poses the age jumps by up to 10 ms of
# turning and is treated as random. The normalised error squared of four test cars is then 2.7; with
# the change of the yaw rate it is 1.9.
SAMPLE_AGE_NOISE = 2.5e-3
# m, rad: no external pose is better. A smaller covariance would leave none for the model.
MIN_POSE_STD = 1e-4
# Share of each variance that a step adds, 1000 times the rounding of a (13, 13) product: the
# correlation matrix stays positive definite, and a day of 100 Hz adds 1e-5.
COVARIANCE_JITTER = 1e-12
EYE: FloatArray = np.eye(STATES)
SYMMETRISE: FloatArray = 0.5 * (1.0 + COVARIANCE_JITTER * EYE)
# Square of the Mahalanobis distance that one correct pose in 1000 exceeds: chi-square, 3 degrees
# of freedom.
CHI2_3 = 16.27


class MarkerModel(NamedTuple):
    """Marker of a pose source on the car, and its latency.

    lx, ly [m]; theta [rad], added to the yaw of the marker frame; latency [s];
    std: one sigma of each.
    """

    lx: float = 0.0
    ly: float = 0.0
    theta: float = 0.0
    latency: float = 0.0
    std: tuple[float, float, float, float] = (MIN_POSE_STD, MIN_POSE_STD, MIN_POSE_STD, 1e-5)


class FilterState(NamedTuple):
    """mean (13,), cov (13, 13); ``rest_time`` [s]: duration of the current standstill."""

    mean: FloatArray
    cov: FloatArray
    rest_time: float = 0.0


def initial_state(noise: OdometryNoise, gyro_bias: float, gyro_bias_std: float, slip_gain: float,
                  marker: MarkerModel) -> FilterState:
    """Return the state at the origin and at rest."""
    mean = np.zeros(STATES)
    mean[BIAS] = gyro_bias
    mean[SLIP] = slip_gain
    mean[LX:] = marker[:4]
    std = np.full(STATES, START_STD)
    std[BIAS:LX] = gyro_bias_std, noise.gyro_scale, noise.travel_scale, noise.slip_gain
    std[LX:] = marker.std
    return FilterState(mean, np.diag(std**2))


def predict_motion(state: FilterState, motion: MotionStep, noise: OdometryNoise) -> FilterState:
    """Advance the state by ``motion.dt`` s along an exact arc; without motion at a standstill.

    1. Mean: corrected speed and yaw rate, exact arc, slip.
    2. Jacobian F of the step by the state.
    3. Covariance P <- F P F^T + Q, with Q by wheels and gyro.
    """
    if motion.at_rest:
        return _predict_rest(state, motion, noise)
    dt, wheels, rate, variance, gyro, _, speed_error, place, yaw_acceleration = motion
    mean = state.mean.copy()
    (bias, scale, travel, slip) = state.mean[BIAS:LX].tolist()
    gain = 1.0 + scale if gyro else 1.0
    omega = gain * (rate - bias) if gyro else rate
    speed = (1.0 + travel) * wheels
    half = 0.5 * omega * dt
    length = speed * dt
    middle = float(mean[YAW]) + half
    c = cos(middle)
    s = sin(middle)
    chord = wheels * dt * (sin(half) / half if abs(half) > 1e-6 else 1.0)
    outwards = abs(length) * speed * omega  # per rad/(m/s2) of slip gain, to the right
    ahead = (1.0 + travel) * chord
    sideways = slip * outwards
    dx = ahead * c + sideways * s
    dy = ahead * s - sideways * c
    mean[:BIAS] += (dx, dy, omega * dt, speed - mean[SPEED], omega - mean[RATE])

    # Jacobian of the step. One number at a time: five times quicker than by lists of indices.
    jacobian = EYE.copy()
    jacobian[SPEED, SPEED] = jacobian[RATE, RATE] = 0.0
    jacobian[X, YAW] = -dy
    jacobian[Y, YAW] = dx
    jacobian[X, TRAVEL] = chord * c
    jacobian[Y, TRAVEL] = chord * s
    jacobian[SPEED, TRAVEL] = wheels
    jacobian[X, SLIP] = outwards * s
    jacobian[Y, SLIP] = -outwards * c
    if gyro:
        for row, effect in ((X, -0.5 * dy * dt), (Y, 0.5 * dx * dt), (YAW, dt), (RATE, 1.0)):
            jacobian[row, BIAS] = -gain * effect
            jacobian[row, GYRO] = (rate - bias) * effect

    # Process noise Q: travel along the heading, slip across it, yaw by the gyro (q_yaw, rad2).
    sampled = (noise.gyro_noise**2 + (SAMPLE_AGE_NOISE * omega)**2) * dt if gyro else 0.0
    along = abs(length) * noise.travel**2
    across = abs(length) * noise.slip**2
    q_yaw = sampled + variance
    xy = (along - across) * c * s - 0.25 * dx * dy * q_yaw
    cov = jacobian @ state.cov @ jacobian.T
    cov[:SPEED, :SPEED] += (
        (along * c * c + across * s * s + 0.25 * dy * dy * q_yaw + place, xy, -0.5 * dy * q_yaw),
        (xy, along * s * s + across * c * c + 0.25 * dx * dx * q_yaw + place, 0.5 * dx * q_yaw),
        (-0.5 * dy * q_yaw, 0.5 * dx * q_yaw, q_yaw))
    cov[SPEED, SPEED] += SPEED_STD**2 + speed_error**2
    rate_std = GYRO_SAMPLE_STD if gyro else NO_GYRO_RATE_STD + NO_GYRO_RATE_SHARE * abs(rate)
    # The samples of the gyro are late, and the yaw rate is the mean of a frame.
    late = (GYRO_LATENCY + 0.5 * dt) * yaw_acceleration
    cov[RATE, RATE] += rate_std**2 + late**2
    return FilterState(mean, _regularise(cov))


def _predict_rest(state: FilterState, motion: MotionStep, noise: OdometryNoise) -> FilterState:
    """Keep the pose; the gyro measures its bias once the springs of the body are at rest."""
    mean = state.mean.copy()
    cov = state.cov.copy()
    mean[SPEED] = mean[RATE] = 0.0
    for index in (SPEED, RATE):
        cov[index] = 0.0
        cov[:, index] = 0.0
        cov[index, index] = START_STD**2
    rest_time = state.rest_time + motion.dt
    state = FilterState(mean, _regularise(cov))
    if not motion.gyro:
        return state._replace(rest_time=rest_time)
    sample = noise.gyro_noise**2 / motion.dt + GYRO_QUANTUM**2 / 12.0
    innovation = motion.yaw_rate - mean[BIAS]
    # The car is being carried: the reading is not the bias.
    if innovation**2 > GYRO_GATE**2 * (cov[BIAS, BIAS] + sample) + GYRO_QUANTUM**2:
        return state
    if rest_time < SETTLING_TIME:
        return state._replace(rest_time=rest_time)
    state.cov[BIAS, BIAS] += BIAS_WALK**2 * motion.dt
    row = np.zeros((1, STATES))
    row[0, BIAS] = 1.0
    mean, cov = _kalman_update(state, row, np.array((innovation,)),
                               np.array(((CORRELATION_FACTOR * sample,),)))
    return FilterState(mean, cov, rest_time)


def place_at_pose(state: FilterState, pose: FloatArray, cov: FloatArray) -> FilterState:
    """Replace the pose by a measured one (3,) of the marker with covariance (3, 3).

    The position of the axle is as uncertain as that of the marker on the car, and correlated with
    it.
    """
    mean = state.mean.copy()
    full_cov = state.cov.copy()
    latency = mean[LATENCY]
    yaw = pose[YAW] + mean[THETA]
    velocity = _marker_velocity(mean, yaw)
    mean[:SPEED] = pose + latency * velocity
    full_cov[:SPEED] = 0.0
    full_cov[:, :SPEED] = 0.0
    full_cov[:SPEED, :SPEED] = cov
    latency_effect = np.zeros((SPEED, STATES))  # the way since it was measured
    latency_effect[:, LATENCY] = velocity
    full_cov[:SPEED] += latency_effect @ full_cov
    full_cov[:, :SPEED] += full_cov @ latency_effect.T
    return _to_axle(FilterState(mean, full_cov, state.rest_time))


def squared_distance(state: FilterState, pose: FloatArray, cov: FloatArray) -> float:
    """Squared Mahalanobis distance of a pose (3,), covariance (3, 3), from the expected one."""
    marker = to_marker(state)
    expected, row = _expected_pose(marker)
    innovation = _innovation(expected, pose)
    return float(innovation @ np.linalg.solve(row @ marker.cov @ row.T + cov, innovation))


def update_with_pose(state: FilterState, pose: FloatArray, cov: FloatArray) -> FilterState:
    """Update with a measured pose (3,) of covariance (3, 3).

    The update is done in marker coordinates, in which a pose contains no information on the
    position of the marker: only motion makes it observable. In axle coordinates each
    linearisation would add spurious information at rest.
    """
    marker = to_marker(state)
    expected, row = _expected_pose(marker)
    mean, full_cov = _kalman_update(marker, row, _innovation(expected, pose), cov)
    return _to_axle(FilterState(mean, full_cov, state.rest_time))


def to_marker(state: FilterState) -> FilterState:
    """Convert the state to one with the pose of the marker in place of that of the axle."""
    mean = state.mean.copy()
    jacobian = _marker_jacobian(state.mean, state.mean[YAW])
    mean[:SPEED] += _lever_arm(mean, mean[YAW])
    return FilterState(mean, jacobian @ state.cov @ jacobian.T, state.rest_time)


def _to_axle(marker: FilterState) -> FilterState:
    """Convert a state with the pose of the marker back to that of the axle."""
    mean = marker.mean.copy()
    mean[:SPEED] -= _lever_arm(mean, mean[YAW] + mean[THETA])
    c = cos(mean[YAW])
    s = sin(mean[YAW])
    dx, dy, _ = _lever_arm(mean, mean[YAW])
    back = EYE.copy()  # the inverse of ``_marker_jacobian``
    back[X, YAW] = back[X, THETA] = dy
    back[Y, YAW] = back[Y, THETA] = -dx
    back[X, LX] = -c
    back[X, LY] = s
    back[Y, LX] = -s
    back[Y, LY] = -c
    back[YAW, THETA] = 1.0
    return FilterState(mean, _regularise(back @ marker.cov @ back.T), marker.rest_time)


def _lever_arm(mean: FloatArray, yaw: float) -> FloatArray:
    """Marker minus axle, x, y [m], yaw [rad], of a car with this yaw."""
    (lx, ly, theta) = mean[LX:LATENCY]
    c = cos(yaw)
    s = sin(yaw)
    return np.array((lx * c - ly * s, lx * s + ly * c, -theta))


def _marker_jacobian(mean: FloatArray, yaw: float) -> FloatArray:
    """Derivative (13, 13) of the marker coordinates by those of the axle."""
    c = cos(yaw)
    s = sin(yaw)
    dx, dy, _ = _lever_arm(mean, yaw)
    jacobian: FloatArray = EYE.copy()
    jacobian[X, YAW] = -dy
    jacobian[Y, YAW] = dx
    jacobian[YAW, THETA] = -1.0
    jacobian[X, LX] = c
    jacobian[X, LY] = -s
    jacobian[Y, LX] = s
    jacobian[Y, LY] = c
    return jacobian


def _expected_pose(marker: FilterState) -> tuple[FloatArray, FloatArray]:
    """Pose (3,) that the source measured ``latency`` ago, and its derivative (3, 13)."""
    mean = marker.mean
    yaw = mean[YAW] + mean[THETA]
    latency = mean[LATENCY]
    velocity = _marker_velocity(mean, yaw)
    row = EYE[:SPEED].copy()
    row[:, LATENCY] = -velocity
    row[:YAW, SPEED] = -latency * cos(yaw), -latency * sin(yaw)
    row[YAW, RATE] = -latency
    return mean[:SPEED] - latency * velocity, row


def _marker_velocity(mean: FloatArray, yaw: float) -> FloatArray:
    """Velocity of the marker, x, y [m/s], yaw [rad/s], on a car with this yaw."""
    speed = mean[SPEED]
    rate = mean[RATE]
    (dx, dy, _) = _lever_arm(mean, yaw)
    return np.array((speed * cos(yaw) - rate * dy, speed * sin(yaw) + rate * dx, rate))


def _innovation(expected: FloatArray, pose: FloatArray) -> FloatArray:
    """Difference of two poses (3,), the yaw within half a turn."""
    innovation = pose - expected
    innovation[YAW] -= tau * np.round(innovation[YAW] / tau)
    return innovation


def _kalman_update(state: FilterState, row: FloatArray, innovation: FloatArray, noise: FloatArray
                   ) -> tuple[FloatArray, FloatArray]:
    """Joseph's form P <- (I - K H) P (I - K H)^T + K R K^T: positive for any rounding of K."""
    cross = state.cov @ row.T
    gain = np.linalg.solve(row @ cross + noise, cross.T).T
    keep = EYE - gain @ row
    return (state.mean + gain @ innovation,
            _regularise(keep @ state.cov @ keep.T + gain @ noise @ gain.T))


def _regularise(cov: FloatArray) -> FloatArray:
    """Make the covariance symmetric and add ``COVARIANCE_JITTER`` to its variances."""
    regular: FloatArray = (cov + cov.T) * SYMMETRISE
    return regular
