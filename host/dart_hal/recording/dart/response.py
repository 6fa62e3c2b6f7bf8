"""Response of a car to its commands, compared between recordings: are they of one car?

Responses that are measured in each recording, by the poses, and by encoder and gyro:

- steering: the curvature of the path by command, with little lateral acceleration a. At the
  command u it is f(u) - K b a; b: its mean slope; K: understeer, as a command per m/s2.
- throttle: the duty that holds a speed straight on. With dv/dt it is f(v) + c dv/dt.
- encoder: its speed over that of the poses.

f is piecewise linear between nodes. Two recordings i, j of one car have

    f_i - f_j = g (f_i + f_j) / 2 + b t + errors

t: difference of the trim, of steering or of throttle (b = 1). Trim and understeer change with
linkage, ESC and floor, and have priors. g: relative difference of the gain, which is judged. Its
drift from day to day is a part of its standard error.

Sampling, noise, and the place of the markers are no evidence: they change with the recorder.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from statistics import NormalDist

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from dart_hal.core.errors import RecordingError
from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.vehicle.delay import low_pass

from .marker import marker_grid
from .model import Recording
from .sensors import MAX_MESSAGE_GAP

STEP = 0.05  # s between samples
MIN_SAMPLES = 40  # 2 s
BLOCK_TIME = 1.0  # s; samples within it count as one
# Lowest speeds [m/s] of a car of 1:10; a slower encoder counts too few edges.
MIN_SPEED = 0.2
MIN_ENCODER_SPEED = 0.5
MIN_COMMAND = 0.15  # below, the trim decides
MAX_GENTLE_ACCELERATION = 1.2  # m/s2: a sixth of the grip, or a third on a slippery floor
MAX_SIDE_SLIP = 0.15  # lateral over forward speed of the rear axle; beyond, the car slides
# Steady driving: range of the steering command within a time [s], and of the speed, relative.
MAX_COMMAND_RANGE = 0.3
COMMAND_TIME = 0.3
MAX_SPEED_RANGE = 0.1
SPEED_TIME = 1.0
# Straight driving at a speed: limits of steering command, dv/dt [m/s2], and throttle, relative.
MAX_STRAIGHT_COMMAND = 0.35
MAX_HELD_ACCELERATION = 1.0
MAX_THROTTLE_RANGE = 0.1
THROTTLE_TIME = 0.5
# Delays in samples, and time constants [s], from a command to the turn that are tried.
DELAYS = (0, 1, 2, 3, 4)
LAGS = (0.0, 0.05, 0.1, 0.2)
# Steering commands of the nodes, and their priors: mean slope times the command, with a deviation
# that is constant (a command) and one that is relative.
NODE_STEP = 0.25
NODES = np.arange(-1.0, 1.01, NODE_STEP)
NODE_TRIM = 0.1
NODE_DEVIATION = 0.5
# Width of the prior of the mean slope, relative: hardly any.
SLOPE_WIDTH = 3.0
# Speeds of the nodes of the throttle [m/s], of a car of 1:10; width of its prior; c [s2/m], for
# which a second of pull gives 1 m/s per tenth of the throttle.
SPEED_NODE_STEP = 0.5
SPEED_NODES = np.arange(0.0, 5.01, SPEED_NODE_STEP)
THROTTLE_WIDTH = 1.0
THROTTLE_SLOPE = 0.1
# Share of the turns, those that need the least grip, that gives the slope.
GENTLE_SHARE = 0.2
MIN_CURVE_SCATTER = 0.03  # of the curvature as a command, and of the throttle
MIN_RELATIVE_ERROR = 0.03  # of a node or of a mean: two drives are not exactly the same
ROBUST_STEPS = 4
MAX_HUBER = 2.0  # standard deviations with full weight
# Standard deviations between days. The published car: 0.035 of the curvature at full lock, 0.06 of
# a command in the trim, 0.03 in that of the throttle, 0.015 of the encoder by the poses. The
# encoder by itself had another scale in another month.
GAIN_DRIFT = {"steering_poses": 0.04, "steering_sensors": 0.1, "throttle_poses": 0.12,
              "throttle_sensors": 0.15, "encoder": 0.02}
TRIM_DRIFT = {"steering": 0.06, "throttle": 0.04}
UNDERSTEER_DRIFT = 0.03  # s2/m
# Two cars: probability, for each kind of response, of a difference in any pair of recordings of one
# car, and the least difference.
FALSE_ALARM = 1e-4
MIN_DIFFERENCE = 0.2
MAX_MEAN_DIFFERENCE = 1.98  # over the mean: one response is 200 times the other
RESPONSES = {
    "steering_poses": "curvature of the path (poses) at the same steering command",
    "steering_sensors": "curvature of the path (encoder and gyro) at the same steering command",
    "throttle_poses": "throttle at the same speed (poses)",
    "throttle_sensors": "throttle at the same speed (encoder)",
    "encoder": "speed of the encoder over that of the poses"}


@dataclass(frozen=True, slots=True)
class ResponseCurve:
    """Normal equations of f in one recording: values at its nodes (k,), and one more.

    slope: the effect b of a trim of 1. information (k + 1, k + 1) and vector (k + 1,): of the
    values. center, width (k + 1,): mean and standard deviations of their prior.
    """

    slope: float
    information: FloatArray
    vector: FloatArray
    center: FloatArray
    width: FloatArray


@dataclass(frozen=True, slots=True)
class Response:
    """Response in one recording. curves: by key of RESPONSES, as far as they are measured.

    encoder: (speed of the encoder over that of the poses, standard error); None: not measured.
    """

    name: str
    curves: Mapping[str, ResponseCurve]
    encoder: tuple[float, float] | None


@dataclass(frozen=True, slots=True)
class CarDifference:
    """Two groups of recordings with different responses.

    kind: key of RESPONSES. size: relative, second group over first one. error: of the size, with
    the drift of one car. significance: in standard errors. Recordings that cannot be compared are
    in no group.
    """

    kind: str
    size: float
    error: float
    significance: float
    first: tuple[str, ...]
    second: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class MotionSamples:
    """Motion and commands every STEP, (n,) each: s, m/s, rad/s, -1..1; good: may be used."""

    t: FloatArray
    speed: FloatArray
    rate: FloatArray
    throttle: FloatArray
    steering: FloatArray
    encoder: FloatArray
    good: BoolArray


def measure_response(recording: Recording) -> Response:
    """Measure the response of the car in one recording."""
    scale = recording.scale.speed
    poses = _sample_poses(recording)
    curves: dict[str, ResponseCurve | None] = {}
    for name, samples in (("poses", poses), ("sensors", _sample_sensors(recording))):
        if samples is not None:
            curves[f"steering_{name}"] = _fit_steering(samples, MIN_SPEED * scale)
        # The throttle of a speed loop is the speed.
        if samples is not None and recording.drive == "duty":
            curves[f"throttle_{name}"] = _fit_throttle(samples, scale)
    encoder = None if poses is None else _measure_encoder(poses, MIN_ENCODER_SPEED * scale)
    return Response(recording.name, {k: c for k, c in curves.items() if c is not None}, encoder)


def compare_responses(responses: Sequence[Response]) -> CarDifference | None:
    """Find the most significant difference that recordings of one car do not have, or None."""
    found = [d for kind in RESPONSES if (d := _find_groups(responses, kind)) is not None]
    return max(found, key=lambda d: d.significance, default=None)


def compare_pair(first: Response, second: Response, kind: str) -> tuple[float, float] | None:
    """Return the difference of two gains over their mean and its error, None if not measured."""
    if kind != "encoder":
        a = first.curves.get(kind)
        b = second.curves.get(kind)
        return None if a is None or b is None else _fit_gain(a, b, kind)
    if first.encoder is None or second.encoder is None:
        return None
    one, one_error = first.encoder
    other, other_error = second.encoder
    return 2.0 * (one - other) / (one + other), math.hypot(
        one_error / one, other_error / other, math.sqrt(2.0) * GAIN_DRIFT[kind])


def _find_groups(responses: Sequence[Response], kind: str) -> CarDifference | None:
    """Find two groups of recordings by one kind of response.

    1. The two recordings with the most significant difference found the groups.
    2. Each other one joins the group whose founder it differs less from.
    """
    pairs: dict[tuple[int, int], tuple[float, float]] = {}
    for i, j in combinations(range(len(responses)), 2):
        found = compare_pair(responses[i], responses[j], kind)
        if found is not None:
            pairs[i, j] = found
    if not pairs:
        return None
    one, other = max(pairs, key=lambda pair: abs(pairs[pair][0]) / pairs[pair][1])
    size, error = pairs[one, other]
    # Any of the pairs may differ by chance (Bonferroni).
    limit = -NormalDist().inv_cdf(0.5 * FALSE_ALARM / len(pairs)) * error
    if abs(size) < max(limit, MIN_DIFFERENCE):
        return None
    groups: dict[int, list[str]] = {one: [responses[one].name], other: [responses[other].name]}
    for k in range(len(responses)):
        of_k = {founder: pairs[min(founder, k), max(founder, k)] for founder in groups
                if (min(founder, k), max(founder, k)) in pairs}
        if k in groups or len(of_k) < len(groups):
            continue
        groups[min(of_k, key=lambda founder: abs(of_k[founder][0]))].append(responses[k].name)
    # From the difference over the mean to the ratio (2 - d) / (2 + d) and its error.
    d = min(max(size, -MAX_MEAN_DIFFERENCE), MAX_MEAN_DIFFERENCE)
    ratio = (2.0 - d) / (2.0 + d)
    return CarDifference(kind, ratio - 1.0, 4.0 * error / (2.0 + d)**2, abs(size) / error,
                         tuple(groups[one]), tuple(groups[other]))


def _fit_gain(one: ResponseCurve, other: ResponseCurve, kind: str) -> tuple[float, float]:
    """Fit g and t by least squares; return g and its standard error, with the drift."""
    trim = TRIM_DRIFT[kind.partition("_")[0]]
    # One prior for both: where a recording has no data, it gives no difference.
    center = 0.5 * (one.center + other.center)
    prior = (0.5 * (one.width + other.width))**-2.0
    (a, a_covariance), (b, b_covariance) = (
        _solve(curve.information, curve.vector, center, prior) for curve in (one, other))
    mean = 0.5 * (a + b)[:-1]
    own = np.diag((MIN_RELATIVE_ERROR * mean)**2)
    information = np.linalg.inv((a_covariance + b_covariance)[:-1, :-1] + 2.0 * own)
    x = np.column_stack([mean, np.full(len(mean), 0.5 * (one.slope + other.slope))])
    weighted = x.T @ information
    covariance = np.linalg.inv(weighted @ x + np.diag([0.0, 0.5 / trim**2]))
    values = covariance @ (weighted @ (a - b)[:-1])
    return float(values[0]), math.sqrt(float(covariance[0, 0]) + 2.0 * GAIN_DRIFT[kind]**2)


def _fit_steering(s: MotionSamples, min_speed: float) -> ResponseCurve | None:
    """Fit the curvature at the nodes; None: too few gentle turns, or to the wrong side."""
    use = s.good & (s.speed > min_speed) & (s.throttle >= 0.0)
    if use.sum() < MIN_SAMPLES:
        return None
    # 1. The command as the wheels follow it.
    curvature = s.rate / np.maximum(s.speed, min_speed)
    steering = _filter_command(s.steering, curvature, use)
    # 2. The command that drives straight on, and the slope where the tyres hold best.
    _, zero_command = _fit_line(steering[use], curvature[use])
    turn = use & (np.abs(steering - zero_command) > MIN_COMMAND)
    if turn.sum() < MIN_SAMPLES:
        return None
    demand = np.abs(steering[turn] - zero_command) * s.speed[turn]**2
    gentle = demand <= np.quantile(demand, max(GENTLE_SHARE, MIN_SAMPLES / len(demand)))
    slope, zero_command = _fit_line(steering[turn][gentle], curvature[turn][gentle])
    if slope <= 0.0:
        return None
    # 3. Gentle driving by the slope. Selected by the measured acceleration, samples that turn less
    #    than others at the same command would remain.
    acceleration = slope * (steering - zero_command) * s.speed**2
    use &= np.abs(acceleration) < MAX_GENTLE_ACCELERATION
    use &= _range(steering, COMMAND_TIME) < MAX_COMMAND_RANGE
    if (use & turn).sum() < MIN_SAMPLES:
        return None
    # 4. Curvature at the nodes, and understeer.
    x = np.column_stack([_hats(steering[use], NODES), -slope * acceleration[use]])
    center = np.append(slope * (NODES - zero_command), 0.0)
    width = np.append(slope * (NODE_TRIM + NODE_DEVIATION * np.abs(NODES)), UNDERSTEER_DRIFT)
    return _fit_curve(slope, x, curvature[use], center, width, MIN_CURVE_SCATTER * slope)


def _fit_line(command: FloatArray, curvature: FloatArray) -> tuple[float, float]:
    """Fit curvature = slope (command - zero) robustly; return slope and ``zero``.

    ``zero`` has a prior, since turns to one side do not separate a trim from a gain. Both are 0
    without commands or turns.
    """
    if not (command.any() and curvature.any()):
        return 0.0, 0.0
    size = float(np.sqrt(np.mean(curvature**2) / np.mean(command**2)))
    x = np.column_stack([command, np.ones(len(command))])
    center = np.array([size, 0.0])
    width = size * np.array([SLOPE_WIDTH, NODE_TRIM])
    line = _fit_curve(size, x, curvature, center, width, MIN_CURVE_SCATTER * size)
    (slope, offset), _ = _solve(line.information, line.vector, center, width**-2.0)
    return float(slope), -float(offset / slope)


def _fit_throttle(s: MotionSamples, scale: float) -> ResponseCurve | None:
    """Fit the throttle at the nodes; None: too little straight driving. scale: of the speeds."""
    size = round(THROTTLE_TIME / STEP)
    half = size // 2
    speed = _windows(s.speed, half, size - 1 - half).mean(axis=1)
    acceleration = _windows(np.gradient(speed, STEP), half, size - 1 - half).mean(axis=1)
    use = (s.good & (s.speed > MIN_SPEED * scale) & (s.throttle > 0.0)
           & (np.abs(s.steering) < MAX_STRAIGHT_COMMAND)
           & (np.abs(s.rate * s.speed) < MAX_GENTLE_ACCELERATION)
           & (np.abs(acceleration) < MAX_HELD_ACCELERATION)
           & (_range(s.throttle, THROTTLE_TIME) < MAX_THROTTLE_RANGE * s.throttle))
    if use.sum() < MIN_SAMPLES:
        return None
    x = np.column_stack([_hats(speed[use] / scale, SPEED_NODES), acceleration[use]])
    n = len(SPEED_NODES)
    center = np.append(np.full(n, np.median(s.throttle[use])), THROTTLE_SLOPE)
    width = np.append(np.full(n, THROTTLE_WIDTH), THROTTLE_SLOPE)
    return _fit_curve(1.0, x, s.throttle[use], center, width, MIN_CURVE_SCATTER)


def _hats(values: FloatArray, nodes: FloatArray) -> FloatArray:
    """Return the hat function of each node (n, k) at the values (n,), which are limited to them."""
    distance = np.abs(np.clip(values, nodes[0], nodes[-1])[:, None] - nodes)
    return np.asarray(np.maximum(1.0 - distance / (nodes[1] - nodes[0]), 0.0))


def _fit_curve(slope: float, x: FloatArray, y: FloatArray, center: FloatArray, width: FloatArray,
               min_scatter: float) -> ResponseCurve:
    """Fit y = x v with a prior by iterated Huber weights; return its normal equations."""
    prior = width**-2.0
    scale = min_scatter
    weight = np.ones(len(y))
    for _ in range(ROBUST_STEPS):
        weighted = x.T * (weight * (STEP / BLOCK_TIME) / scale**2)
        information = weighted @ x
        vector = weighted @ y
        values, _ = _solve(information, vector, center, prior)
        residual = np.abs(y - x @ values)
        scale = max(1.4826 * float(np.median(residual)), min_scatter)
        weight = np.minimum(MAX_HUBER * scale / np.maximum(residual, 1e-9), 1.0)
    return ResponseCurve(slope, information, vector, center, width)


def _solve(information: FloatArray, vector: FloatArray, center: FloatArray, prior: FloatArray
           ) -> tuple[FloatArray, FloatArray]:
    """Return the values (k,) and their covariance (k, k) from normal equations and a prior."""
    covariance = np.asarray(np.linalg.inv(information + np.diag(prior)), np.float64)
    return covariance @ (vector + prior * center), covariance


def _filter_command(command: FloatArray, curvature: FloatArray, use: BoolArray) -> FloatArray:
    """Return the command (n,) as the wheels follow it: later by a delay, and by a first-order lag.

    Both are those with the smallest residual of kappa = c0 + c1 u + c2 u |u|.
    """
    best = command
    least = math.inf
    for delay in DELAYS:
        late = np.concatenate([np.full(delay, command[0]), command])[:len(command)]
        for lag in LAGS:
            # ``low_pass`` takes the sample before: one more, without the first.
            u = (low_pass(np.append(late, late[-1]), math.exp(-STEP / lag))[1:] if lag
                 else late)
            x = np.column_stack([np.ones(len(u)), u, u * np.abs(u)])[use]
            residual = float(np.sum((curvature[use] - x @ np.linalg.lstsq(
                x, curvature[use], rcond=None)[0])**2))
            if residual < least:
                least = residual
                best = u
    return best


def _measure_encoder(s: MotionSamples, min_speed: float) -> tuple[float, float] | None:
    """Return encoder speed over pose speed and its standard error; None: too little driving."""
    use = (s.good & (s.encoder > 0.0) & (s.speed > min_speed)
           & (np.abs(s.rate * s.speed) < MAX_GENTLE_ACCELERATION)
           & (_range(s.speed, SPEED_TIME) < MAX_SPEED_RANGE * s.speed))
    if use.sum() < MIN_SAMPLES:
        return None
    ratio = s.encoder[use] / s.speed[use]
    middle = float(np.median(ratio))
    spread = 1.4826 * float(np.median(np.abs(ratio - middle)))
    blocks = len(np.unique(np.floor(s.t[use] / BLOCK_TIME)))
    return middle, math.hypot(spread / math.sqrt(blocks), MIN_RELATIVE_ERROR * middle)


def _sample_poses(r: Recording) -> MotionSamples | None:
    """Return the motion by the poses, of the rear axle where the marker frame is known."""
    if r.mocap is None:
        return None
    try:
        g = marker_grid(r)
    except RecordingError:  # too short
        return None
    speed = np.hypot(g.dx, g.dy)
    good = ~g.bad
    if r.marker is not None:
        yaw = g.yaw + r.marker.theta
        speed = np.cos(yaw) * g.dx + np.sin(yaw) * g.dy + g.omega * r.marker.ly
        lateral = np.cos(yaw) * g.dy - np.sin(yaw) * g.dx - g.omega * r.marker.lx
        good &= np.abs(lateral) < MAX_SIDE_SLIP * speed
    part = slice(None, None, round(STEP / (g.t[1] - g.t[0])))
    return MotionSamples(g.t[part], speed[part], g.omega[part], g.throttle[part], g.steering[part],
                         g.encoder[part], good[part])


def _sample_sensors(r: Recording) -> MotionSamples | None:
    """Return the motion by encoder and gyro; None without them."""
    m = r.messages
    measured = np.isfinite(m.speed) & np.isfinite(m.yaw_rate)
    if r.encoder != "ok" or measured.sum() < MIN_SAMPLES:
        return None
    t = np.arange(m.t[0], m.t[-1], STEP)
    last = np.searchsorted(m.t, t, side="right") - 1
    good = measured[last] & (t - m.t[last] < MAX_MESSAGE_GAP)
    speed = np.nan_to_num(m.speed[last])
    return MotionSamples(t, speed, np.nan_to_num(m.yaw_rate[last]), m.throttle[last],
                         m.steering[last], speed, good)


def _range(values: FloatArray, seconds: float) -> FloatArray:
    """Return largest minus smallest value (n,) of the ``seconds`` up to each sample."""
    return np.asarray(np.ptp(_windows(values, round(seconds / STEP) - 1, 0), axis=1))


def _windows(values: FloatArray, left: int, right: int) -> FloatArray:
    """Return each sample with those around it (n, left + 1 + right), mirrored at the ends.

    As the filters of scipy.ndimage, whose import takes longer than all of them here.
    """
    return sliding_window_view(np.pad(values, (left, right), mode="symmetric"), left + 1 + right)
