"""Fit delays and lags to steps of the throttle and of the steering.

**From a pulse of the ESC to the force of the wheels** (``fit_wheel``). The car drives with steps of
the throttle x. Its motion is

    v' = A T(y) + B T(y) v + C + D v + E v^2 + F v^4        y' = (x(t - delay) - y) / lag

T is the dead band of the motor, which ends at g. E and F are what the tyres take in a bend: slip
angles grow with v^2, and the yaw rate times v_y with v^4. Integrated twice, the equation is linear
in everything but delay, lag and g, so only these three are searched (variable projection, G. Golub
and V. Pereyra, 1973). Each step has its own start and speed. The data are the places at which the
ring had its edges; its unevenness is fitted too, one number for each edge of a revolution.

**From a pulse of the servo to the road wheels** (``fit_yaw``), by the yaw rate. The steering moves
in stairs of small steps, and back in one large step. During a small step the servo is at its slew
limit for only some 20 ms. If it continues in the direction of the previous step, the wheels are at
that flank of the backlash already. So its delay depends on neither of them. The large steps show
the slew rate. After each turn

    omega = v (a + b f(t - delay)) + c        f: 0..1, see ``make_responses``

has its own a, b and delay, so neither map nor gyro scale has to be exact. All turns share the
parameters of f: the servo turns at its slew rate at most, and with its lag; the wheels follow the
linkage, delayed by the backlash where the direction reverses; the yaw rate follows the wheels by
the linear bicycle with its tyres; the gyro shows it through its filter. When the IMU took each
sample is known from its register reads (``estimation.imu_clock``).

Both are least-squares problems with priors (``fit_problem``). The residuals within one repetition
are correlated. Where the repetition of each residual is known, the covariance is the sandwich over
repetitions (``fitting.covariance``); otherwise every sample counts on its own.
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
from dart_hal.core.types import INTERVAL_90, BoolArray, FloatArray, IntArray
from dart_hal.devices.actuation.steering_map import SteeringMap, steering_map
from dart_hal.estimation.imu_clock import PERIOD
from dart_hal.vehicle.fitting.covariance import block_covariance, plain_covariance
from dart_hal.vehicle.fitting.least_squares import Solution, least_squares
from dart_hal.vehicle.load import vehicle_of
from dart_hal.vehicle.motor import make_dead_band
from dart_hal.vehicle.parameters import PaperTyres, Vehicle

from .latency_log import PwmGrid, Traffic, no_response
from .measured import FitGraph

Residual = Callable[[FloatArray], FloatArray]
# s, step of the grid on which the motion is integrated.
GRID_STEP = 1e-3
# s of the previous step that belong to a repetition.
LEAD_TIME = 0.15
# s, bounds of the search; cars answer within 0.2.
MAX_ACTUATOR_DELAY = 0.4
MAX_ACTUATOR_LAG = 0.5
# g of published cars and its one sigma, for a neutral that was never measured.
DEAD_BAND_PRIOR = (-0.15, 0.03)
# m, one sigma of the place of an edge, once the unevenness of the ring is known.
EDGE_PLACE_STD = 3e-5
# us, smallest change of a pulse that is a step and not rounding.
MIN_STEP_US = 15.0
# Fewest repetitions whose spread gives a standard error.
MIN_REPETITIONS = 6
# s. A shorter lag of the motor cannot be separated from a delay, and counts as delay.
MIN_MOTOR_LAG = 0.010
# s, one sigma of the motion in a bend that the model lacks.
WHEEL_MODEL_STD = 0.001
# m/s by which each step has to change the speed.
MIN_SPEED_CHANGE = 0.05
# s, step and duration of a response: longer than a steering pulse is constant.
RESPONSE_STEP = 0.5e-3
RESPONSE_SPAN = 0.8
# rad, value and one sigma for a linkage that was never measured: 0.3 to 2 degrees.
DEFAULT_BACKLASH = (0.02, 0.012)
# Relative, one sigma of the tyre stiffness from the model of another car; 0.1 from its own.
TYRE_STIFFNESS_STD = 0.15
# Relative, one sigma of the slew rate by the shape of the steering map. Of the car's own map: fits
# with the true maps of four hidden cars differ by 0.46 % rms. Of a typical map: gains and ends
# within 8 %.
OWN_MAP_SHAPE_STD = 0.005
TYPICAL_MAP_SHAPE_STD = 0.035
# Hz of the filter of the BNO055, as the firmware sets it.
GYRO_FILTER_HZ = 32.0
# Points of the curve in a picture: more would not look smoother.
GRAPH_POINTS = 60
# Points of the steering map between the two ends of the turns.
MAP_KNOTS = 200
# Indices of the shared parameters: lag [s], slew rate [us/s], backlash [rad], tyre stiffness.
I_LAG, I_RATE, I_PLAY, I_GRIP = range(4)
# us of pulse per s, value and one sigma: 0.16 s for 60 degrees, as servos of this class state.
SLEW_PRIOR = (3800.0, 1500.0)
# rad/s: the gyro's 2.5e-4 rad/s/sqrt(Hz) at 100 Hz, and its resolution of 1/900.
YAW_RATE_STD = 0.003
# s, one sigma of the 5 ms delay of the gyro's filter: 10 %.
GYRO_FILTER_DELAY_STD = 0.0005
# s, and relative: one sigma of delay and slew rate because one stiffness stands for both axles.
# Front stiffness, rear stiffness and inertia are each known to 10 %. In the fits of three hidden
# cars each was changed by that: 0.33 to 0.37 ms and 0.6 to 1.1 %, all three together. The yaw rate
# is 4 to 7 ms behind the wheels at 0.5 m/s.
TYRE_DELAY_STD = 0.00035
TYRE_SLEW_STD = 0.011
# s. A shorter lag of the servo has no effect, because its slew rate limits all of a small step.
MIN_SERVO_LAG = 0.010
# s, one sigma of a longer lag by errors of map and tyres.
SERVO_LAG_STD = 0.003
# rad/s by which the yaw rate has to change.
MIN_YAW_RATE_CHANGE = 0.3
# Turns of the ring, at least; at 0.5 m/s it turns 12 times per second.
MIN_RING_TURNS = 20
# s before the end of a pulse in which the previous turn has come to rest.
REST_BEFORE_TURN = 0.05
# Share of the largest turn below which a turn is a step of the stairs.
MAX_SMALL_STEP = 0.3
# Samples of a turn, at least: a small step has 30.
MIN_TURN_SAMPLES = 20
# s before a write at which its turn begins: no other write is that close.
WRITE_LEAD = 1e-3


@dataclass(frozen=True, slots=True)
class DelayProblem:
    """Least-squares problem residual(x) (m,) of parameters x (n,) between low and high.

    steps (n,): for numerical derivatives. known (n,): one sigma of the prior, whose mean is
    ``start``; inf = no prior. noise: one sigma of a residual. cluster (m,): repetition of each
    residual; None: residuals are independent.
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
class DelayFit:
    """Parameters x (n,), covariance (n, n), 0 for a fixed one, and rms of the residuals."""

    x: FloatArray
    covariance: FloatArray
    rms: float

    @property
    def std(self) -> FloatArray:
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def fit_problem(p: DelayProblem, fixed: int | None = None) -> DelayFit:
    """Minimise a problem; ``fixed``: index of a parameter that stays 0.

    Parameters with a prior are scaled by its sigma, as ``block_covariance`` expects.
    """
    free = np.arange(len(p.start)) != (-1 if fixed is None else fixed)
    has_prior = np.isfinite(p.known)
    unit = np.where(has_prior, p.known, p.steps)
    weight = np.where(has_prior, p.noise, 0.0)[free]

    def unscale(z: FloatArray) -> FloatArray:
        x = np.where(free, p.start, 0.0)
        x[free] += z * unit[free]
        return x

    def residual(z: FloatArray) -> FloatArray:
        return np.concatenate([p.residual(unscale(z)), weight * z])

    def slopes(z: FloatArray) -> FloatArray:
        return np.column_stack([_slope(residual, z, k, step)
                                for k, step in enumerate((p.steps / unit)[free])])

    low, high = (((end - p.start) / unit)[free] for end in (p.low, p.high))
    found = least_squares(residual, [0.0] * len(weight), (low, high), jacobian=slopes,
                          tolerance=1e-8)
    # The rows of the priors are not data: the sandwich gets them as ``weight**2``.
    rows = len(found.residual) - len(weight)
    data = Solution(found.x, found.residual[:rows], found.jacobian[:rows], found.weight[:rows],
                    found.converged, found.at_bound)
    covariance = np.zeros((len(free), len(free)))
    covariance[np.ix_(free, free)] = np.outer(unit[free], unit[free]) * (
        plain_covariance(found) if p.cluster is None
        else block_covariance(data, p.cluster, weight**2))
    return DelayFit(unscale(found.x), covariance, data.rmse)


