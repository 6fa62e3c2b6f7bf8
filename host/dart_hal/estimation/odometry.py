"""Pose of the rear axle from wheel travel and yaw rate, with its covariance.

Exact arc between frames (travel s, turn w, both from the sensors):

    x += s sinc(w/2) cos(yaw + w/2)      y += s sinc(w/2) sin(yaw + w/2)

Travel comes from edge counts, not from integrating a speed: it does not drift.
Yaw is the trapezoid of gyro samples at *their own* times, carried from the
last sample to the frame with the newest rate; what is carried telescopes. A
single wrong sample is left out of it (see ``single_samples``).

In a bend the rear axle slides outwards by a slip angle of about slip_gain times
the lateral acceleration (m l_f / (l C_r) of the linear rear tyre: 0.011 and
0.034 rad per m/s2 for the two published sets); give it when it is known.

Errors that stay the same over a run (gyro bias, gyro scale, metres per edge,
slip gain) are not noise per step: the pose's sensitivity to each is propagated and enters
the covariance as a whole, P = P_noise + sum sigma^2 S S^T. That keeps the
stated ellipse honest on a closed loop, where such errors partly cancel.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, inf, sin
from typing import NamedTuple

import numpy as np

from dart_hal.core.types import Pose
from dart_hal.estimation.gyro import GyroBias
from dart_hal.estimation.imu_clock import AGE_STD, PERIOD
from dart_hal.estimation.single_samples import Accepted

GYRO_FILTER = 0.005
"""s by which the IMU's 32 Hz filter delays the yaw rate, 1 / (2 pi 32 Hz)."""
GYRO_LATENCY = 0.5 * PERIOD + GYRO_FILTER
"""s by which the yaw rate is older than a read that finds it at its mean age."""
SMOOTH = 0.1
"""s over which the change of the yaw rate is taken: 4e-3 rad/s of noise in a sample are 0.03
rad/s2 then, a bend of 7 s at 1 m/s changes by 1; a steering servo needs as long."""
STALE = 0.5
"""s without a gyro sample after which the turn rate is taken from the wheels."""
BLIND, BLIND_SHARE = 0.3, 0.3
"""rad/s and share by which the turn rate of the wheels, or the held one, may be wrong: 0.05
rad of road-wheel angle at 1 m/s (0.29), understeer. The same error for the whole
pause: yaw is off by it times the seconds, not their root."""


@dataclass(frozen=True, slots=True)
class OdometryNoise:
    """One sigma of every error source; the defaults are those of an uncalibrated car.

    travel: random part, m per sqrt(m); travel_scale: metres per edge,
    relative; gyro_noise: rad/s per sqrt(Hz), white (LSB, vibration);
    gyro_scale: relative; gyro_bias: rad/s before the first standstill (the
    BNO055's zero-rate offset is 1 deg/s); slip: sideways sliding of the
    rear axle, m per sqrt(m), random; slip_gain: rad of rear slip angle per
    m/s2 of lateral acceleration; gyro_age: s per sqrt(Hz), how much older or
    younger than GYRO_LATENCY says a sample is: yaw goes wrong by the integral
    of that times the change of the yaw rate. The IMU samples by its own clock, so the
    age is a sawtooth of p = 10 ms whose period is the beat of the two clocks:
    lines of (p / n pi)^2 / 4 at n times the beat. For clocks up to 0.3 % apart, beats of
    0 to 0.3 Hz alike likely, that is 1.2 (p / pi)^2 / (4 x 0.3 Hz) = (3.2e-3)^2 below 0.3 Hz.
    """

    travel: float = 0.003
    travel_scale: float = 0.015
    gyro_noise: float = 4e-4
    gyro_scale: float = 0.008
    gyro_bias: float = 0.0175
    slip: float = 0.005
    slip_gain: float = 0.02
    gyro_age: float = 3.2e-3


