"""One step of the extended Kalman filter of the pose: motion, rest, a measured pose.

The state of the rear axle and what is wrong with the sensors, (9,):

    x, y [m], yaw [rad, unwrapped], speed [m/s], yaw rate [rad/s],
    gyro bias [rad/s], gyro scale, travel scale [relative],
    slip gain [rad of rear slip angle per m/s2 of lateral acceleration]

with  speed = (1 + travel scale) wheel speed,  yaw rate = (1 + gyro scale) (gyro - bias).
Wheels and gyro are inputs of the motion, not measurements of a state that is integrated: travel
from edge counts does not drift. The four errors have no dynamics; they are learnt from poses, the
bias also at rest.

Source: Thrun, Burgard, Fox, Probabilistic Robotics (2005), chapters 3.3 and 5.4; the update is
Joseph's form.
"""

from __future__ import annotations

from math import cos, sin, tau
from typing import NamedTuple

import numpy as np

from dart_hal.estimation.gyro import CORRELATED, GATE, QUANTUM, SETTLE, WALK
from dart_hal.estimation.odometry import BLIND, BLIND_SHARE, Motion, OdometryNoise
from dart_hal.types import FloatArray

X, Y, YAW, SPEED, RATE, BIAS, GYRO, TRAVEL, SLIP = range(STATES := 9)

START_STD = 1e-3
"""m, rad: how well a start is known that is called the origin."""
SPEED_STD = 0.02
"""m/s of the wheels' speed over a frame: the counts of 20 uneven edges a turn."""
RATE_STD = 4e-3
"""rad/s of one sample of the gyro: 4e-4 rad/s per sqrt(Hz) at 100 Hz."""
FINEST = 1e-4
"""m, rad: no external pose is better; a stated covariance below leaves no room for the model."""
JITTER = 1e-12
"""Share of each variance that a step adds, 1000 times the rounding of a (9, 9) product: the
correlation matrix stays positive definite, and a day of 100 Hz adds 1e-5."""
CHI2_3 = 16.27
"""Square of the Mahalanobis distance that one right pose in 1000 exceeds: chi-square, 3 degrees."""


class Belief(NamedTuple):
    """mean (9,), cov (9, 9); ``stood`` [s]: for how long the car has stood still."""

    mean: FloatArray
    cov: FloatArray
    stood: float = 0.0


def started(noise: OdometryNoise, gyro_bias: float, gyro_bias_std: float) -> Belief:
    """At the origin, standing."""
    mean = np.zeros(STATES)
    mean[BIAS] = gyro_bias
    std = np.full(STATES, START_STD)
    std[BIAS:] = gyro_bias_std, noise.gyro_scale, noise.travel_scale, noise.slip_gain
    return Belief(mean, np.diag(std**2))


def moved(belief: Belief, motion: Motion, noise: OdometryNoise) -> Belief:
    """``motion.dt`` s later, along an exact arc; at rest where the wheels stand."""
    if motion.standing:
        return _rested(belief, motion, noise)
    dt, wheels, rate, variance, gyro, _ = motion
    mean, (bias, scale, travel, slip) = belief.mean.copy(), belief.mean[BIAS:]
    grows = 1.0 + scale if gyro else 1.0
    omega = grows * (rate - bias) if gyro else rate
    speed = (1.0 + travel) * wheels
    half, length = 0.5 * omega * dt, speed * dt
    c, s = cos(mean[YAW] + half), sin(mean[YAW] + half)
    chord = wheels * dt * (sin(half) / half if abs(half) > 1e-6 else 1.0)
    outwards = length * speed * omega  # per rad/(m/s2) of slip gain, to the right
    ahead, aside = (1.0 + travel) * chord, slip * outwards
    dx, dy = ahead * c + aside * s, ahead * s - aside * c
    mean[:BIAS] += (dx, dy, omega * dt, speed - mean[SPEED], omega - mean[RATE])

    step = np.eye(STATES)
    step[SPEED, SPEED] = step[RATE, RATE] = 0.0
    step[X, YAW], step[Y, YAW] = -dy, dx
    step[(X, Y, SPEED), TRAVEL] = chord * c, chord * s, wheels
    step[X, SLIP], step[Y, SLIP] = outwards * s, -outwards * c
    by_rate = np.array((-0.5 * dy * dt, 0.5 * dx * dt, dt, 1.0))  # of x, y, yaw, rate
    if gyro:
        step[(X, Y, YAW, RATE), BIAS] = -grows * by_rate
        step[(X, Y, YAW, RATE), GYRO] = (rate - bias) * by_rate

    sampled = (noise.gyro_noise**2 + (noise.gyro_age * omega)**2) * dt if gyro else 0.0
    sources = np.zeros((STATES, 3))  # along, across, turn
    sources[:YAW, 0], sources[:YAW, 1] = (c, s), (-s, c)
    sources[:SPEED, 2] = -0.5 * dy, 0.5 * dx, 1.0
    variances = (abs(length) * noise.travel**2, abs(length) * noise.slip**2, sampled + variance)
    cov = step @ belief.cov @ step.T + (sources * variances) @ sources.T
    cov[SPEED, SPEED] += SPEED_STD**2
    cov[RATE, RATE] += RATE_STD**2 if gyro else (BLIND + BLIND_SHARE * abs(rate))**2
    return Belief(mean, _sound(cov))


