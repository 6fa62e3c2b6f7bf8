"""Delays and lags out of steps of the throttle and of the steering.

From a pulse of the ESC to the force of the wheels (``fit_wheel``): the car is pulled in steps of
the throttle x. Its motion is

    v' = A T(y) + B T(y) v + C + D v + E v^2 + F v^4        y' = (x(t - delay) - y) / lag

T is the motor's dead band, which ends at g; E and F are what the tyres take in a bend:
slip angles go with v^2, and the yaw rate times v_y with v^4 by them. Integrated twice it is
linear in everything but delay, lag and g, so these are all that is searched (variable projection;
G. Golub and V. Pereyra, 1973). Each step has a start and a speed of its own. The data are where the
ring's edges were, and the ring's own unevenness is fitted with them, one number for each edge of a
revolution.

From a pulse of the servo to the road wheels (``fit_yaw``), by the yaw rate: the car is steered in
stairs of small steps, and back in one. A small step keeps the servo at its slew for some 20 ms
alone, and where it goes on in the direction of the step before, the wheels lie at that flank of the
backlash already: so the delay hangs on neither. The large steps show the slew. After each turn

    omega = v (a + b f(t - delay)) + c        f: 0..1, see ``answers_of``

has a, b and delay of its own, so neither map nor gyro scale need be exact; what f is made of is
common to all. The servo turns at its slew at most and with its lag; the wheels follow the linkage,
behind its backlash where the turn before went the other way; the yaw rate follows the wheels as the
tyres do (linear bicycle), and the gyro shows it through its filter. When the IMU took each sample
tell its looks (``estimation.imu_clock``).

Both are least squares with what was known of some parameters before (``fit``). What a model leaves
of one step is one error, not a hundred: samples of one repetition hang together. Where repetitions
are told the covariance is the sandwich over them (``fitting.covariance``), else every sample is by
itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from dart_hal.core.config import CarFiles
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.devices.actuation.steering_map import SteeringMap, steering_map
from dart_hal.estimation.imu_clock import PERIOD
from dart_hal.vehicle.fitting.covariance import block_covariance, plain_covariance
from dart_hal.vehicle.fitting.least_squares import Solution, least_squares
from dart_hal.vehicle.load import vehicle_of
from dart_hal.vehicle.motor import make_dead_band
from dart_hal.vehicle.parameters import PaperTyres, Vehicle

from .latency_log import Grid, Traffic, not_following

Residual = Callable[[FloatArray], FloatArray]
DT = 1e-3
"""s of the grid on which a step is integrated."""
BEFORE = 0.15
"""s of the step before that belong to a repetition."""
LONGEST_DELAY, LONGEST_LAG = 0.4, 0.5
"""s; cars answer within 0.2."""
DEAD_BAND = (-0.15, 0.03)
"""g of published cars and one sigma of it, with a neutral that nobody has measured."""
EDGE_NOISE = 3e-5
"""m, of an edge's place, once the ring's unevenness is known."""
JUMP_US, FEWEST = 15.0, 6
"""us that are a step and no rounding; repetitions from which a spread can be told."""
HIDDEN_MOTOR_LAG, MODEL_STD = 0.010, 0.001
"""s: a shorter lag cannot be told from a delay, and is counted as such; and one sigma of what the
car does in a bend beyond the model."""
MIN_SPEED_CHANGE = 0.05
"""m/s by which each step must change the speed."""
ANSWER_STEP, ANSWER_SPAN = 0.5e-3, 0.8
"""s of the grid of an answer, and how long it is: longer than a turn is held."""
BACKLASH = (0.02, 0.012)
"""rad, and one sigma, of a linkage that nobody has measured: 0.3 to 2 degrees."""
TYRES_STD = 0.15
"""Relative, one sigma of the tyres' stiffness by a model of another car; 0.1 by its own."""
SHAPE, SHAPE_OTHERS = 0.005, 0.035
"""Relative, one sigma that the shape of a map leaves in the slew: of the car's own (fits with the
true maps of four hidden cars differ by 0.46 % rms); and of cars of its kind, of gains and ends
within 8 %."""
GYRO_HZ = 32.0
"""Hz of the BNO055's filter as the firmware sets it."""
KNOTS = 200
"""Of the steering map between the two ends of the turns."""
LAG, RATE, PLAY, GRIP = range(4)
SLEW = (3800.0, 1500.0)
"""us of pulse per s: 0.16 s for 60 degrees, as servos of this class state."""
YAW_NOISE = 0.003
"""rad/s: the gyro's 2.5e-4 rad/s/sqrt(Hz) at 100 Hz, and its step of 1/900."""
FILTER_STD = 0.0005
"""s, one sigma of the delay of 5 ms of the gyro's filter: 10 %."""
TYRES_LATE, TYRES_SLEW = 0.00035, 0.011
"""s, and relative: one sigma of what one stiffness for both axles leaves in the delay and in the
slew, where the stiffness of front and rear and the inertia are each known to 10 %. Each was changed
by so much in the fits of three hidden cars: 0.33 to 0.37 ms and 0.6 to 1.1 %, all three together.
The yaw rate is 4 to 7 ms behind the wheels at 0.5 m/s."""
HIDDEN_SERVO_LAG, LAG_STD = 0.010, 0.003
"""s: a shorter lag shows nothing, for the slew holds the servo back all of a small step, 20 ms; and
one sigma of what map and tyres leave in a longer one."""
MIN_YAW_RATE_CHANGE = 0.3
"""rad/s by which the yaw rate must change."""
MIN_RING_TURNS = 20
"""Of the ring, at least; at 0.5 m/s it turns 12 times a second."""
RESTED = 0.05
"""s before the end of a pulse in which the turn before has come to rest."""
SMALL = 0.3
"""Of the largest turn; a smaller one is a step of the stairs."""
MIN_SAMPLES = 20
"""Of a turn, at least: 30 come while a small step is held."""
SOON = 1e-3
"""s before a write, where its turn begins: no other is so near."""


