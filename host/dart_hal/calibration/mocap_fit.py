"""Where the marker frame sits on the car, and how late its poses are, from one drive.

Dead reckoning says how the rear axle moved, the source how the marker did:

    p_m(t) = p(t) + R(yaw(t)) (l_x, l_y),   yaw_m(t) = yaw(t) - theta

with the pose that was measured ``latency`` before its stamp says. The axle goes where the
wheels point but for its slip v_y, with c the axle's mass by its stiffness [s2/m]:

    v_y = -c v (v omega + (k - c v^2) domega/dt),   k = l_r - I / (m l_f)

Slow and fast turns both ways tell l_x from the slip, l_y from the travel per edge, and the
change from one to the other the latency. Dead reckoning drifts, so each stretch begins
anew: its start is fitted with the rest, and errors count by stretches.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import Estimate, FloatArray, IntArray
from dart_hal.estimation.imu_clock import READ_STD, SLOT_WORK_STD
from dart_hal.vehicle.fitting.covariance import leverage_covariance
from dart_hal.vehicle.fitting.least_squares import least_squares

from .latency_fit import FILTER_STD

STRETCH = 3.0
"""s: by the gyro's 0.001 rad/s the car is 2 mm off its place then."""
NOISE = (1e-3, 2e-3)
"""m, rad: one sigma of a pose of an optical system; only their ratio counts."""
ROBUST = 3.0
NAMES = ("marker_x", "marker_y", "marker_yaw", "latency")
SLIP = (0.03, 0.03)
"""s2/m, mean and one sigma of c: 0.77 kg on 22 N/rad in the published model of the car."""
TURN_IN = (0.046, 0.02)
"""m, mean and one sigma of k: what the side force of the rear axle has of the yaw acceleration.

About the front axle that force is F = (m l_f a - I domega/dt) / L, where the centre of mass has
a = dv_y/dt + v omega + l_r domega/dt to the side, and v_y = -v F / C of a tyre of stiffness C. With
c = m l_f / (L C) and dv_y/dt = -c v^2 domega/dt, of a steady turn, this is the law above. The
published model of the car has k = 0.0945 - 0.0065 / (1.67 x 0.0805) m; its inertia and its axle
loads are not those of every car. Without the term each change from left to right is off by
c v k 2 omega = 2 mm in place, which stretches of 3 s show as scatter and an l_x, l_y and yaw of
the marker take up.
"""
BIAS = 2e-3
"""rad/s, one sigma of what is left of the gyro's bias."""
LOOSE = 0.02
"""Relative, one sigma of gyro scale and of travel per edge: a car that was never calibrated."""
WITHIN = {"marker_x": 0.4, "marker_y": 0.4, "marker_yaw": 0.5, "latency": 0.25}
"""m, m, rad, s: a car is 0.4 m long, and what is later than that is no motion capture."""
WORST = 0.02
"""m rms between both after the fit; 1 to 3 mm are usual."""
FEWEST = 5
PRIORS = 5
"""Of bias, both scales, slip and turn-in."""
FLOOR = {"marker_x": math.hypot(7e-5, 5e-5), "marker_y": 1e-5, "marker_yaw": 3e-5,
         "latency": math.hypot(FILTER_STD, SLOT_WORK_STD, READ_STD)}
"""m, m, rad, s: one sigma of what the stretches do not show, for each circle meets it again.

Latency: what the delay of the yaw rate is not known by, its filter, the read of the IMU and the age
of its samples. The poses are found later by 0.95 of it. Marker_x follows by 0.08 m/s of it, 0.05
mm. The side force of a rear tyre that ends at 0.9 of its load bends by 1.2 % at 1.3 m/s2 (0.8 to
1.9 % at 1.1 to 0.7), as F / sqrt(1 + (k F)^2) does, while the law has a straight line: fits of
three simulated cars with and without that moved by 0.057 mm and 0.017 mrad for each per cent. Of y,
for which neither counts, nine cars were off by 0.013 mm where their stretches show 0.011.
"""


@dataclass(frozen=True, slots=True)
class Track:
    """What car and source told of one drive.

    t (n,) [s], car (n, 3): x, y [m], yaw [rad] by dead reckoning, v (n,) [m/s] of the wheels;
    t_seen (m,) [s] by the source's stamps on the car's clock, seen (m, 3), yaw unwrapped; noise:
    one sigma of its places [m] and yaws [rad].
    """

    t: FloatArray
    car: FloatArray
    v: FloatArray
    t_seen: FloatArray
    seen: FloatArray
    noise: tuple[float, float] = NOISE


@dataclass(frozen=True, slots=True)
class Marker:
    """By ``NAMES``; rms [m] of what is left; stretches that told it."""

    found: dict[str, Estimate]
    rms: float
    stretches: int


