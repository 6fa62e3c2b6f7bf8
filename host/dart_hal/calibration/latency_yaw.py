"""From a pulse of the servo to the road wheels, by the yaw rate: delay, lag and slew of the servo.

The car is steered in stairs of small steps, and back in one. A small step keeps the servo at its
slew for some 20 ms alone, and where it goes on in the direction of the step before, the wheels lie
at that flank of the backlash already: so the delay hangs on neither. The large steps show the
slew. After each turn

    omega = v (a + b f(t - delay)) + c        f: 0..1, see ``latency_turn``

has a, b and delay of its own, so neither map nor gyro scale need be exact; what f is made of is
common to all. When the IMU took each sample tell its looks (``estimation.imu_clock``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.estimation.imu_clock import PERIOD

from .latency_fit import Fit, Problem, fit_lag
from .latency_log import Traffic, not_following
from .latency_pulse import Grid
from .latency_turn import LAG, RATE, Answers, Kind, Linkage, answers_of, times
from .latency_wheel import FEWEST, JUMP_US, LONGEST_DELAY, LONGEST_LAG, sure_steps

SLEW = (3800.0, 1500.0)
"""us of pulse per s: 0.16 s for 60 degrees, as servos of this class state."""
NOISE = 0.003
"""rad/s: the gyro's 2.5e-4 rad/s/sqrt(Hz) at 100 Hz, and its step of 1/900."""
FILTER_STD = 0.0005
"""s, one sigma of the delay of 5 ms of the gyro's filter: 10 %."""
TYRES_LATE, TYRES_SLEW = 0.00035, 0.011
"""s, and relative: one sigma of what one stiffness for both axles leaves in the delay and in the
slew, where the stiffness of front and rear and the inertia are each known to 10 %. Each was changed
by so much in the fits of three hidden cars: 0.33 to 0.37 ms and 0.6 to 1.1 %, all three together.
The yaw rate is 4 to 7 ms behind the wheels at 0.5 m/s."""
HIDDEN_LAG, LAG_STD = 0.010, 0.003
"""s: a shorter lag shows nothing, for the slew holds the servo back all of a small step, 20 ms; and
one sigma of what map and tyres leave in a longer one."""
WEAK = 0.3
"""rad/s by which the yaw rate must change."""
TURNS = 20
"""Of the ring, at least; at 0.5 m/s it turns 12 times a second."""
RESTED = 0.05
"""s before the end of a pulse in which the turn before has come to rest."""
SMALL = 0.3
"""Of the largest turn; a smaller one is a step of the stairs."""
SAMPLES = 20
"""Of a turn, at least: 30 come while a small step is held."""
SOON = 1e-3
"""s before a write, where its turn begins: no other is so near."""


@dataclass(frozen=True, slots=True)
class Turning:
    """delay, lag [s], slew [us/s] of the servo, each with one sigma; rms left [rad/s].

    lag None: it is hidden behind the slew.
    """

    delay: tuple[float, float]
    lag: tuple[float, float] | None
    slew: tuple[float, float]
    left: float


def fit_yaw(grid: Grid, traffic: Traffic, linkage: Linkage, speed: float, metres: float,
            edges_per_rev: int) -> Turning:
    """speed [m/s] that was held.

    Errors: CalibrationFailed where the yaw rate does not follow the steering.
    """
    turns = _turns(grid, traffic, linkage, speed, metres, edges_per_rev)
    n = len(turns.kind)
    start, low, high, steps, known = (np.append(common, np.full(n, own)) for common, own in (
        ([0.005, SLEW[0], linkage.backlash[0], 1.0], 0.02),
        ([0.0, 500.0, 0.0, 0.3], -0.05), ([LONGEST_LAG, 3e4, 0.15, 3.0], LONGEST_DELAY),
        ([1e-3, 50.0, 1e-3, 0.02], 1e-3), ([np.inf, SLEW[1], linkage.backlash[1], linkage.tyres],
                                          np.inf)))
    found, shows = fit_lag(Problem(turns.residual, start, low, high, steps, known, NOISE), LAG,
                           HIDDEN_LAG)
    return _turning(found, shows, turns, traffic.read_after, linkage.shape)


@dataclass(frozen=True, slots=True)
class Turns:
    """t (k, m) [s] of samples after the end of the pulse of each turn, yaw (k, m) [rad/s], both 0
    where there are no more, ``there`` (k, m) is False; kind (k,) of kinds, answers: of each.

    told (k,): its frame is sure, and it is a step of the stairs; age_std [s]: of the samples.
    """

    t: FloatArray
    yaw: FloatArray
    there: BoolArray
    kind: IntArray
    kinds: tuple[Kind, ...]
    answers: Answers
    told: BoolArray
    age_std: float

    def residual(self, x: FloatArray) -> FloatArray:
        """What lag, slew, play, stiffness and the delays of all turns leave of ``yaw``."""
        lag, rate, play, grip = x[:4].tolist()
        answers, after = self.answers((lag, rate, play, grip)), times()
        shown = np.array([np.interp(t - own, after, answers[k], left=0.0) for t, own, k in zip(
            self.t, x[4:], self.kind, strict=True)])
        shown, yaw = self._centred(shown), self._centred(self.yaw)
        turned = np.sum(shown * yaw, axis=1) / (np.sum(shown * shown, axis=1) + 1e-9)
        return np.asarray((yaw - turned[:, None] * shown)[self.there])

    def _centred(self, rows: FloatArray) -> FloatArray:
        """Without the mean of each turn."""
        rows = np.where(self.there, rows, 0.0)
        mean = rows.sum(axis=1) / self.there.sum(axis=1)
        return np.where(self.there, rows - mean[:, None], 0.0)