@dataclass(frozen=True, slots=True)
class Problem:
    """residual(x) (m,) of parameters x (n,) between low and high, by ``steps`` (n,).

    known (n,): one sigma with which a parameter was known to be ``start``, inf = it was not.
    noise: of a residual. cluster (m,): to which repetition it belongs, None: they are independent.
    """

    residual: Residual
    start: FloatArray
    low: FloatArray
    high: FloatArray
    steps: FloatArray
    known: FloatArray
    noise: float
    cluster: IntArray | None = None


@dataclass(frozen=True, slots=True)
class Fit:
    """Parameters (n,), covariance (n, n), 0 for one that was held, and rms of what is left."""

    x: FloatArray
    covariance: FloatArray
    left: float

    @property
    def std(self) -> FloatArray:
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def fit(p: Problem, held: int | None = None) -> Fit:
    """The parameters; ``held``: one of them stays 0.

    What was known is fitted in units of its sigma, for which ``block_covariance`` has a prior.
    """
    free = np.arange(len(p.start)) != (-1 if held is None else held)
    of = np.isfinite(p.known)
    unit = np.where(of, p.known, p.steps)
    weight = np.where(of, p.noise, 0.0)[free]

    def x_of(z: FloatArray) -> FloatArray:
        x = np.where(free, p.start, 0.0)
        x[free] += z * unit[free]
        return x

    def residual(z: FloatArray) -> FloatArray:
        return np.concatenate([p.residual(x_of(z)), weight * z])

    def slopes(z: FloatArray) -> FloatArray:
        return np.column_stack([_slope(residual, z, k, step)
                                for k, step in enumerate((p.steps / unit)[free])])

    low, high = (((end - p.start) / unit)[free] for end in (p.low, p.high))
    found = least_squares(residual, [0.0] * len(weight), (low, high), jacobian=slopes,
                          tolerance=1e-8)
    rows = len(found.residual) - len(weight)
    data = Solution(found.x, found.residual[:rows], found.jacobian[:rows], found.weight[:rows],
                    found.converged, found.at_bound)
    covariance = np.zeros((len(free), len(free)))
    covariance[np.ix_(free, free)] = np.outer(unit[free], unit[free]) * (
        plain_covariance(found) if p.cluster is None
        else block_covariance(data, p.cluster, weight**2))
    return Fit(x_of(found.x), covariance, data.rmse)