def fit_marker(track: Track) -> Marker:
    """Errors: CalibrationFailed for poses that this car cannot have had, and for too few."""
    block = ((track.t_seen - track.t_seen[0]) / STRETCH).astype(np.int64)
    kept = [b for b in np.unique(block) if np.sum(block == b) >= 0.3 * np.median(
        np.bincount(block)) and np.sum(block == b) >= 10]
    use = np.isin(block, kept)
    if len(kept) < FEWEST:
        raise CalibrationFailed("too few poses", found=f"{len(kept)} stretches of {STRETCH:.0f} s",
                                expected=f"{FEWEST}", likely="the source sees the car only now "
                                "and then", remedy="dart-hal top shows the poses")
    problem = _Problem(track, track.t_seen[use], track.seen[use],
                       np.unique(block[use], return_inverse=True)[1])
    high = np.array([*WITHIN.values(), 1.0, 0.2, 0.2, 0.5, 0.2])
    start = np.zeros(9)
    start[7] = SLIP[0]
    start[8] = TURN_IN[0]
    fit = least_squares(problem.residual, start.tolist(), ((-high).tolist(), high.tolist()),
                        robust=ROBUST)
    rms = problem.rms(fit.x)
    for name, at_end in zip(NAMES, fit.at_bound, strict=False):
        if at_end or rms > WORST:
            raise CalibrationFailed(
                "the poses do not fit what the car did", found=f"{1e3 * rms:.0f} mm rms, {name} "
                f"{fit.x[NAMES.index(name)]:+.3f}", expected=f"{1e3 * WORST:.0f} mm at most",
                likely="another body, a frame that is not right-handed with z up, other units, or "
                       "a clock of the source that jumps",
                remedy="options of the source's URL: units, angle, hand, turn, body")
    n = len(problem.index)
    groups = np.concatenate([np.tile(problem.index, 3), n + np.arange(PRIORS)])
    std = np.sqrt(np.diag(leverage_covariance(fit, groups)))
    return Marker({name: Estimate(float(fit.x[i]), float(np.hypot(std[i], FLOOR.get(name, 0.0))))
                   for i, name in enumerate(NAMES)}, rms, len(kept))


class _Problem:
    """Residuals of the poses with the best start of each stretch, in standard errors."""

    def __init__(self, track: Track, t: FloatArray, seen: FloatArray, index: IntArray) -> None:
        self.track, self.t, self.seen, self.index = track, t, seen, index
        self._dt = np.diff(track.t)
        self._step = np.hypot(np.diff(track.car[:, 0]), np.diff(track.car[:, 1]))
        self._turn = np.diff(track.car[:, 2])
        self._v = 0.5 * (track.v[1:] + track.v[:-1])
        self._change = np.gradient(self._turn / self._dt)  # of the yaw rate, in each step
        self._count = np.bincount(index).astype(float)

    def residual(self, x: FloatArray) -> FloatArray:
        """(3 m + PRIORS,): x, y, yaw, and the priors of bias, scales, slip and its turn-in."""
        place, yaw = self._difference(x)
        prior = np.array([x[4] / BIAS, x[5] / LOOSE, x[6] / LOOSE, (x[7] - SLIP[0]) / SLIP[1],
                          (x[8] - TURN_IN[0]) / TURN_IN[1]])
        at, turned = self.track.noise
        return np.concatenate([place.real / at, place.imag / at, yaw / turned, prior])

    def rms(self, x: FloatArray) -> float:
        """Of the places [m], without the worst two of a hundred."""
        size = np.abs(self._difference(x)[0])
        return float(np.sqrt(np.mean(size[size <= np.quantile(size, 0.98)]**2)))

    def _difference(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Seen less driven: places (m,) complex, yaws (m,), each stretch laid upon the other."""
        lx, ly, theta, latency, bias, gyro, wheels, slip, turn_in = x
        turn = self._turn * (1.0 + gyro) + bias * self._dt
        yaw = np.concatenate([[0.0], np.cumsum(turn)])
        middle = 0.5 * (yaw[1:] + yaw[:-1])
        v = self._v
        aside = -slip * v * (v * turn + (turn_in - slip * v**2) * self._change)
        moved = (1.0 + wheels) * self._step + 1j * aside
        place = np.concatenate([[0.0], np.cumsum(moved * np.exp(1j * middle))])
        place = place + (lx + 1j * ly) * np.exp(1j * yaw)
        at = self.t - latency
        driven = (np.interp(at, self.track.t, place.real)
                  + 1j * np.interp(at, self.track.t, place.imag))
        turned = np.interp(at, self.track.t, yaw) - theta
        seen = self.seen[:, 0] + 1j * self.seen[:, 1]
        return self._laid(driven, turned, seen)

    def _laid(self, driven: FloatArray, turned: FloatArray, seen: FloatArray
              ) -> tuple[FloatArray, FloatArray]:
        """The rigid motion of each stretch that both places and yaws ask for, taken out."""
        b, n, (at, turn) = self.index, self._count, self.track.noise
        yaw_off = self._mean(self.seen[:, 2] - turned)
        driven = driven * np.exp(1j * yaw_off)[b]
        driven = driven - self._mean(driven)[b]
        seen = seen - self._mean(seen)[b]
        across = np.bincount(b, (np.conj(driven) * seen).imag)
        spread = np.bincount(b, np.abs(driven)**2)
        more = across / at**2 / (spread / at**2 + n / turn**2)
        place = seen - driven * np.exp(1j * more)[b]
        return place, self.seen[:, 2] - turned - (yaw_off + more)[b]

    def _mean(self, values: FloatArray) -> FloatArray:
        b, n = self.index, self._count
        if np.iscomplexobj(values):
            both = np.bincount(b, values.real) + 1j * np.bincount(b, values.imag)
            return np.asarray(both / n)
        return np.asarray(np.bincount(b, values) / n)