def _rested(belief: Belief, motion: Motion, noise: OdometryNoise) -> Belief:
    """The pose stays; the gyro shows its bias once the body has come to rest on its springs."""
    mean, cov = belief.mean.copy(), belief.cov.copy()
    mean[SPEED] = mean[RATE] = 0.0
    for state in (SPEED, RATE):
        cov[state], cov[:, state], cov[state, state] = 0.0, 0.0, START_STD**2
    belief, stood = Belief(mean, _sound(cov)), belief.stood + motion.dt
    if not motion.gyro:
        return belief._replace(stood=stood)
    sample = noise.gyro_noise**2 / motion.dt + QUANTUM**2 / 12.0
    innovation = motion.yaw_rate - mean[BIAS]
    if innovation**2 > GATE**2 * (cov[BIAS, BIAS] + sample) + QUANTUM**2:  # somebody carries it
        return belief
    if stood < SETTLE:
        return belief._replace(stood=stood)
    belief.cov[BIAS, BIAS] += WALK**2 * motion.dt
    row = np.zeros((1, STATES))
    row[0, BIAS] = 1.0
    mean, cov = _updated(belief, row, np.array((innovation,)), np.array(((CORRELATED * sample,),)))
    return Belief(mean, cov, stood)


def placed(belief: Belief, pose: FloatArray, cov: FloatArray) -> Belief:
    """At a pose (3,) of covariance (3, 3) that owes nothing to what was believed."""
    mean, whole = belief.mean.copy(), belief.cov.copy()
    mean[:SPEED] = pose
    whole[:SPEED], whole[:, :SPEED] = 0.0, 0.0
    whole[:SPEED, :SPEED] = cov
    return Belief(mean, whole, belief.stood)


def distance2(belief: Belief, pose: FloatArray, cov: FloatArray) -> float:
    """Squared Mahalanobis distance of a pose (3,) of covariance (3, 3) from what is expected."""
    off = _innovation(belief, pose)
    return float(off @ np.linalg.solve(belief.cov[:SPEED, :SPEED] + cov, off))


def fused(belief: Belief, pose: FloatArray, cov: FloatArray) -> Belief:
    """With a measured pose (3,) of covariance (3, 3)."""
    row = np.eye(STATES)[:SPEED]
    return Belief(*_updated(belief, row, _innovation(belief, pose), cov), belief.stood)


def _innovation(belief: Belief, pose: FloatArray) -> FloatArray:
    off = pose - belief.mean[:SPEED]
    off[YAW] -= tau * np.round(off[YAW] / tau)
    return off


def _updated(belief: Belief, row: FloatArray, innovation: FloatArray, seen: FloatArray
             ) -> tuple[FloatArray, FloatArray]:
    """P <- (I - K H) P (I - K H)^T + K R K^T: positive whatever the rounding of K."""
    cross = belief.cov @ row.T
    gain = np.linalg.solve(row @ cross + seen, cross.T).T
    keep = np.eye(STATES) - gain @ row
    return (belief.mean + gain @ innovation,
            _sound(keep @ belief.cov @ keep.T + gain @ seen @ gain.T))


def _sound(cov: FloatArray) -> FloatArray:
    cov = 0.5 * (cov + cov.T)
    cov[np.diag_indices(STATES)] *= 1.0 + JITTER
    return cov