def _turns(grid: Grid, traffic: Traffic, linkage: Linkage, speed: float, metres: float,
           edges_per_rev: int) -> Turns:
    """Steps of the stairs that go on in one direction, and large ones back.

    Errors: as ``fit_yaw``.
    """
    columns = np.array([traffic.column(name) for name in ("yaw_t", "yaw_rate", "age_std")])
    yaw_t, yaw, age_std = columns[:, np.isfinite(columns).all(axis=0)]
    if not len(yaw) or np.ptp(yaw) < WEAK:
        raise not_following(
            "yaw rate", "steering", float(np.ptp(yaw)) if len(yaw) else 0.0, WEAK, "rad/s",
            "the wheels are off the ground, the servo does not move, or the gyro is stuck",
            "put the car on the floor; check the servo's plug (channel 0)")
    ends, every, sure = _turned(grid, traffic)
    way = np.array([kind.to - kind.before for kind in every])
    small = np.abs(way) < SMALL * np.max(np.abs(way))
    wanted = np.flatnonzero(small != [kind.reverses for kind in every])[:-1]
    inside = {int(k): np.flatnonzero((yaw_t > ends[k] - RESTED) & (yaw_t < ends[k + 1]))
              for k in wanted}
    kept = [k for k, row in inside.items() if len(row) >= SAMPLES]
    rows, told = [inside[k] for k in kept], (small & sure)[kept]
    if np.sum(told) < FEWEST:
        raise CalibrationFailed(
            "the yaw rate is seldom there", found=f"{np.sum(told)} steps with all their samples",
            expected=f"at least {FEWEST} of {np.sum(small[wanted])}",
            likely="a loose wire to the IMU", remedy="dart-hal doctor")
    kinds = tuple(dict.fromkeys(every[k] for k in kept))
    longest = max(len(row) for row in rows)
    there = np.array([np.arange(longest) < len(row) for row in rows])
    index = np.array([np.pad(row, (0, longest - len(row))) for row in rows])
    steady = yaw * speed / rolled(traffic, metres, edges_per_rev, yaw_t)
    after = yaw_t[index] - ends[kept][:, None]
    return Turns(
        np.where(there, after, 0.0), np.where(there, steady[index], 0.0), there,
        np.array([kinds.index(every[k]) for k in kept]), kinds,
        answers_of(kinds, linkage, speed), told,
        float(np.mean(age_std[index[there]])))


def _turned(grid: Grid, traffic: Traffic) -> tuple[FloatArray, list[Kind], BoolArray]:
    """Ends [s] of the pulses (k,) that turn the servo, which turns, and whether their PWM frame is
    known; the first turn only tells a direction, and is left out."""
    written_t, written = traffic.written[:, 0], traffic.written[:, 1]
    ends, widths = grid.pulses(written_t, written)
    at, begin = (np.flatnonzero(np.abs(np.diff(w, prepend=w[0])) > JUMP_US)
                 for w in (widths, written))
    way = np.diff(widths)[at - 1]
    kinds = [Kind(round(float(widths[k - 1]), 1), round(float(widths[k]), 1), bool(back))
             for k, back in zip(at[1:], way[1:] * way[:-1] < 0.0, strict=True)]
    sure = np.isin(np.arange(len(begin)), sure_steps(grid, traffic, 1, written_t[begin] - SOON))
    return ends[at[1:]], kinds, sure[1:]


def _turning(found: Fit, shows: bool, turns: Turns, read: tuple[float, float],
             shape: float) -> Turning:
    """What the turns have in common; the delay by the stairs, less those of another PWM frame.

    A slew that is too slow by 1 % makes half of a step longer by 0.1 ms, which the delay lacks;
    for the tyres' part of the slew that is in TYRES_LATE.
    """
    own = found.x[4:]
    told = turns.told & (np.abs(own - np.median(own[turns.told])) < PERIOD)
    n = int(np.sum(told))
    mean = np.append(np.zeros(4), told / n)
    slew = float(found.x[RATE])
    half_way = 0.5 * float(np.mean([abs(turns.kinds[k].to - turns.kinds[k].before)
                                    for k in turns.kind[told]])) / slew
    std = np.sqrt(mean @ found.covariance @ mean + np.var(own[told]) / n + read[1] ** 2
                  + (shape * half_way) ** 2 + TYRES_LATE**2 + FILTER_STD**2 + turns.age_std**2)
    lag = (float(found.x[LAG]), float(np.hypot(found.std[LAG], LAG_STD)))
    return Turning((float(mean[4:] @ own) + read[0] - 0.5 * PERIOD, float(std)),
                   lag if shows else None,
                   (slew, math.hypot(found.std[RATE], shape * slew, TYRES_SLEW * slew)),
                   found.left)


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
