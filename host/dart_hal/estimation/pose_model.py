"""One step of the extended Kalman filter of the pose: motion, rest, a measured pose.

The state of the rear axle and what is wrong with the sensors, (13,):

    x, y [m], yaw [rad, unwrapped], speed [m/s], yaw rate [rad/s],
    gyro bias [rad/s], gyro scale, travel scale [relative],
    slip gain [rad of rear slip angle per m/s2 of lateral acceleration],
    marker lx, ly [m] from the rear axle, theta [rad], latency [s] of the source

with  speed = (1 + travel scale) wheel speed,  yaw rate = (1 + gyro scale) (gyro - bias).
Wheels and gyro are inputs of the motion, not measurements of a state that is integrated: travel
from edge counts does not drift. The errors have no dynamics; they are learnt from poses, the bias
also at rest.

A pose that was measured is that of the marker, ``latency`` before the time it is given for:

    x + lx cos(yaw) - ly sin(yaw),  y + lx sin(yaw) + ly cos(yaw),  yaw - theta

Bends tell the marker from the axle, changing speed tells the latency from lx.

Source: Thrun, Burgard, Fox, Probabilistic Robotics (2005), chapters 3.3 and 5.4; the update is
Joseph's form.
"""

from __future__ import annotations

from math import cos, sin, tau
from typing import NamedTuple

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.estimation.gyro import CORRELATED, GATE, QUANTUM, SETTLE, WALK
from dart_hal.estimation.odometry import BLIND, BLIND_SHARE, Motion, OdometryNoise

(X, Y, YAW, SPEED, RATE, BIAS, GYRO, TRAVEL, SLIP,
 LX, LY, THETA, LATENCY) = range(STATES := 13)

START_STD = 1e-3
"""m, rad: how well a start is known that is called the origin."""
SPEED_STD = 0.02
"""m/s of the wheels' speed over a frame: the counts of 20 uneven edges a turn."""
RATE_STD = 4e-3
"""rad/s of one sample of the gyro: 4e-4 rad/s per sqrt(Hz) at 100 Hz."""
SAMPLE_AGE = 2.5e-3
"""s per sqrt(s), times the yaw rate: what a gyro sample of unsure age (``OdometryNoise.gyro_age``)
does to the turn. Between poses its jumps by up to 10 ms of turning count, taken for random; with it
the normalised error squared of four hidden cars is 2.7, by the change of the yaw rate 1.9."""
FINEST = 1e-4
"""m, rad: no external pose is better; a stated covariance below leaves no room for the model."""
JITTER = 1e-12
"""Share of each variance that a step adds, 1000 times the rounding of a (13, 13) product: the
correlation matrix stays positive definite, and a day of 100 Hz adds 1e-5."""
EYE: FloatArray = np.eye(STATES)
HALF: FloatArray = 0.5 * (1.0 + JITTER * EYE)
CHI2_3 = 16.27
"""Square of the Mahalanobis distance that one right pose in 1000 exceeds: chi-square, 3 degrees."""


class Marker(NamedTuple):
    """Where a source sees the car, and how late: lx, ly [m], theta [rad] to be added to the yaw of
    the marker frame, latency [s]; ``std``: one sigma of each."""

    lx: float = 0.0
    ly: float = 0.0
    theta: float = 0.0
    latency: float = 0.0
    std: tuple[float, float, float, float] = (FINEST, FINEST, FINEST, 1e-5)


class Belief(NamedTuple):
    """mean (13,), cov (13, 13); ``stood`` [s]: for how long the car has stood still."""

    mean: FloatArray
    cov: FloatArray
    stood: float = 0.0


def started(noise: OdometryNoise, gyro_bias: float, gyro_bias_std: float, slip_gain: float,
            marker: Marker) -> Belief:
    """At the origin, standing."""
    mean = np.zeros(STATES)
    mean[BIAS], mean[SLIP], mean[LX:] = gyro_bias, slip_gain, marker[:4]
    std = np.full(STATES, START_STD)
    std[BIAS:LX] = gyro_bias_std, noise.gyro_scale, noise.travel_scale, noise.slip_gain
    std[LX:] = marker.std
    return Belief(mean, np.diag(std**2))