def fit_lag(p: Problem, lag: int, least: float) -> tuple[Fit, bool]:
    """(the parameters, whether the one of that index showed); below ``least`` it counts as 0."""
    found = fit(p)
    shows = bool(found.x[lag] >= least)
    return (found if shows else fit(p, held=lag)), shows


def _slope(residual: Residual, x: FloatArray, k: int, step: float) -> FloatArray:
    """d residual / d x[k] by central differences, also at a bound."""
    up, down = x.copy(), x.copy()
    up[k], down[k] = x[k] + step, x[k] - step
    return (residual(up) - residual(down)) / (2.0 * step)


@dataclass(frozen=True, slots=True)
class Pull:
    """delay and lag [s] of the force, each with one sigma; rms left of the edges' places [m]."""

    delay: tuple[float, float]
    lag: tuple[float, float]
    left: float


@dataclass(frozen=True, slots=True)
class Steps:
    """t (m,) [s] and place (m,) [m] of edges, their place in the ring, and their repetition."""

    t: FloatArray
    place: FloatArray
    ring: IntArray
    cluster: IntArray
    starts: FloatArray
    ends: FloatArray


def fit_wheel(grid: Grid, traffic: Traffic, starts: FloatArray, throttle: tuple[float, float],
              metres: float, edges_per_rev: int) -> Pull:
    """throttle: neutral and span [us]; starts (k,) [s]: when each repetition was begun; metres [m]
    per edge.

    Errors: CalibrationFailed where the speed does not follow the throttle.
    """
    steps = _steps(grid, traffic, starts, metres, edges_per_rev)
    t = np.arange(steps.t[0] - 1.0, steps.t[-1] + DT, DT)
    x = (held(grid, traffic, t) - throttle[0]) / throttle[1]
    motion = Motion.of(steps, t, x, edges_per_rev)
    _check_follows(steps, motion.speed, t)
    found, shows = fit_lag(Problem(
        motion.residual, start=np.array([0.01, 0.03, DEAD_BAND[0]]),
        low=np.array([-0.05, 0.0, -0.3]), high=np.array([LONGEST_DELAY, LONGEST_LAG, -0.02]),
        steps=np.full(3, 1e-3), known=np.array([np.inf, np.inf, DEAD_BAND[1]]), noise=EDGE_NOISE,
        cluster=steps.cluster), lag=1, least=HIDDEN_MOTOR_LAG)
    delay, lag = ((float(found.x[k]), float(np.hypot(found.std[k], MODEL_STD))) for k in range(2))
    return Pull(delay, lag if shows else (0.0, 0.5 * HIDDEN_MOTOR_LAG), found.left)