def fit_lag(p: DelayProblem, index: int, min_lag: float) -> tuple[DelayFit, bool]:
    """Return (fit, whether parameter ``index`` is at least ``min_lag``); otherwise it is 0."""
    found = fit_problem(p)
    visible = bool(found.x[index] >= min_lag)
    return (found if visible else fit_problem(p, fixed=index)), visible


def _slope(residual: Residual, x: FloatArray, k: int, step: float) -> FloatArray:
    """d residual / d x[k] by central differences, also at a bound."""
    up = x.copy()
    down = x.copy()
    up[k] = x[k] + step
    down[k] = x[k] - step
    return (residual(up) - residual(down)) / (2.0 * step)


@dataclass(frozen=True, slots=True)
class WheelDelay:
    """delay, lag [s] of the force, each with one sigma; rms [m] of the places of the edges."""

    delay: tuple[float, float]
    lag: tuple[float, float]
    rms: float


@dataclass(frozen=True, slots=True)
class EdgeSteps:
    """Edges of the ring during the steps of the throttle.

    t (m,) [s], place (m,) [m], ring (m,): index in the ring, cluster (m,): repetition.
    starts, ends (k,) [s]: of each repetition.
    """

    t: FloatArray
    place: FloatArray
    ring: IntArray
    cluster: IntArray
    starts: FloatArray
    ends: FloatArray