class Motion(NamedTuple):
    """What the sensors say of ``dt`` s, their constant errors still in it.

    speed [m/s]: travel of the wheels / dt; yaw_rate [rad/s]: of the gyro, with its bias, or of
    the steering angle where ``gyro`` is False; yaw_variance [rad2]: of the turn, beyond
    what is wrong with the gyro; standing: the car is at rest, not only between two edges of its
    encoder; missed [m/s]: what the wheels may not tell while they are doubted, and
    place_variance [m2] on each side by it.
    """

    dt: float
    speed: float
    yaw_rate: float
    yaw_variance: float = 0.0
    gyro: bool = True
    standing: bool = False
    missed: float = 0.0
    place_variance: float = 0.0


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
        """Start anew at a known pose; the gyro's bias is kept."""
        self.x, self.y, self.yaw = x, y, yaw
        self._start = (x, y)
        self._noise6 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # xx xy xt yy yt tt
        self._by_bias = (0.0, 0.0, 0.0)
        self._by_scale = (0.0, 0.0, 0.0)
        self._by_slip = (0.0, 0.0)
        self._carried = 0.0
        self._rate = self._smooth = 0.0
        self._t_gyro: float | None = None
        self._t_valid = -inf
        self._distance: float | None = None
        self._now = self._blind = self._astray = 0.0
        self._residual = self._worst_residual = 0.0

    def restart(self) -> None:
        """The device clock began anew: keep the pose, forget the times."""
        self._t_gyro = None
        self._t_valid = -inf
        self._distance = None

    @property
    def yaw_rate(self) -> float:
        """Newest yaw rate without its bias [rad/s]."""
        return self._rate

    def update(self, now: float, distance: float, speed: float, gyro_z: float | None,
               t_gyro: float, rate: float = 1.0, yaw_rate_hint: float = 0.0,
               missed: float = 0.0, age_std: float = AGE_STD,
               accepted: Accepted | None = None) -> Motion:
        """One frame; returns the motion since the last one, for a filter.

        now, t_gyro [s]: device times of the latch and of a read that finds the gyro at its mean
        age; distance [m]: signed travel so far; speed [m/s]: 0.0 means standing;
        gyro_z [rad/s]: body axes, None = not valid; rate: host seconds per
        device second; yaw_rate_hint [rad/s]: used while there is no gyro
        (speed tan(delta) / wheelbase of the applied steering angle); missed
        [m/s]: what the car may do that its wheels do not tell, 0.0 = nothing;
        age_std [s]: of the sample at t_gyro, AGE_STD where only its read is known;
        accepted: what the filter of single samples adds to gyro_z.
        """
        if self._distance is None or now < self._now:
            self._distance, self._now = distance, now
        travel = distance - self._distance
        dt = (now - self._now) * rate
        self._distance, self._now = distance, now
        standing = speed == 0.0 and travel == 0.0 and missed == 0.0
        late = accepted.late if accepted is not None else None
        turn, unsure, seconds = self._turn(now, gyro_z, t_gyro, rate, dt, yaw_rate_hint, standing,
                                         age_std, late)
        if standing:
            return Motion(dt, 0.0, gyro_z or 0.0, 0.0, gyro_z is not None, standing=True)
        white = self.noise.gyro_noise**2 * seconds
        wrong = self._single_samples(accepted, rate) if accepted is not None else 0.0
        self._move(travel, turn, white + unsure + wrong, seconds, speed * self._rate)
        place = self._stray(missed, dt)
        if dt <= 0.0:
            return Motion(0.0, 0.0, 0.0)
        biased, known = turn + self.bias.value * seconds, seconds > 0.0
        return Motion(dt, travel / dt, biased / dt, wrong if known else unsure, known,
                      missed=missed, place_variance=place)

    def _single_samples(self, accepted: Accepted, rate: float) -> float:
        """Variance of the turn [rad2] by single wrong samples, rejected or not.

        The residuals of accepted samples add up where they have one sign: the variance is the
        square of their sum, at its largest so far.
        """
        self._residual += accepted.residual * rate
        before = self._worst_residual
        self._worst_residual = max(before, abs(self._residual))
        return accepted.variance * rate * rate + self._worst_residual**2 - before**2

    def _stray(self, missed: float, dt: float) -> float:
        """What a doubted wheel adds to the variance of the place [m2]: the same error for as long
        as it is doubted, so it grows with the time, not its root."""
        before = self._astray
        self._astray = before + missed * dt if missed else 0.0
        added = max(self._astray**2 - before**2, 0.0)
        xx, xy, xt, yy, yt, tt = self._noise6
        self._noise6 = xx + added, xy, xt, yy + added, yt, tt
        return added

    def _turn(self, now: float, gyro_z: float | None, t_gyro: float, rate: float, dt: float,
              hint: float, standing: bool, age_std: float,
              late: tuple[float, float] | None = None) -> tuple[float, float, float]:
        """Yaw since the last frame [rad], its variance beyond white noise, seconds under bias."""
        if gyro_z is None:
            if (now - self._t_valid) * rate > STALE:
                self._rate = hint
            self._t_gyro = None
            if standing:
                return 0.0, 0.0, 0.0
            unsure = BLIND + BLIND_SHARE * abs(hint) + abs(hint - self._rate)
            before, self._blind = self._blind, self._blind + unsure * dt
            return self._rate * dt, self._blind**2 - before**2, 0.0
        self._t_valid, self._blind = now, 0.0
        if standing:
            self.bias.observe(gyro_z, dt, self._freeze_bias)
            self._rate = self._smooth = self._carried = 0.0
            self._t_gyro = t_gyro
            return 0.0, 0.0, 0.0
        self.bias.moving()
        omega = gyro_z - self.bias.value
        carried = omega * ((now - t_gyro) * rate + GYRO_LATENCY)
        if self._t_gyro is None:
            turn, self._smooth = omega * dt, omega
        else:
            turn = carried - self._carried
            begin = self._t_gyro
            first = self._rate
            if late is not None and begin < late[0] < t_gyro:
                middle = late[1] - self.bias.value
                turn += 0.5 * (first + middle) * (late[0] - begin) * rate
                begin = late[0]
                first = middle
            if t_gyro > begin:
                turn += 0.5 * (first + omega) * (t_gyro - begin) * rate
        self._t_gyro, self._rate, self._carried = t_gyro, omega, carried
        change = (omega - self._smooth) / SMOOTH
        self._smooth += change * min(dt, SMOOTH)
        return turn, (self.noise.gyro_age * age_std / AGE_STD * change)**2 * dt, dt

    def _freeze_bias(self, std: float) -> None:
        """A new bias is being learnt: what the old one did becomes plain noise."""
        a, b, c = self._by_bias
        if a == b == c == 0.0:
            return
        v = std * std
        xx, xy, xt, yy, yt, tt = self._noise6
        self._noise6 = (xx + v * a * a, xy + v * a * b, xt + v * a * c,
                        yy + v * b * b, yt + v * b * c, tt + v * c * c)
        self._by_bias = (0.0, 0.0, 0.0)

    def _move(self, travel: float, turn: float, turn_var: float, seconds: float,
              lateral: float) -> None:
        """Exact arc, its noise, and the sensitivities to bias and scale."""
        half = 0.5 * turn
        middle = self.yaw + half
        chord = travel * (sin(half) / half if abs(half) > 1e-6 else 1.0)
        c, s = cos(middle), sin(middle)
        outwards = travel * lateral  # per rad/(m/s2) of slip gain, to the right
        aside = self._slip_gain * outwards
        dx, dy = chord * c + aside * s, chord * s - aside * c
        self.x += dx
        self.y += dy
        self.yaw += turn
        self._spread(dx, dy, c, s, abs(travel), turn_var)
        bx, by, bt = self._by_bias
        self._by_bias = (bx - dy * (bt + 0.5 * seconds), by + dx * (bt + 0.5 * seconds),
                         bt + seconds)
        px, py = self._by_slip
        self._by_slip = (px + outwards * s, py - outwards * c)
        sx, sy, st = self._by_scale
        self._by_scale = (sx - dy * (st + half), sy + dx * (st + half), st + turn)

    def _spread(self, dx: float, dy: float, c: float, s: float, length: float,
                turn_var: float) -> None:
        """P <- F P F^T + Q with F = [[1, 0, -dy], [0, 1, dx], [0, 0, 1]].

        Q: travel noise along the heading, slip across it, yaw noise (half of
        which acts within the step).
        """
        n = self.noise
        xx, xy, xt, yy, yt, tt = self._noise6
        xx += -2.0 * dy * xt + dy * dy * tt
        xy += dx * xt - dy * yt - dx * dy * tt
        yy += 2.0 * dx * yt + dx * dx * tt
        xt -= dy * tt
        yt += dx * tt
        along = n.travel * n.travel * length
        across = n.slip * n.slip * length
        q = 0.5 * turn_var
        self._noise6 = (xx + along * c * c + across * s * s, xy + (along - across) * c * s,
                        xt - dy * q, yy + along * s * s + across * c * c, yt + dx * q,
                        tt + turn_var)

    @property
    def covariance(self) -> tuple[float, float, float, float, float, float]:
        """xx, xy, xt, yy, yt, tt of the pose [m2, m rad, rad2]."""
        n = self.noise
        xx, xy, xt, yy, yt, tt = self._noise6
        x0, y0 = self._start
        for var, (a, b, c) in ((self.bias.std**2, self._by_bias),
                               (n.gyro_scale**2, self._by_scale),
                               (n.slip_gain**2, (*self._by_slip, 0.0)),
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