@dataclass(frozen=True, slots=True)
class Motion:
    """Steps on a grid t (n,) [s]: throttle x (n,), speed (n,) [m/s]; where each step begins on it.

    fixed (m, k): orthonormal, what the places of the edges owe to everything but the motor;
    left (m,): what that leaves of them.
    """

    steps: Steps
    t: FloatArray
    x: FloatArray
    speed: FloatArray
    begin: IntArray
    fixed: FloatArray
    left: FloatArray

    @classmethod
    def of(cls, steps: Steps, t: FloatArray, x: FloatArray, edges_per_rev: int) -> Motion:
        speed = np.gradient(np.interp(t, *_smooth(steps, edges_per_rev)), DT)
        bare = cls(steps, t, x, speed, np.searchsorted(t, steps.starts), np.zeros((0, 0)),
                   np.zeros(0))
        fixed, _ = np.linalg.qr(bare._owed(edges_per_rev))
        return replace(bare, fixed=fixed, left=steps.place - fixed @ (fixed.T @ steps.place))

    def residual(self, p: FloatArray) -> FloatArray:
        """What delay, lag [s] and dead band p (3,) leave of the places [m]."""
        z = make_dead_band(float(p[2]), np)(self._pulled(float(p[0]), abs(float(p[1]))))
        moved = np.column_stack([self._twice(z), self._twice(z * self.speed)])
        moved -= self.fixed @ (self.fixed.T @ moved)
        best, *_ = np.linalg.lstsq(moved, self.left, rcond=None)
        return np.asarray(self.left - moved @ best)

    def _owed(self, edges_per_rev: int) -> FloatArray:
        """Columns: start and speed of each step, each mark of the ring, C, D v, E v^2, F v^4."""
        s, since = self.steps, self._since
        own = np.zeros((len(s.t), 2 * len(self.begin)))
        own[np.arange(len(s.t)), 2 * s.cluster] = 1.0
        own[np.arange(len(s.t)), 2 * s.cluster + 1] = since
        ring = np.eye(edges_per_rev)[s.ring][:, 1:]
        place, b = np.interp(self.t, s.t, s.place), self.begin[s.cluster]
        path = _integral(place)
        along = np.interp(s.t, self.t, path) - path[b] - place[b] * since
        bend = [self._twice(self.speed**power) for power in (2, 4)]
        return np.column_stack([own, ring, 0.5 * since**2, along, *bend])

    @property
    def _since(self) -> FloatArray:
        return np.asarray(self.steps.t - self.t[self.begin][self.steps.cluster])

    def _pulled(self, delay: float, lag: float) -> FloatArray:
        """y of the grid."""
        from scipy.signal import lfilter

        share = -np.expm1(-DT / lag) if lag > 1e-4 else 1.0
        y = lfilter([share], [1.0, share - 1.0], self.x, zi=[(1.0 - share) * self.x[0]])[0]
        return np.asarray(np.interp(self.t - delay, self.t, y))

    def _twice(self, f: FloatArray) -> FloatArray:
        """Integral of the integral at the edges, from each repetition's start."""
        once, b = _integral(f), self.begin[self.steps.cluster]
        both = _integral(once)
        return np.asarray(np.interp(self.steps.t, self.t, both) - both[b] - once[b] * self._since)


def held(grid: Grid, traffic: Traffic, t: FloatArray) -> FloatArray:
    """The pulse [us] that the ESC knew, on the mean of the ``DT`` around each t (n,) [s].

    A pulse that ends between two points of the grid counts for its share.
    """
    ends, widths = grid.pulses(traffic.written[:, 0], traffic.written[:, 2])
    past = np.concatenate([[0.0], np.cumsum(widths[:-1] * np.diff(ends))])
    borders = np.append(t - 0.5 * DT, t[-1] + 0.5 * DT)
    last = np.maximum(np.searchsorted(ends, borders, side="right") - 1, 0)
    return np.asarray(np.diff(past[last] + widths[last] * (borders - ends[last])) / DT)


