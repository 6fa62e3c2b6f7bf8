"""Pose of the rear axle from wheel travel and yaw rate, with its covariance.

Exact arc between frames (travel s, turn w, both from the sensors):

    x += s sinc(w/2) cos(yaw + w/2)      y += s sinc(w/2) sin(yaw + w/2)

Travel comes from edge counts, not from integrating a speed: it does not drift.
Yaw is the trapezoid of gyro samples at *their own* times, extrapolated from the
last sample to the frame with the newest rate. The extrapolated part is replaced
at the next sample, so its errors do not add up. A single wrong sample is
excluded (see ``single_samples``).

In a bend the rear axle slides outwards by a slip angle of about slip_gain times
the lateral acceleration (m l_f / (l C_r) of the linear rear tyre: 0.011 and
0.034 rad per m/s2 for the two published sets); give it when it is known.

Errors that stay the same over a run (gyro bias, gyro scale, metres per edge,
slip gain) are not noise per step: the pose's sensitivity to each is propagated and
enters the covariance as a whole, P = P_noise + sum sigma^2 S S^T. The ellipse is
then also correct on a closed loop, where such errors partly cancel.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, inf, sin
from typing import NamedTuple

import numpy as np

from dart_hal.core.types import Pose
from dart_hal.estimation.gyro import GyroBias
from dart_hal.estimation.imu_clock import AGE_STD, PERIOD
from dart_hal.estimation.single_samples import AcceptedSample

# s by which the 32 Hz filter of the IMU delays the yaw rate, 1 / (2 pi 32 Hz).
GYRO_FILTER_DELAY = 0.005
# s by which the yaw rate is older than a read that finds it at its mean age.
GYRO_LATENCY = 0.5 * PERIOD + GYRO_FILTER_DELAY
# s over which the change of the yaw rate is taken: 4e-3 rad/s of noise in a sample are then 0.03
# rad/s2; a bend of 7 s at 1 m/s changes by 1; a steering servo needs as long.
RATE_CHANGE_TIME = 0.1
# s without a gyro sample after which the turn rate is taken from the wheels.
MAX_GYRO_GAP = 0.5
# rad/s of error of the turn rate without gyro, by the wheels or held: 0.05 rad of road-wheel angle
# at 1 m/s (0.29). It is the same error for the whole pause: yaw is off by it times the seconds,
# not their root.
NO_GYRO_RATE_STD = 0.3
# Additional error as a share of the turn rate: understeer.
NO_GYRO_RATE_SHARE = 0.3
# m: a car that is turned by hand turns about a point near it, within the length of the car.
HAND_RADIUS = 0.2
# rad/s2, one sigma: yaw acceleration of a car that steers in, 2 rad/s within 0.13 s.
YAW_ACCELERATION_STD = 15.0
# s between two frames with a sample of the gyro beyond which some are missing.
MAX_GYRO_FRAME_GAP = 2.5 * PERIOD


def gap_turn_variance(gap: float, first_rate: float, last_rate: float) -> float:
    """Return the variance [rad2] of a turn over a gap [s] between two frames with a gyro sample.

    The trapezoid of the samples [rad/s] is wrong by what the yaw rate did between them: by half the
    gap squared times the yaw acceleration where the gap is short, by the error of a turn rate that
    is not measured where it is long.
    """
    if gap <= MAX_GYRO_FRAME_GAP:
        return 0.0
    missing = gap - PERIOD
    unmeasured = NO_GYRO_RATE_STD + NO_GYRO_RATE_SHARE * abs(first_rate + last_rate) / 2.0 + abs(
        last_rate - first_rate)
    return min(0.25 * YAW_ACCELERATION_STD * missing**2, unmeasured * missing)**2


@dataclass(frozen=True, slots=True)
class OdometryNoise:
    """One sigma of every error source; the defaults are those of an uncalibrated car.

    travel: random part, m per sqrt(m); travel_scale: metres per edge, relative;
    gyro_noise: rad/s per sqrt(Hz), white (LSB, vibration); gyro_scale: relative;
    gyro_bias: rad/s before the first standstill (the BNO055's zero-rate offset is 1 deg/s);
    slip: sideways sliding of the rear axle, m per sqrt(m), random; slip_gain: rad of rear
    slip angle per m/s2 of lateral acceleration; gyro_age: s per sqrt(Hz), error of the age
    GYRO_LATENCY of a sample. It causes a yaw error of its integral times the change of the
    yaw rate.

    Derivation of gyro_age: the IMU samples by its own clock, so the age is a sawtooth of
    p = 10 ms whose period is the beat of the two clocks: lines of (p / n pi)^2 / 4 at n times
    the beat. For clocks that differ by up to 0.3 %, beats of 0 to 0.3 Hz equally probable,
    that is 1.2 (p / pi)^2 / (4 x 0.3 Hz) = (3.2e-3)^2 below 0.3 Hz.
    """

    travel: float = 0.003
    travel_scale: float = 0.015
    gyro_noise: float = 4e-4
    gyro_scale: float = 0.008
    gyro_bias: float = 0.0175
    slip: float = 0.005
    slip_gain: float = 0.02
    gyro_age: float = 3.2e-3


class MotionStep(NamedTuple):
    """Measured motion of ``dt`` s, with the constant errors of the sensors.

    speed [m/s]: travel of the wheels / dt; yaw_rate [rad/s]: of the gyro, with its bias, or of
    the steering angle where ``gyro`` is False; yaw_variance [rad2]: of the turn, beyond
    the errors of the gyro; at_rest: the car is stationary, not only between two edges of its
    encoder; speed_error [m/s]: one sigma of the wheel speed while it is in doubt, and
    place_variance [m2] per axis that follows from it; yaw_acceleration [rad/s2]: change of the
    yaw rate, of which the last sample of the gyro is late.
    """

    dt: float
    speed: float
    yaw_rate: float
    yaw_variance: float = 0.0
    gyro: bool = True
    at_rest: bool = False
    speed_error: float = 0.0
    place_variance: float = 0.0
    yaw_acceleration: float = 0.0


class Odometry:
    """Dead reckoning; call ``update`` once per frame, read ``pose``."""

    def __init__(self, noise: OdometryNoise | None = None, *, gyro_bias: float = 0.0,
                 gyro_bias_std: float | None = None, slip_gain: float = 0.0) -> None:
        self.noise = n = noise or OdometryNoise()
        self.bias = GyroBias(gyro_bias, n.gyro_bias if gyro_bias_std is None else gyro_bias_std,
                             n.gyro_noise)
        self._slip_gain = slip_gain
        self.reset()

    def reset(self, x: float = 0.0, y: float = 0.0, yaw: float = 0.0) -> None:
        """Start again at a known pose; the bias of the gyro is kept."""
        self.x = x
        self.y = y
        self.yaw = yaw
        self._start = (x, y)
        self._noise_cov = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # xx xy xt yy yt tt
        self._bias_sensitivity = (0.0, 0.0, 0.0)
        self._scale_sensitivity = (0.0, 0.0, 0.0)
        self._slip_sensitivity = (0.0, 0.0)
        self._extrapolated = 0.0
        self._rate = self._slow_rate = self._rate_change = 0.0
        self._t_gyro: float | None = None
        self._t_valid = -inf
        self._distance: float | None = None
        self._now = self._no_gyro_error = self._place_error = 0.0
        self._residual = self._max_residual = 0.0

    def restart(self) -> None:
        """Keep the pose and forget the times: the device clock restarted."""
        self._t_gyro = None
        self._t_valid = -inf
        self._distance = None

    @property
    def yaw_rate(self) -> float:
        """Newest yaw rate without its bias [rad/s]."""
        return self._rate

    def update(self, now: float, distance: float, speed: float, gyro_z: float | None,
               t_gyro: float, rate: float = 1.0, yaw_rate_hint: float = 0.0,
               speed_error: float = 0.0, age_std: float = AGE_STD,
               accepted: AcceptedSample | None = None) -> MotionStep:
        """Process one frame; return the motion since the last one, for a filter.

        now, t_gyro [s]: device times of the latch and of a read that finds the gyro at its mean
        age; distance [m]: signed travel so far; speed [m/s]: 0.0 means at rest;
        gyro_z [rad/s]: body axes, None = not valid; rate: host seconds per
        device second; yaw_rate_hint [rad/s]: used while there is no gyro
        (speed tan(delta) / wheelbase of the applied steering angle); speed_error
        [m/s]: one sigma of motion that the wheels do not measure, 0.0 = none;
        age_std [s]: of the sample at t_gyro, AGE_STD where only its read is known;
        accepted: result of the filter of single samples for gyro_z.
        """
        if self._distance is None or now < self._now:
            self._distance = distance
            self._now = now
        travel = distance - self._distance
        dt = (now - self._now) * rate
        self._distance = distance
        self._now = now
        at_rest = speed == 0.0 and travel == 0.0 and speed_error == 0.0
        # At rest the gyro shows its bias, unless somebody turns or carries the car.
        if at_rest and gyro_z is not None and not self.bias.observe(
                gyro_z, dt, self._convert_bias_error):
            at_rest = False
            speed_error = HAND_RADIUS * abs(gyro_z - self.bias.value)
        begin = self._t_valid if self._t_gyro is not None else now
        before = self._rate
        withheld_sample = accepted.withheld_sample if accepted is not None else None
        turn, unknown_variance, seconds = self._integrate_yaw(
            now, gyro_z, t_gyro, rate, dt, yaw_rate_hint, at_rest, age_std, withheld_sample)
        if at_rest:
            return MotionStep(dt, 0.0, gyro_z or 0.0, 0.0, gyro_z is not None, at_rest=True)
        white = self.noise.gyro_noise**2 * seconds
        gap_variance = gap_turn_variance((now - begin) * rate, before, self._rate)
        sample_variance = (self._single_sample_variance(accepted, rate)
                           if accepted is not None else 0.0)
        self._add_arc(travel, turn, white + unknown_variance + sample_variance + gap_variance,
                      seconds, speed * self._rate)
        place = self._add_place_error(speed_error, dt)
        if dt <= 0.0:
            return MotionStep(0.0, 0.0, 0.0)
        biased = turn + self.bias.value * seconds
        has_gyro = seconds > 0.0
        yaw_variance = sample_variance + gap_variance if has_gyro else unknown_variance
        return MotionStep(dt, travel / dt, biased / dt, yaw_variance, has_gyro,
                          speed_error=speed_error, place_variance=place,
                          yaw_acceleration=self._rate_change if has_gyro else 0.0)

    def _single_sample_variance(self, accepted: AcceptedSample, rate: float) -> float:
        """Return the variance of the turn [rad2] by single wrong samples, rejected or not.

        The residuals of accepted samples add up where they have one sign: the variance is the
        square of their sum, at its largest so far.
        """
        self._residual += accepted.residual * rate
        before = self._max_residual
        self._max_residual = max(before, abs(self._residual))
        return accepted.variance * rate * rate + self._max_residual**2 - before**2

    def _add_place_error(self, speed_error: float, dt: float) -> float:
        """Add the error of a doubtful wheel speed to the variance of the place; return it [m2].

        The error is the same for the whole time of doubt, so it grows with the time, not its root.
        """
        before = self._place_error
        self._place_error = before + speed_error * dt if speed_error else 0.0
        variance = max(self._place_error**2 - before**2, 0.0)
        xx, xy, xt, yy, yt, tt = self._noise_cov
        self._noise_cov = xx + variance, xy, xt, yy + variance, yt, tt
        return variance

    def _integrate_yaw(self, now: float, gyro_z: float | None, t_gyro: float, rate: float,
                       dt: float, hint: float, at_rest: bool, age_std: float,
                       withheld_sample: tuple[float, float] | None = None
                       ) -> tuple[float, float, float]:
        """Yaw since the last frame [rad], its variance beyond white noise, seconds under bias."""
        # 1. Without gyro: hold the last rate for a while, then use that of the wheels.
        if gyro_z is None:
            if (now - self._t_valid) * rate > MAX_GYRO_GAP:
                self._rate = hint
            self._t_gyro = None
            if at_rest:
                return 0.0, 0.0, 0.0
            error = NO_GYRO_RATE_STD + NO_GYRO_RATE_SHARE * abs(hint) + abs(hint - self._rate)
            before = self._no_gyro_error
            self._no_gyro_error = self._no_gyro_error + error * dt
            return self._rate * dt, self._no_gyro_error**2 - before**2, 0.0
        self._t_valid = now
        self._no_gyro_error = 0.0
        # 2. At rest.
        if at_rest:
            self._rate = self._slow_rate = self._extrapolated = 0.0
            self._t_gyro = t_gyro
            return 0.0, 0.0, 0.0
        self.bias.stop_learning()
        # 3. Trapezoid between the samples, plus the change of the extrapolated part.
        omega = gyro_z - self.bias.value
        extrapolated = omega * ((now - t_gyro) * rate + GYRO_LATENCY)
        if self._t_gyro is None:
            turn = omega * dt
            self._slow_rate = omega
        else:
            turn = extrapolated - self._extrapolated
            begin = self._t_gyro
            first = self._rate
            if withheld_sample is not None and begin < withheld_sample[0] < t_gyro:
                middle = withheld_sample[1] - self.bias.value
                turn += 0.5 * (first + middle) * (withheld_sample[0] - begin) * rate
                begin = withheld_sample[0]
                first = middle
            if t_gyro > begin:
                turn += 0.5 * (first + omega) * (t_gyro - begin) * rate
        self._t_gyro = t_gyro
        self._rate = omega
        self._extrapolated = extrapolated
        # 4. Variance by the unknown age of the sample, times the change of the rate.
        self._rate_change = change = (omega - self._slow_rate) / RATE_CHANGE_TIME
        self._slow_rate += change * min(dt, RATE_CHANGE_TIME)
        return turn, (self.noise.gyro_age * age_std / AGE_STD * change)**2 * dt, dt

    def _convert_bias_error(self, std: float) -> None:
        """Turn the effect of the old bias into noise: a new bias is being learnt."""
        a, b, c = self._bias_sensitivity
        if a == b == c == 0.0:
            return
        v = std * std
        xx, xy, xt, yy, yt, tt = self._noise_cov
        self._noise_cov = (xx + v * a * a, xy + v * a * b, xt + v * a * c,
                           yy + v * b * b, yt + v * b * c, tt + v * c * c)
        self._bias_sensitivity = (0.0, 0.0, 0.0)

    def _add_arc(self, travel: float, turn: float, turn_var: float, seconds: float,
                 lateral: float) -> None:
        """Add an exact arc, its noise, and the sensitivities to bias and scale."""
        half = 0.5 * turn
        middle = self.yaw + half
        chord = travel * (sin(half) / half if abs(half) > 1e-6 else 1.0)
        c = cos(middle)
        s = sin(middle)
        outwards = abs(travel) * lateral  # per rad/(m/s2) of slip gain, to the right
        sideways = self._slip_gain * outwards
        dx = chord * c + sideways * s
        dy = chord * s - sideways * c
        self.x += dx
        self.y += dy
        self.yaw += turn
        self._propagate_noise(dx, dy, c, s, abs(travel), turn_var)
        bx, by, bt = self._bias_sensitivity
        self._bias_sensitivity = (bx - dy * (bt + 0.5 * seconds), by + dx * (bt + 0.5 * seconds),
                                  bt + seconds)
        px, py = self._slip_sensitivity
        self._slip_sensitivity = (px + outwards * s, py - outwards * c)
        sx, sy, st = self._scale_sensitivity
        self._scale_sensitivity = (sx - dy * (st + half), sy + dx * (st + half), st + turn)

    def _propagate_noise(self, dx: float, dy: float, c: float, s: float, length: float,
                         turn_var: float) -> None:
        """P <- F P F^T + Q with F = [[1, 0, -dy], [0, 1, dx], [0, 0, 1]].

        Q: travel noise along the heading, slip across it, yaw noise (half of
        which acts within the step).
        """
        n = self.noise
        xx, xy, xt, yy, yt, tt = self._noise_cov
        xx += -2.0 * dy * xt + dy * dy * tt
        xy += dx * xt - dy * yt - dx * dy * tt
        yy += 2.0 * dx * yt + dx * dx * tt
        xt -= dy * tt
        yt += dx * tt
        along = n.travel * n.travel * length
        across = n.slip * n.slip * length
        q = 0.5 * turn_var
        self._noise_cov = (xx + along * c * c + across * s * s, xy + (along - across) * c * s,
                           xt - dy * q, yy + along * s * s + across * c * c, yt + dx * q,
                           tt + turn_var)

    @property
    def covariance(self) -> tuple[float, float, float, float, float, float]:
        """xx, xy, xt, yy, yt, tt of the pose [m2, m rad, rad2]."""
        n = self.noise
        xx, xy, xt, yy, yt, tt = self._noise_cov
        x0, y0 = self._start
        for var, (a, b, c) in ((self.bias.std**2, self._bias_sensitivity),
                               (n.gyro_scale**2, self._scale_sensitivity),
                               (n.slip_gain**2, (*self._slip_sensitivity, 0.0)),
                               (n.travel_scale**2, (self.x - x0, self.y - y0, 0.0))):
            xx += var * a * a
            xy += var * a * b
            xt += var * a * c
            yy += var * b * b
            yt += var * b * c
            tt += var * c * c
        return xx, xy, xt, yy, yt, tt

    @property
    def pose(self) -> Pose:
        """x, y [m], yaw [rad, unwrapped], covariance (3, 3), read-only."""
        xx, xy, xt, yy, yt, tt = self.covariance
        cov = np.array(((xx, xy, xt), (xy, yy, yt), (xt, yt, tt)))
        cov.setflags(write=False)
        return Pose(self.x, self.y, self.yaw, cov)