def fit_wheel(grid: PwmGrid, traffic: Traffic, starts: FloatArray, throttle: tuple[float, float],
              metres: float, edges_per_rev: int) -> WheelDelay:
    """Fit delay and lag from throttle pulses to the force of the wheels.

    starts (k,) [s]: start of each repetition. throttle: neutral and span [us]. metres [m] per edge.
    Raises CalibrationFailed if the speed does not follow the throttle.
    """
    steps = _find_edges(grid, traffic, starts, metres, edges_per_rev)
    t = np.arange(steps.t[0] - 1.0, steps.t[-1] + GRID_STEP, GRID_STEP)
    x = (mean_pulse(grid, traffic, t) - throttle[0]) / throttle[1]
    motion = SteppedMotion.prepare(steps, t, x, edges_per_rev)
    _check_speed_changes(steps, motion.speed, t)
    found, visible = fit_lag(DelayProblem(
        motion.residual, start=np.array([0.01, 0.03, DEAD_BAND_PRIOR[0]]),
        low=np.array([-0.05, 0.0, -0.3]),
        high=np.array([MAX_ACTUATOR_DELAY, MAX_ACTUATOR_LAG, -0.02]), steps=np.full(3, 1e-3),
        known=np.array([np.inf, np.inf, DEAD_BAND_PRIOR[1]]), noise=EDGE_PLACE_STD,
        cluster=steps.cluster), index=1, min_lag=MIN_MOTOR_LAG)
    delay, lag = ((float(found.x[k]), float(np.hypot(found.std[k], WHEEL_MODEL_STD)))
                  for k in range(2))
    return WheelDelay(delay, lag if visible else (0.0, 0.5 * MIN_MOTOR_LAG), found.rms)


@dataclass(frozen=True, slots=True)
class SteppedMotion:
    """Throttle x (n,) and speed (n,) [m/s] on a grid t (n,) [s]; begin: index of each step.

    nuisance (m, k): orthonormal columns of all linear terms without the motor; remaining (m,): the
    places of the edges without them.
    """

    steps: EdgeSteps
    t: FloatArray
    x: FloatArray
    speed: FloatArray
    begin: IntArray
    nuisance: FloatArray
    remaining: FloatArray

    @classmethod
    def prepare(cls, steps: EdgeSteps, t: FloatArray, x: FloatArray, edges_per_rev: int
                ) -> SteppedMotion:
        """Project the linear terms that do not depend on delay, lag and dead band out once."""
        speed = np.gradient(np.interp(t, *_smooth_places(steps, edges_per_rev)), GRID_STEP)
        bare = cls(steps, t, x, speed, np.searchsorted(t, steps.starts), np.zeros((0, 0)),
                   np.zeros(0))
        nuisance, _ = np.linalg.qr(bare._nuisance_columns(edges_per_rev))
        remaining = steps.place - nuisance @ (nuisance.T @ steps.place)
        return replace(bare, nuisance=nuisance, remaining=remaining)

    def residual(self, p: FloatArray) -> FloatArray:
        """Residuals of the places [m] for delay, lag [s] and dead band p (3,).

        The factors A and B of the pull are eliminated by linear least squares.
        """
        throttle = self._lagged_throttle(float(p[0]), abs(float(p[1])))
        z = make_dead_band(float(p[2]), np)(throttle)
        moved = np.column_stack([self._double_integral(z), self._double_integral(z * self.speed)])
        moved -= self.nuisance @ (self.nuisance.T @ moved)
        best, *_ = np.linalg.lstsq(moved, self.remaining, rcond=None)
        return np.asarray(self.remaining - moved @ best)

    def _nuisance_columns(self, edges_per_rev: int) -> FloatArray:
        """Columns: start and speed of each step, each mark of the ring, C, D v, E v^2, F v^4."""
        s = self.steps
        since = self._since_start
        own = np.zeros((len(s.t), 2 * len(self.begin)))
        own[np.arange(len(s.t)), 2 * s.cluster] = 1.0
        own[np.arange(len(s.t)), 2 * s.cluster + 1] = since
        ring = np.eye(edges_per_rev)[s.ring][:, 1:]
        place = np.interp(self.t, s.t, s.place)
        b = self.begin[s.cluster]
        path = _integral(place)
        # v integrated twice is the integral of the place.
        drag = np.interp(s.t, self.t, path) - path[b] - place[b] * since
        bend = [self._double_integral(self.speed**power) for power in (2, 4)]
        return np.column_stack([own, ring, 0.5 * since**2, drag, *bend])

    @property
    def _since_start(self) -> FloatArray:
        return np.asarray(self.steps.t - self.t[self.begin][self.steps.cluster])

    def _lagged_throttle(self, delay: float, lag: float) -> FloatArray:
        """y on the grid: the throttle after first-order lag and delay [s]."""
        from scipy.signal import lfilter

        share = -np.expm1(-GRID_STEP / lag) if lag > 1e-4 else 1.0
        y = lfilter([share], [1.0, share - 1.0], self.x, zi=[(1.0 - share) * self.x[0]])[0]
        return np.asarray(np.interp(self.t - delay, self.t, y))

    def _double_integral(self, f: FloatArray) -> FloatArray:
        """Integral of the integral of f at the edges, from the start of each repetition."""
        once = _integral(f)
        b = self.begin[self.steps.cluster]
        twice = _integral(once)
        return np.asarray(np.interp(self.steps.t, self.t, twice) - twice[b]
                          - once[b] * self._since_start)