def _integral(f: FloatArray) -> FloatArray:
    """Of f on the grid, from its first point."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (f[1:] + f[:-1])) * DT])


def sure_steps(grid: Grid, traffic: Traffic, column: int, begin: FloatArray) -> IntArray:
    """Those repetitions in which it is known which PWM frame carried each step.

    Errors: CalibrationFailed if there are too few.
    """
    t, width = traffic.written[:, 0], traffic.written[:, column]
    jumps = np.abs(np.diff(width, prepend=width[0])) > JUMP_US
    near = t[np.logical_and(jumps, grid.doubtful(t))]
    unsure = np.unique(np.searchsorted(begin, near, side="right") - 1)
    sure = np.setdiff1d(np.arange(len(begin) - 1), unsure)
    if len(sure) < FEWEST:
        raise CalibrationFailed(
            "the commands came together with the PWM frames", found=f"{len(sure)} clear steps",
            expected=f"at least {FEWEST} of {len(begin) - 1}",
            likely="frames of the Nano and of the PCA9685 run in step at the moment",
            remedy="run it again")
    return sure


def _steps(grid: Grid, traffic: Traffic, starts: FloatArray, metres: float, edges_per_rev: int
           ) -> Steps:
    """Edges of whole repetitions, each seen once."""
    edge_t, ticks = traffic.edges
    begin = starts - BEFORE
    of = np.searchsorted(begin, edge_t, side="right") - 1
    kept = (of >= 0) & (of < len(starts) - 1) & np.isin(of, sure_steps(grid, traffic, 2, begin))
    cluster = np.unique(of[kept], return_inverse=True)
    return Steps(edge_t[kept], (ticks[kept] - ticks[kept][0]) * metres,
                 ticks[kept].astype(np.int64) % edges_per_rev, cluster[1], begin[cluster[0]],
                 begin[cluster[0] + 1])


def _smooth(steps: Steps, edges_per_rev: int) -> tuple[FloatArray, FloatArray]:
    """Places (t, s) half a revolution apart: a speed without the ring, good enough for B y v."""
    places = np.arange(0.0, steps.place[-1], 0.5 * edges_per_rev * float(
        np.min(np.diff(np.unique(steps.place)))))
    return np.interp(places, steps.place, steps.t), places


def _check_follows(steps: Steps, speed: FloatArray, t: FloatArray) -> None:
    spans = [np.ptp(speed[(t > a) & (t < b)]) for a, b in zip(
        steps.starts, steps.ends, strict=True)]
    if np.median(spans) < MIN_SPEED_CHANGE:
        raise not_following(
            "speed", "throttle", float(np.median(spans)), MIN_SPEED_CHANGE, "m/s",
            "the wheels are held, the battery is empty, or the ESC limits its power",
            "free the wheels, charge the battery, run it again")


@dataclass(frozen=True, slots=True)
class Linkage:
    """What is known of the steering: map, backlash and tyres, each with one sigma.

    shape: that of the map, relative, as it stands in the slew.
    """

    map: SteeringMap
    shape: float
    backlash: tuple[float, float]
    vehicle: Vehicle
    tyres: float


def linkage_of(files: CarFiles) -> Linkage:
    """By the car's own files, else by those of cars of its kind."""
    measured = files.calibration.steering if files.calibration else None
    play = measured.backlash if measured else None
    own = measured.map if measured else None
    return Linkage(steering_map(files.config, own), SHAPE_OTHERS if own is None else SHAPE,
                   BACKLASH if play is None else (play.value, max(play.std, 1e-3)),
                   vehicle_of(files.model), TYRES_STD)


class Kind(NamedTuple):
    """A turn between two pulses [us]; reverses: the turn before went the other way."""

    before: float
    to: float
    reverses: bool


Answers = Callable[[tuple[float, float, float, float]], FloatArray]
"""(lag [s], slew [us/s], play [rad], stiffness) -> (k, n), see ``answers_of``."""


def answers_of(kinds: tuple[Kind, ...], linkage: Linkage, speed: float) -> Answers:
    """What the gyro shows of each kind of turn (k, n) at ``times()``: shares 0..1 of its change.

    speed [m/s]. The newest are remembered.
    """
    ends = [pulse for kind in kinds for pulse in kind[:2]]
    knots = np.linspace(min(ends), max(ends), KNOTS)
    curve = knots, np.array([linkage.map.angle(float(knot)) for knot in knots])
    tyres = lru_cache(maxsize=8)(lambda grip: _tyres(linkage.vehicle, grip, speed))

    @lru_cache(maxsize=8)
    def answers(p: tuple[float, float, float, float]) -> FloatArray:
        from scipy.signal import lfilter

        b, a = tyres(max(p[GRIP], 0.1))
        seen = -np.expm1(-2.0 * np.pi * GYRO_HZ * ANSWER_STEP)
        share = np.array([_share(kind, p, curve) for kind in kinds])
        return np.asarray(lfilter([seen], [1.0, seen - 1.0], lfilter(b, a, share)))

    return answers