def moved(belief: Belief, motion: Motion, noise: OdometryNoise) -> Belief:
    """``motion.dt`` s later, along an exact arc; at rest where the wheels stand."""
    if motion.standing:
        return _rested(belief, motion, noise)
    dt, wheels, rate, variance, gyro, _, missed, place = motion
    mean, (bias, scale, travel, slip) = belief.mean.copy(), belief.mean[BIAS:LX].tolist()
    grows = 1.0 + scale if gyro else 1.0
    omega = grows * (rate - bias) if gyro else rate
    speed = (1.0 + travel) * wheels
    half, length = 0.5 * omega * dt, speed * dt
    middle = float(mean[YAW]) + half
    c, s = cos(middle), sin(middle)
    chord = wheels * dt * (sin(half) / half if abs(half) > 1e-6 else 1.0)
    outwards = length * speed * omega  # per rad/(m/s2) of slip gain, to the right
    ahead, aside = (1.0 + travel) * chord, slip * outwards
    dx, dy = ahead * c + aside * s, ahead * s - aside * c
    mean[:BIAS] += (dx, dy, omega * dt, speed - mean[SPEED], omega - mean[RATE])

    step = EYE.copy()  # one number at a time: five times quicker than by lists of indices
    step[SPEED, SPEED] = step[RATE, RATE] = 0.0
    step[X, YAW], step[Y, YAW] = -dy, dx
    step[X, TRAVEL], step[Y, TRAVEL], step[SPEED, TRAVEL] = chord * c, chord * s, wheels
    step[X, SLIP], step[Y, SLIP] = outwards * s, -outwards * c
    if gyro:
        for row, by in ((X, -0.5 * dy * dt), (Y, 0.5 * dx * dt), (YAW, dt), (RATE, 1.0)):
            step[row, BIAS], step[row, GYRO] = -grows * by, (rate - bias) * by

    sampled = (noise.gyro_noise**2 + (SAMPLE_AGE * omega)**2) * dt if gyro else 0.0
    along, across = abs(length) * noise.travel**2, abs(length) * noise.slip**2
    turn = sampled + variance
    xy = (along - across) * c * s - 0.25 * dx * dy * turn
    cov = step @ belief.cov @ step.T
    cov[:SPEED, :SPEED] += (
        (along * c * c + across * s * s + 0.25 * dy * dy * turn + place, xy, -0.5 * dy * turn),
        (xy, along * s * s + across * c * c + 0.25 * dx * dx * turn + place, 0.5 * dx * turn),
        (-0.5 * dy * turn, 0.5 * dx * turn, turn))
    cov[SPEED, SPEED] += SPEED_STD**2 + missed**2
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
    """Where the marker was measured at (3,), covariance (3, 3), whatever was believed before.

    The axle's place is as unsure as the marker's on the car, and goes with it.
    """
    mean, whole = belief.mean.copy(), belief.cov.copy()
    late, yaw = mean[LATENCY], pose[YAW] + mean[THETA]
    velocity = _velocity(mean, yaw)
    mean[:SPEED] = pose + late * velocity
    whole[:SPEED], whole[:, :SPEED] = 0.0, 0.0
    whole[:SPEED, :SPEED] = cov
    by = np.zeros((SPEED, STATES))  # the way since it was measured
    by[:, LATENCY] = velocity
    whole[:SPEED] += by @ whole
    whole[:, :SPEED] += whole @ by.T
    return _of_axle(Belief(mean, whole, belief.stood))


def distance2(belief: Belief, pose: FloatArray, cov: FloatArray) -> float:
    """Squared Mahalanobis distance of a pose (3,) of covariance (3, 3) from what is expected."""
    marker = of_marker(belief)
    at, row = _seen(marker)
    off = _innovation(at, pose)
    return float(off @ np.linalg.solve(row @ marker.cov @ row.T + cov, off))