def mean_pulse(grid: PwmGrid, traffic: Traffic, t: FloatArray) -> FloatArray:
    """Throttle pulse [us] that the ESC has received, averaged over ``GRID_STEP`` around t (n,) [s].

    A pulse that ends between two points of the grid counts by its share.
    """
    ends, widths = grid.pulses(traffic.written[:, 0], traffic.written[:, 2])
    past = np.concatenate([[0.0], np.cumsum(widths[:-1] * np.diff(ends))])
    borders = np.append(t - 0.5 * GRID_STEP, t[-1] + 0.5 * GRID_STEP)
    last = np.maximum(np.searchsorted(ends, borders, side="right") - 1, 0)
    return np.asarray(np.diff(past[last] + widths[last] * (borders - ends[last])) / GRID_STEP)


def _integral(f: FloatArray) -> FloatArray:
    """Cumulative integral of f on the grid (trapezoidal rule)."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (f[1:] + f[:-1])) * GRID_STEP])


def unambiguous_steps(grid: PwmGrid, traffic: Traffic, column: int, begin: FloatArray) -> IntArray:
    """Indices of the repetitions in which the PWM frame of each step is known.

    column: of ``traffic.written``; begin (k,) [s]: of the repetitions.
    Raises CalibrationFailed if there are too few.
    """
    t = traffic.written[:, 0]
    width = traffic.written[:, column]
    jumps = np.abs(np.diff(width, prepend=width[0])) > MIN_STEP_US
    ambiguous_t = t[np.logical_and(jumps, grid.is_ambiguous(t))]
    ambiguous = np.unique(np.searchsorted(begin, ambiguous_t, side="right") - 1)
    clear = np.setdiff1d(np.arange(len(begin) - 1), ambiguous)
    if len(clear) < MIN_REPETITIONS:
        raise CalibrationFailed(
            "most commands coincided with the start of a PWM frame",
            found=f"{len(clear)} steps with a known frame",
            expected=f"at least {MIN_REPETITIONS} of {len(begin) - 1}",
            likely="the clocks of the Nano and of the PCA9685 are in step at the moment",
            remedy="run it again")
    return clear


def _find_edges(grid: PwmGrid, traffic: Traffic, starts: FloatArray, metres: float,
                edges_per_rev: int) -> EdgeSteps:
    """Collect the edges of whole repetitions, each edge once."""
    edge_t, ticks = traffic.edges
    begin = starts - LEAD_TIME
    repetition = np.searchsorted(begin, edge_t, side="right") - 1
    clear = unambiguous_steps(grid, traffic, 2, begin)
    use = (repetition >= 0) & (repetition < len(starts) - 1) & np.isin(repetition, clear)
    cluster = np.unique(repetition[use], return_inverse=True)
    return EdgeSteps(edge_t[use], (ticks[use] - ticks[use][0]) * metres,
                     ticks[use].astype(np.int64) % edges_per_rev, cluster[1], begin[cluster[0]],
                     begin[cluster[0] + 1])


def _smooth_places(steps: EdgeSteps, edges_per_rev: int) -> tuple[FloatArray, FloatArray]:
    """(t, place) every half revolution: speed without the ring, accurate enough for B y v."""
    places = np.arange(0.0, steps.place[-1], 0.5 * edges_per_rev * float(
        np.min(np.diff(np.unique(steps.place)))))
    return np.interp(places, steps.place, steps.t), places


def _check_speed_changes(steps: EdgeSteps, speed: FloatArray, t: FloatArray) -> None:
    spans = [np.ptp(speed[(t > a) & (t < b)]) for a, b in zip(
        steps.starts, steps.ends, strict=True)]
    if np.median(spans) < MIN_SPEED_CHANGE:
        raise no_response(
            "speed", "throttle", float(np.median(spans)), MIN_SPEED_CHANGE, "m/s",
            "the wheels are blocked, the battery is empty, or the ESC limits its power",
            "free the wheels, charge the battery, run it again")


@dataclass(frozen=True, slots=True)
class Linkage:
    """Prior knowledge of the steering: map, backlash [rad] and tyres, each with one sigma.

    shape: relative, one sigma of the slew rate by the shape of the map. tyres: relative, one sigma
    of their stiffness.
    """

    map: SteeringMap
    shape: float
    backlash: tuple[float, float]
    vehicle: Vehicle
    tyres: float


def load_linkage(files: CarFiles) -> Linkage:
    """Return the linkage from the car's own files, or else the values of a typical car."""
    measured = files.calibration.steering if files.calibration else None
    play = measured.backlash if measured else None
    own = measured.map if measured else None
    return Linkage(steering_map(files.config, own),
                   TYPICAL_MAP_SHAPE_STD if own is None else OWN_MAP_SHAPE_STD,
                   DEFAULT_BACKLASH if play is None else (play.value, max(play.std, 1e-3)),
                   vehicle_of(files.model), TYRE_STIFFNESS_STD)


