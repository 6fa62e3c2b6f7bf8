"""From a pulse of the servo to the road wheels, by the yaw rate: delay, lag and slew of the servo.

The car is steered to and fro between two pulses at a steady speed. The servo waits for the delay,
then turns at its slew at most and with its lag; the wheels follow the linkage behind its backlash;
and the yaw rate follows the wheels as the tyres do (linear bicycle). What it reaches at either
pulse is fitted, so neither map nor gyro scale need be exact:

    omega = v (a + b f(t)) + c          f: share of the way between the two, 0..1

Backlash and tyres delay a turn as well. They come from the car's files where they were measured.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from dart_hal.actuation.steering_map import SteeringMap, steering_map
from dart_hal.config import CarFiles
from dart_hal.errors import CalibrationFailed
from dart_hal.types import FloatArray
from dart_hal.vehicle.load import vehicle_of
from dart_hal.vehicle.parameters import PaperTyres, Vehicle

from .latency_age import read_after, without_age
from .latency_fit import Fit, Problem, fit_lag
from .latency_log import Traffic, not_following
from .latency_pulse import Grid
from .latency_wheel import BEFORE, DT, LONGEST_DELAY, LONGEST_LAG, sure_steps

BACKLASH = (0.02, 0.012)
"""rad, and one sigma, of a linkage that nobody has measured: 0.3 to 2 degrees."""
TYRES = 0.15
"""Relative, one sigma of the tyres' stiffness by a model of another car; 0.1 by its own."""
SLEW = (3800.0, 1500.0)
"""us of pulse per s: 0.16 s for 60 degrees, as servos of this class state."""
NOISE = 0.003
"""rad/s: the gyro's 2.5e-4 rad/s/sqrt(Hz) at 100 Hz, and its step of 1/900."""
GYRO_HZ, FILTER_STD = 32.0, 0.0005
"""Hz of the BNO055's filter as the firmware sets it; s, one sigma of its delay of 5 ms: 10 %."""
TYRES_LATE = 0.0004
"""s, one sigma of what one stiffness for both axles leaves of the 4 to 7 ms by which the yaw rate
is behind the wheels at 0.5 m/s, where front, rear and inertia are each known to 10 %."""
HIDDEN_LAG, LAG_STD = 0.04, 0.003
"""s: a shorter lag shows nothing, for the slew holds the servo back all the way; and one sigma of
what map and tyres leave in a longer one."""
SLEW_STD = 0.015
"""Relative, one sigma that the shape of the map leaves in the slew."""
WEAK = 0.3
"""rad/s by which the yaw rate must change."""
TURNS = 20
"""Of the ring, at least; at 0.5 m/s it turns 12 times a second."""
LAG, RATE, PLAY, GRIP = range(4)


@dataclass(frozen=True, slots=True)
class Turning:
    """delay, lag [s], slew [us/s] of the servo, each with one sigma; rms left [rad/s].

    lag None: it is hidden behind the slew.
    """

    delay: tuple[float, float]
    lag: tuple[float, float] | None
    slew: tuple[float, float]
    left: float


@dataclass(frozen=True, slots=True)
class Linkage:
    """What is known of the steering: map, backlash and tyres, each with one sigma."""

    map: SteeringMap
    backlash: tuple[float, float]
    vehicle: Vehicle
    tyres: float


def linkage_of(files: CarFiles) -> Linkage:
    """By the car's own files, else by those of cars of its kind."""
    measured = files.calibration.steering if files.calibration else None
    play = measured.backlash if measured else None
    return Linkage(steering_map(files.config, measured.map if measured else None),
                   BACKLASH if play is None else (play.value, max(play.std, 1e-3)),
                   vehicle_of(files.model), TYRES)


def fit_yaw(grid: Grid, traffic: Traffic, starts: FloatArray, linkage: Linkage, speed: float,
            metres: float, edges_per_rev: int) -> Turning:
    """Each turn has a delay of its own, for the gyro's samples are of different age
    (``latency_age``); the rest is common to all.

    starts (k,) [s] of the repetitions; speed [m/s] that was held. Errors: CalibrationFailed where
    the yaw rate does not follow the steering.
    """
    turns = _turns(grid, traffic, starts, linkage, speed, metres, edges_per_rev)
    n = len(turns.at)
    start, low, high, steps, known = (np.append(common, np.full(n, own)) for common, own in (
        ([0.005, SLEW[0], linkage.backlash[0], 1.0], 0.02),
        ([0.0, 500.0, 0.0, 0.3], -0.05), ([LONGEST_LAG, 3e4, 0.15, 3.0], LONGEST_DELAY),
        ([1e-3, 50.0, 1e-3, 0.02], 1e-3), ([np.inf, SLEW[1], linkage.backlash[1], linkage.tyres],
                                          np.inf)))
    found, shows = fit_lag(Problem(turns.residual, start, low, high, steps, known, NOISE), LAG,
                           HIDDEN_LAG)
    return _turning(found, shows, turns, read_after(traffic))