def fused(belief: Belief, pose: FloatArray, cov: FloatArray) -> Belief:
    """With a measured pose (3,) of covariance (3, 3).

    Updated in the marker's coordinates, where a pose says nothing of where the marker sits: that
    only motion can tell. In the axle's, each linearisation would invent some of it at rest.
    """
    marker = of_marker(belief)
    at, row = _seen(marker)
    mean, whole = _updated(marker, row, _innovation(at, pose), cov)
    return _of_axle(Belief(mean, whole, belief.stood))


def of_marker(belief: Belief) -> Belief:
    """With the pose of the marker in place of the axle's."""
    mean, turn = belief.mean.copy(), _lever(belief.mean, belief.mean[YAW])
    mean[:SPEED] += _lever_arm(mean, mean[YAW])
    return Belief(mean, turn @ belief.cov @ turn.T, belief.stood)


def _of_axle(marker: Belief) -> Belief:
    mean = marker.mean.copy()
    mean[:SPEED] -= _lever_arm(mean, mean[YAW] + mean[THETA])
    c, s = cos(mean[YAW]), sin(mean[YAW])
    dx, dy, _ = _lever_arm(mean, mean[YAW])
    back = EYE.copy()  # the inverse of ``_lever``
    back[X, YAW] = back[X, THETA] = dy
    back[Y, YAW] = back[Y, THETA] = -dx
    back[X, LX], back[X, LY], back[Y, LX], back[Y, LY] = -c, s, -s, -c
    back[YAW, THETA] = 1.0
    return Belief(mean, _sound(back @ marker.cov @ back.T), marker.stood)


def _lever_arm(mean: FloatArray, yaw: float) -> FloatArray:
    """Marker less axle, x, y [m], yaw [rad], of a car with this yaw."""
    (lx, ly, theta), c, s = mean[LX:LATENCY], cos(yaw), sin(yaw)
    return np.array((lx * c - ly * s, lx * s + ly * c, -theta))


def _lever(mean: FloatArray, yaw: float) -> FloatArray:
    """Derivative (13, 13) of the marker's coordinates by the axle's."""
    c, s = cos(yaw), sin(yaw)
    dx, dy, _ = _lever_arm(mean, yaw)
    turn: FloatArray = EYE.copy()
    turn[X, YAW], turn[Y, YAW], turn[YAW, THETA] = -dy, dx, -1.0
    turn[X, LX], turn[X, LY], turn[Y, LX], turn[Y, LY] = c, -s, s, c
    return turn


def _seen(marker: Belief) -> tuple[FloatArray, FloatArray]:
    """Pose (3,) that the source should have seen, ``latency`` ago, and its derivative (3, 13)."""
    mean = marker.mean
    yaw, late = mean[YAW] + mean[THETA], mean[LATENCY]
    velocity = _velocity(mean, yaw)
    row = EYE[:SPEED].copy()
    row[:, LATENCY] = -velocity
    row[:YAW, SPEED] = -late * cos(yaw), -late * sin(yaw)
    row[YAW, RATE] = -late
    return mean[:SPEED] - late * velocity, row


def _velocity(mean: FloatArray, yaw: float) -> FloatArray:
    """Of the marker, x, y [m/s], yaw [rad/s], on a car with this yaw."""
    speed, rate, (dx, dy, _) = mean[SPEED], mean[RATE], _lever_arm(mean, yaw)
    return np.array((speed * cos(yaw) - rate * dy, speed * sin(yaw) + rate * dx, rate))


def _innovation(at: FloatArray, pose: FloatArray) -> FloatArray:
    off = pose - at
    off[YAW] -= tau * np.round(off[YAW] / tau)
    return off


def _updated(belief: Belief, row: FloatArray, innovation: FloatArray, seen: FloatArray
             ) -> tuple[FloatArray, FloatArray]:
    """P <- (I - K H) P (I - K H)^T + K R K^T: positive whatever the rounding of K."""
    cross = belief.cov @ row.T
    gain = np.linalg.solve(row @ cross + seen, cross.T).T
    keep = EYE - gain @ row
    return (belief.mean + gain @ innovation,
            _sound(keep @ belief.cov @ keep.T + gain @ seen @ gain.T))


def _sound(cov: FloatArray) -> FloatArray:
    sound: FloatArray = (cov + cov.T) * HALF
    return sound