class TurnKind(NamedTuple):
    """A turn from one pulse [us] to another; reverses: the previous turn had the other sign."""

    start: float
    end: float
    reverses: bool


Responses = Callable[[tuple[float, float, float, float]], FloatArray]
"""(lag [s], slew rate [us/s], backlash [rad], stiffness) -> (k, n), see ``make_responses``."""


def make_responses(kinds: tuple[TurnKind, ...], linkage: Linkage, speed: float) -> Responses:
    """Make the function f: response of the gyro to each kind of turn, as a share 0..1.

    Its result has a row for each kind and a column for each of ``response_times()``. speed [m/s].
    The latest results are cached, because numerical derivatives repeat them.
    """
    ends = [pulse for kind in kinds for pulse in kind[:2]]
    knots = np.linspace(min(ends), max(ends), MAP_KNOTS)
    curve = knots, np.array([linkage.map.angle(float(knot)) for knot in knots])
    tyres = lru_cache(maxsize=8)(lambda grip: _yaw_filter(linkage.vehicle, grip, speed))

    @lru_cache(maxsize=8)
    def responses(p: tuple[float, float, float, float]) -> FloatArray:
        from scipy.signal import lfilter

        # Servo and linkage, then the vehicle, then the low-pass filter of the gyro.
        share = np.array([_wheel_share(kind, p, curve) for kind in kinds])
        b, a = tyres(max(p[I_GRIP], 0.1))
        low_pass = -np.expm1(-2.0 * np.pi * GYRO_FILTER_HZ * RESPONSE_STEP)
        return np.asarray(lfilter([low_pass], [1.0, low_pass - 1.0], lfilter(b, a, share)))

    return responses


def response_times() -> FloatArray:
    """Times [s] after the servo began to turn (n,)."""
    return np.arange(0.0, RESPONSE_SPAN, RESPONSE_STEP)