def times() -> FloatArray:
    """Times [s] after the servo began to turn (n,)."""
    return np.arange(0.0, ANSWER_SPAN, ANSWER_STEP)


def _share(kind: Kind, p: tuple[float, float, float, float], curve: tuple[FloatArray, FloatArray]
           ) -> FloatArray:
    """Where the wheels are at ``times()``, as a share 0..1 of the curvature's change.

    curve: pulses [us] and their angles [rad] by the map. The wheels lie at one flank of the slot,
    and wait for the other where the turn reverses.
    """
    since, way = times(), abs(kind.to - kind.before)
    gone = np.minimum(p[RATE] * since, -way * np.expm1(-since / max(p[LAG], 1e-6)))
    turned = kind.before + np.sign(kind.to - kind.before) * gone
    angle = np.interp(turned, *curve)
    start, end = (float(np.interp(x, *curve)) for x in (kind.before, kind.to))
    up, half = np.sign(end - start), 0.5 * abs(p[PLAY])
    held = up * start + (half if kind.reverses else -half)
    way_of = np.tan(np.maximum(up * angle - half, held)) - np.tan(held)
    return np.asarray(way_of / (np.tan(up * end - half) - np.tan(held)))


def _tyres(p: Vehicle, grip: float, speed: float) -> tuple[FloatArray, FloatArray]:
    """Yaw rate by road-wheel angle as a filter of gain 1 at rest, step ``ANSWER_STEP``.

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
                                       np.zeros((1, 1))), ANSWER_STEP)
    top, bottom = ss2tf(ad, bd, cd, dd)
    return np.asarray(top[0]), np.asarray(bottom)


def stiffness(p: Vehicle) -> tuple[float, float]:
    """Cornering stiffness of front and rear axle [N/rad] at small angles."""
    tyres = p.tyres
    if isinstance(tyres, PaperTyres):
        return (tyres.front_D * tyres.front_C * tyres.front_B, tyres.rear_cornering_stiffness)
    return (p.body.front_load * tyres.front_D * tyres.front_C * tyres.front_B,
            p.body.rear_load * tyres.rear_D * tyres.rear_C * tyres.rear_B)


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
    found, shows = fit_lag(Problem(turns.residual, start, low, high, steps, known, YAW_NOISE), LAG,
                           HIDDEN_SERVO_LAG)
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
    if not len(yaw) or np.ptp(yaw) < MIN_YAW_RATE_CHANGE:
        raise not_following(
            "yaw rate", "steering", float(np.ptp(yaw)) if len(yaw) else 0.0, MIN_YAW_RATE_CHANGE,
            "rad/s",
            "the wheels are off the ground, the servo does not move, or the gyro is stuck",
            "put the car on the floor; check the servo's plug (channel 0)")
    ends, every, sure = _turned(grid, traffic)
    way = np.array([kind.to - kind.before for kind in every])
    small = np.abs(way) < SMALL * np.max(np.abs(way))
    wanted = np.flatnonzero(small != [kind.reverses for kind in every])[:-1]
    inside = {int(k): np.flatnonzero((yaw_t > ends[k] - RESTED) & (yaw_t < ends[k + 1]))
              for k in wanted}
    kept = [k for k, row in inside.items() if len(row) >= MIN_SAMPLES]
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
    if len(ticks) < MIN_RING_TURNS * edges_per_rev:
        raise CalibrationFailed(
            "the encoder does not count what the car drives",
            found=f"{len(ticks)} edges in {np.ptp(traffic.column('t')):.0f} s",
            expected=f"more than {MIN_RING_TURNS * edges_per_rev}", likely="unplugged half way",
            remedy="turn a wheel by hand and watch dart-hal doctor")
    place, per_turn = ticks * metres, edges_per_rev * metres
    behind = np.interp(place - 0.5 * per_turn, place, edge_t)
    ahead = np.interp(place + 0.5 * per_turn, place, edge_t)
    inside = slice(edges_per_rev, -edges_per_rev)
    return np.asarray(np.interp(t, edge_t[inside], (per_turn / (ahead - behind))[inside]))