@dataclass(frozen=True, slots=True)
class Turns:
    """yaw (m,) [rad/s] at yaw_t (m,) [s] and speed v (m,) [m/s]; grid t (n,) [s].

    at (k,) [s]: ends of the pulses [us] that turn the servo from ``before`` ``to``; curve: pulses
    [us] and their angles [rad]; tyres: filter of a stiffness.
    """

    yaw_t: FloatArray
    yaw: FloatArray
    v: FloatArray
    t: FloatArray
    at: FloatArray
    before: FloatArray
    to: FloatArray
    curve: tuple[FloatArray, FloatArray]
    tyres: Callable[[float], tuple[FloatArray, FloatArray]]

    def residual(self, x: FloatArray) -> FloatArray:
        """What lag, slew, play, stiffness and the delays of all turns leave of ``yaw``."""
        from scipy.signal import lfilter

        share = _share(self.t, self.at + x[4:], self.before, self.to, x[:4], self.curve)
        b, a = self.tyres(max(float(x[GRIP]), 0.1))
        seen = -np.expm1(-2.0 * np.pi * GYRO_HZ * DT)
        turning = lfilter([seen], [1.0, seen - 1.0], lfilter(b, a, share))
        followed = np.interp(self.yaw_t, self.t, turning)
        columns = np.column_stack([self.v, self.v * followed, np.ones_like(self.v)])
        best, *_ = np.linalg.lstsq(columns, self.yaw, rcond=None)
        return np.asarray(self.yaw - columns @ best)


def _turns(grid: Grid, traffic: Traffic, starts: FloatArray, linkage: Linkage, speed: float,
           metres: float, edges_per_rev: int) -> Turns:
    """Those whose PWM frame is known. Errors: as ``fit_yaw``."""
    yaw_t, yaw = traffic.column("yaw_t"), traffic.column("yaw_rate")
    begin = starts - BEFORE
    of = np.searchsorted(begin, yaw_t, side="right") - 1
    kept = np.isin(of, sure_steps(grid, traffic, 1, begin)) & np.isfinite(yaw)
    yaw_t, yaw, of = yaw_t[kept], yaw[kept], of[kept]
    if np.ptp(yaw) < WEAK:
        raise not_following(
            "yaw rate", "steering", float(np.ptp(yaw)), WEAK, "rad/s",
            "the wheels are off the ground, the servo does not move, or the gyro is stuck",
            "put the car on the floor; check the servo's plug (channel 0)")
    ends, widths = grid.pulses(traffic.written[:, 0], traffic.written[:, 1])
    turned = np.flatnonzero(np.abs(np.diff(widths, prepend=widths[0])) > 1.0)
    turned = turned[(turned > 0) & (ends[turned] > yaw_t[0])]
    turned = turned[np.isin(np.searchsorted(begin, ends[turned], side="right") - 1, of)]
    to, before = widths[turned], widths[turned - 1]
    knots = np.linspace(min(to.min(), before.min()), max(to.max(), before.max()), 200)
    return Turns(
        yaw_t, yaw, rolled(traffic, metres, edges_per_rev, yaw_t),
        np.arange(starts[0] - 1.0, yaw_t[-1] + DT, DT), ends[turned], before, to,
        (knots, np.array([linkage.map.angle(float(k)) for k in knots])),
        lru_cache(maxsize=8)(lambda grip: _tyres(linkage.vehicle, grip, speed)))


def _turning(found: Fit, shows: bool, turns: Turns, read: tuple[float, float]) -> Turning:
    """What the turns have in common, and their delay without the age of the samples.

    A slew that is too slow by 1 % makes half of the way longer by 0.5 ms, which the delay lacks.
    """
    own, n = found.x[4:], len(turns.at)
    delay, spread = without_age(own, turns.at)
    mean = np.append(np.zeros(4), np.full(n, 1.0 / n))
    slew = float(found.x[RATE])
    half_way = 0.5 * float(np.mean(np.abs(turns.to - turns.before))) / slew
    std = np.sqrt(mean @ found.covariance @ mean + spread**2 + read[1] ** 2
                  + (SLEW_STD * half_way) ** 2 + TYRES_LATE**2 + FILTER_STD**2)
    lag = (float(found.x[LAG]), float(np.hypot(found.std[LAG], LAG_STD)))
    return Turning((delay + read[0], float(std)), lag if shows else None,
                   (slew, float(np.hypot(found.std[RATE], SLEW_STD * slew))), found.left)