def _wheel_share(kind: TurnKind, p: tuple[float, float, float, float],
                 curve: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Position of the wheels at ``response_times()``, as a share 0..1 of the curvature's change.

    curve: pulses [us] and their angles [rad] by the map.

    1. The servo moves at its slew rate or with its lag, whichever is slower.
    2. The map converts its position to an angle.
    3. The wheels are at one flank of the backlash and wait for the other if the turn reverses.
    """
    since = response_times()
    distance = abs(kind.end - kind.start)
    moved = np.minimum(p[I_RATE] * since, -distance * np.expm1(-since / max(p[I_LAG], 1e-6)))
    servo = kind.start + np.sign(kind.end - kind.start) * moved
    angle = np.interp(servo, *curve)
    start, end = (float(np.interp(x, *curve)) for x in (kind.start, kind.end))
    sign = np.sign(end - start)
    half = 0.5 * abs(p[I_PLAY])
    wheels = sign * start + (half if kind.reverses else -half)
    turned = np.tan(np.maximum(sign * angle - half, wheels)) - np.tan(wheels)
    return np.asarray(turned / (np.tan(sign * end - half) - np.tan(wheels)))


def _yaw_filter(p: Vehicle, grip: float, speed: float) -> tuple[FloatArray, FloatArray]:
    """Filter (b, a) from road-wheel angle to yaw rate, with gain 1 and step ``RESPONSE_STEP``.

    Linear bicycle (``vehicle.bicycle``) with tyres that are ``grip`` times as stiff. States: v_y
    and yaw rate. speed [m/s].
    """
    from scipy.signal import cont2discrete, ss2tf

    body, front, rear = p.body, *(grip * c for c in stiffness(p))
    m, i, a, b = body.mass, body.yaw_inertia, body.l_f, body.l_r
    cross = b * rear - a * front
    matrix = np.array([[-(front + rear) / (m * speed), cross / (m * speed) - speed],
                       [cross / (i * speed), -(a * a * front + b * b * rear) / (i * speed)]])
    force = np.array([[front / m], [a * front / i]])
    gain = float((-np.linalg.solve(matrix, force))[1, 0])
    ad, bd, cd, dd, _ = cont2discrete((matrix, force, np.array([[0.0, 1.0 / gain]]),
                                       np.zeros((1, 1))), RESPONSE_STEP)
    numerator, denominator = ss2tf(ad, bd, cd, dd)
    return np.asarray(numerator[0]), np.asarray(denominator)


def stiffness(p: Vehicle) -> tuple[float, float]:
    """Cornering stiffness of front and rear axle [N/rad] at small angles."""
    tyres = p.tyres
    if isinstance(tyres, PaperTyres):
        return (tyres.front_D * tyres.front_C * tyres.front_B, tyres.rear_cornering_stiffness)
    return (p.body.front_load * tyres.front_D * tyres.front_C * tyres.front_B,
            p.body.rear_load * tyres.rear_D * tyres.rear_C * tyres.rear_B)


@dataclass(frozen=True, slots=True)
class YawDelay:
    """delay, lag [s], slew rate [us/s] of the servo, each with one sigma; rms [rad/s].

    lag None: too small to be separated from the slew rate. graph: the small steps.
    """

    delay: tuple[float, float]
    lag: tuple[float, float] | None
    slew: tuple[float, float]
    rms: float
    graph: FitGraph | None = None


def fit_yaw(grid: PwmGrid, traffic: Traffic, linkage: Linkage, speed: float, metres: float,
            edges_per_rev: int) -> YawDelay:
    """Fit delay, lag and slew rate of the servo to the yaw rate. speed [m/s]; metres [m] per edge.

    Raises CalibrationFailed if the yaw rate does not follow the steering.
    """
    turns = _collect_turns(grid, traffic, linkage, speed, metres, edges_per_rev)
    n = len(turns.kind)
    # Four parameters are shared by all turns, and each turn has its own delay.
    start, low, high, steps, known = (np.append(common, np.full(n, own)) for common, own in (
        ([0.005, SLEW_PRIOR[0], linkage.backlash[0], 1.0], 0.02),
        ([0.0, 500.0, 0.0, 0.3], -0.05),
        ([MAX_ACTUATOR_LAG, 3e4, 0.15, 3.0], MAX_ACTUATOR_DELAY),
        ([1e-3, 50.0, 1e-3, 0.02], 1e-3),
        ([np.inf, SLEW_PRIOR[1], linkage.backlash[1], linkage.tyres], np.inf)))
    found, visible = fit_lag(DelayProblem(turns.residual, start, low, high, steps, known,
                                          YAW_RATE_STD), I_LAG, MIN_SERVO_LAG)
    return _combine_turns(found, visible, turns, traffic.read_delay, linkage.shape)


@dataclass(frozen=True, slots=True)
class TurnSamples:
    """Samples of the gyro after the end of the first pulse of each turn.

    t (k, m) [s] since then, yaw (k, m) [rad/s], both 0 where ``valid`` (k, m) is False.
    kind (k,): index of ``kinds``; responses: of each kind. for_delay (k,): a step of the stairs
    whose PWM frame is known. age_std [s]: one sigma of the age of the samples.
    """

    t: FloatArray
    yaw: FloatArray
    valid: BoolArray
    kind: IntArray
    kinds: tuple[TurnKind, ...]
    responses: Responses
    for_delay: BoolArray
    age_std: float

    def residual(self, x: FloatArray) -> FloatArray:
        """Residuals of ``yaw`` for lag, slew rate, backlash, stiffness and the delay of each turn.

        Offset a + c and size b of each turn are eliminated by linear least squares.
        """
        model = self._subtract_means(self._model(x))
        yaw = self._subtract_means(self.yaw)
        size = np.sum(model * yaw, axis=1) / (np.sum(model * model, axis=1) + 1e-9)
        return np.asarray((yaw - size[:, None] * model)[self.valid])

    def _responses(self, x: FloatArray) -> FloatArray:
        """Response of each kind for the shared parameters, see ``make_responses``."""
        lag, rate, play, grip = x[:4].tolist()
        return self.responses((lag, rate, play, grip))

    def _model(self, x: FloatArray) -> FloatArray:
        """Responses (k, m), each 0 to 1."""
        responses = self._responses(x)
        after = response_times()
        return np.array([np.interp(t - own, after, responses[k], left=0.0)
                         for t, own, k in zip(self.t, x[4:], self.kind, strict=True)])

    def graph(self, x: FloatArray, use: BoolArray, std: float) -> FitGraph:
        """Return the samples of the turns ``use`` (k,) as shares of their change, and the fit.

        std [s]: of the delay, which moves the whole curve.
        """
        model = self._model(x)
        centred = self._subtract_means(model)
        yaw = self._subtract_means(self.yaw)
        size = np.sum(centred * yaw, axis=1) / (np.sum(centred * centred, axis=1) + 1e-9)
        # Remove the offset of each turn, so that all go from 0 to 1.
        means = np.sum(np.where(self.valid, model, 0.0), axis=1) / self.valid.sum(axis=1)
        share = yaw / size[:, None] + means[:, None]
        shown = self.valid & use[:, None]
        t = np.linspace(0.0, float(self.t[shown].max()), GRAPH_POINTS)
        mean = self._responses(x)[np.unique(self.kind[use])].mean(axis=0)
        fit = np.interp(t - float(x[4:][use].mean()), response_times(), mean, left=0.0)
        return FitGraph("Yaw rate after each small step of the steering", "after the pulse [ms]",
                        "share of its change", 1e3 * self.t[shown], share[shown], 1e3 * t, fit,
                        INTERVAL_90 * std * np.gradient(fit, t), "samples of the gyro")

    def _subtract_means(self, rows: FloatArray) -> FloatArray:
        """Subtract the mean of each turn; invalid samples become 0."""
        rows = np.where(self.valid, rows, 0.0)
        mean = rows.sum(axis=1) / self.valid.sum(axis=1)
        return np.where(self.valid, rows - mean[:, None], 0.0)


def _collect_turns(grid: PwmGrid, traffic: Traffic, linkage: Linkage, speed: float, metres: float,
                   edges_per_rev: int) -> TurnSamples:
    """Collect small steps that continue in one direction, and large steps that reverse.

    Raises as ``fit_yaw``.
    """
    columns = np.array([traffic.column(name) for name in ("yaw_t", "yaw_rate", "age_std")])
    yaw_t, yaw, age_std = columns[:, np.isfinite(columns).all(axis=0)]
    if not len(yaw) or np.ptp(yaw) < MIN_YAW_RATE_CHANGE:
        raise no_response(
            "yaw rate", "steering", float(np.ptp(yaw)) if len(yaw) else 0.0, MIN_YAW_RATE_CHANGE,
            "rad/s",
            "the wheels are off the ground, the servo does not move, or the gyro is stuck",
            "put the car on the floor; check the servo's plug (channel 0)")
    ends, every_kind, clear = _find_turns(grid, traffic)
    change = np.array([kind.end - kind.start for kind in every_kind])
    small = np.abs(change) < MAX_SMALL_STEP * np.max(np.abs(change))
    candidates = np.flatnonzero(small != [kind.reverses for kind in every_kind])[:-1]
    inside = {int(k): np.flatnonzero((yaw_t > ends[k] - REST_BEFORE_TURN) & (yaw_t < ends[k + 1]))
              for k in candidates}
    used = [k for k, row in inside.items() if len(row) >= MIN_TURN_SAMPLES]
    rows = [inside[k] for k in used]
    for_delay = (small & clear)[used]
    if np.sum(for_delay) < MIN_REPETITIONS:
        raise CalibrationFailed(
            "many yaw rates are missing",
            found=f"{np.sum(for_delay)} steps with all their samples",
            expected=f"at least {MIN_REPETITIONS} of {np.sum(small[candidates])}",
            likely="a loose wire to the IMU", remedy="dart-hal doctor")
    kinds = tuple(dict.fromkeys(every_kind[k] for k in used))
    longest = max(len(row) for row in rows)
    valid = np.array([np.arange(longest) < len(row) for row in rows])
    index = np.array([np.pad(row, (0, longest - len(row))) for row in rows])
    # The yaw rate at the nominal speed: small changes of speed drop out.
    steady = yaw * speed / ring_speed(traffic, metres, edges_per_rev, yaw_t)
    after = yaw_t[index] - ends[used][:, None]
    return TurnSamples(
        np.where(valid, after, 0.0), np.where(valid, steady[index], 0.0), valid,
        np.array([kinds.index(every_kind[k]) for k in used]), kinds,
        make_responses(kinds, linkage, speed), for_delay,
        float(np.mean(age_std[index[valid]])))


def _find_turns(grid: PwmGrid, traffic: Traffic) -> tuple[FloatArray, list[TurnKind], BoolArray]:
    """Return (ends of the first pulses (k,) [s], kinds, whether the PWM frame is known (k,)).

    The first turn only gives a direction and is omitted.
    """
    written_t = traffic.written[:, 0]
    written = traffic.written[:, 1]
    ends, widths = grid.pulses(written_t, written)
    turn_at, begin = (np.flatnonzero(np.abs(np.diff(w, prepend=w[0])) > MIN_STEP_US)
                      for w in (widths, written))
    change = np.diff(widths)[turn_at - 1]
    kinds = [TurnKind(round(float(widths[k - 1]), 1), round(float(widths[k]), 1), bool(reverses))
             for k, reverses in zip(turn_at[1:], change[1:] * change[:-1] < 0.0, strict=True)]
    clear = np.isin(np.arange(len(begin)),
                    unambiguous_steps(grid, traffic, 1, written_t[begin] - WRITE_LEAD))
    return ends[turn_at[1:]], kinds, clear[1:]


def _combine_turns(found: DelayFit, visible: bool, turns: TurnSamples, read: tuple[float, float],
                   shape: float) -> YawDelay:
    """Combine the turns: delay from the steps of the stairs, lag and slew rate from all.

    read: delay of a read of the gyro and its one sigma [s]. Steps that landed in another PWM frame
    are excluded. A slew rate that is too slow by 1 % makes half of a step longer by 0.1 ms, which
    the delay lacks; TYRE_DELAY_STD contains that for the tyres' part of the slew rate.
    """
    own = found.x[4:]
    use = turns.for_delay & (np.abs(own - np.median(own[turns.for_delay])) < PERIOD)
    n = int(np.sum(use))
    mean = np.append(np.zeros(4), use / n)
    slew = float(found.x[I_RATE])
    half_step = 0.5 * float(np.mean([abs(turns.kinds[k].end - turns.kinds[k].start)
                                     for k in turns.kind[use]])) / slew
    std = np.sqrt(mean @ found.covariance @ mean + np.var(own[use]) / n + read[1] ** 2
                  + (shape * half_step) ** 2 + TYRE_DELAY_STD**2 + GYRO_FILTER_DELAY_STD**2
                  + turns.age_std**2)
    lag = (float(found.x[I_LAG]), float(np.hypot(found.std[I_LAG], SERVO_LAG_STD)))
    return YawDelay((float(mean[4:] @ own) + read[0] - 0.5 * PERIOD, float(std)),
                    lag if visible else None,
                    (slew, math.hypot(found.std[I_RATE], shape * slew, TYRE_SLEW_STD * slew)),
                    found.rms, turns.graph(found.x, use, float(std)))


def ring_speed(traffic: Traffic, metres: float, edges_per_rev: int, t: FloatArray) -> FloatArray:
    """Speed [m/s] at t, over whole turns of the ring, so that its spacing has no effect.

    Raises CalibrationFailed if the ring hardly turned.
    """
    edge_t, ticks = traffic.edges
    if len(ticks) < MIN_RING_TURNS * edges_per_rev:
        raise CalibrationFailed(
            "the encoder does not count although the car drives",
            found=f"{len(ticks)} edges in {np.ptp(traffic.column('t')):.0f} s",
            expected=f"more than {MIN_RING_TURNS * edges_per_rev} edges",
            likely="unplugged during the drive",
            remedy="turn a wheel by hand and watch dart-hal doctor")
    place = ticks * metres
    per_turn = edges_per_rev * metres
    previous = np.interp(place - 0.5 * per_turn, place, edge_t)
    following = np.interp(place + 0.5 * per_turn, place, edge_t)
    inside = slice(edges_per_rev, -edges_per_rev)
    return np.asarray(np.interp(t, edge_t[inside],
                                (per_turn / (following - previous))[inside]))