def rolled(traffic: Traffic, metres: float, edges_per_rev: int, t: FloatArray) -> FloatArray:
    """Speed [m/s] at t, over whole turns of the ring, whatever its spacing.

    Errors: CalibrationFailed where the ring hardly turned.
    """
    edge_t, ticks = traffic.edges
    if len(ticks) < TURNS * edges_per_rev:
        raise CalibrationFailed(
            "the encoder does not count what the car drives",
            found=f"{len(ticks)} edges in {np.ptp(traffic.column('t')):.0f} s",
            expected=f"more than {TURNS * edges_per_rev}", likely="unplugged half way",
            remedy="turn a wheel by hand and watch dart-hal doctor")
    place, per_turn = ticks * metres, edges_per_rev * metres
    behind = np.interp(place - 0.5 * per_turn, place, edge_t)
    ahead = np.interp(place + 0.5 * per_turn, place, edge_t)
    inside = slice(edges_per_rev, -edges_per_rev)
    return np.asarray(np.interp(t, edge_t[inside], (per_turn / (ahead - behind))[inside]))


def _share(t: FloatArray, at: FloatArray, before: FloatArray, to: FloatArray, p: FloatArray,
           curve: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Where the wheels are at t (n,), as a share 0..1 of the way between the two pulses.

    curve: pulses [us] and their angles [rad] by the map.
    The wheels lie at one flank of the slot after a turn, and wait for the other after the next.
    """
    step = np.maximum(np.searchsorted(at, t, side="right") - 1, 0)
    since = np.maximum(t - at[step], 0.0)
    way = np.abs(to - before)[step]
    lag = max(float(p[LAG]), 1e-6)
    gone = np.minimum(p[RATE] * since, -way * np.expm1(-since / lag))
    pulse = before[step] + np.sign(to - before)[step] * gone
    angle = np.interp(pulse, *curve)
    start, end = (np.interp(x, *curve)[step] for x in (before, to))
    up, half = np.sign(end - start), 0.5 * abs(p[PLAY])
    wheels = up * np.maximum(up * angle - half, up * start + half)
    low, high = float(np.min(wheels)), float(np.max(wheels))
    return np.asarray((np.tan(wheels) - np.tan(low)) / (np.tan(high) - np.tan(low)))


def _tyres(p: Vehicle, grip: float, speed: float) -> tuple[FloatArray, FloatArray]:
    """Yaw rate by road-wheel angle as a filter of gain 1 at rest, step ``DT``.

    Linear bicycle (``vehicle.bicycle``) with the tyres ``grip`` times as stiff.
    """
    from scipy.signal import cont2discrete, ss2tf

    body, front, rear = p.body, *(grip * c for c in stiffness(p))
    m, i, a, b = body.mass, body.yaw_inertia, body.l_f, body.l_r
    cross = b * rear - a * front
    matrix = np.array([[-(front + rear) / (m * speed), cross / (m * speed) - speed],
                       [cross / (i * speed), -(a * a * front + b * b * rear) / (i * speed)]])
    push = np.array([[front / m], [a * front / i]])
    gain = float((-np.linalg.solve(matrix, push))[1, 0])
    ad, bd, cd, dd, _ = cont2discrete((matrix, push, np.array([[0.0, 1.0 / gain]]),
                                       np.zeros((1, 1))), DT)
    top, bottom = ss2tf(ad, bd, cd, dd)
    return np.asarray(top[0]), np.asarray(bottom)


def stiffness(p: Vehicle) -> tuple[float, float]:
    """Cornering stiffness of front and rear axle [N/rad] at small angles."""
    tyres = p.tyres
    if isinstance(tyres, PaperTyres):
        return (tyres.front_D * tyres.front_C * tyres.front_B, tyres.rear_cornering_stiffness)
    return (p.body.front_load * tyres.front_D * tyres.front_C * tyres.front_B,
            p.body.rear_load * tyres.rear_D * tyres.rear_C * tyres.rear_B)
