"""Residuals: prediction minus measurement, for the motion and for each sensor.

The forward model of ``Evidence.residuals``, for a vehicle p and the timing of the recordings:

    1. Shift the commands to the clock of their messages, and pass them through delay, lag and
       the other effects on the actuators.
    2. Roll the vehicle out from the measured state at the start of each window.
    3. Differentiate the predicted poses as motion capture differentiates the measured ones.
       Motion residuals: predicted minus measured velocities, at READ_OUTS.
    4. Predict each sensor from the measured motion. Sensor residuals: predicted minus read.

A fit varies one parameter at a time, and most parameters change few of these steps. Each part is
therefore cached, by exactly the parameters that it depends on.
"""

from __future__ import annotations

import pickle
from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from types import MappingProxyType
from typing import Any, TypeVar
from uuid import uuid4

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.recording.dart import RUN, Grid
from dart_hal.vehicle.channels import split_final_delay
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.delay import first_order_lag
from dart_hal.vehicle.effect import ActiveEffect, Effect
from dart_hal.vehicle.parameters import Motor, Vehicle
from dart_lab.identification.prediction.actuators import (
    apply_command_effects,
    behind_actuator,
    delay_command,
    road_wheel_angle,
)
from dart_lab.identification.prediction.commands import spread_over
from dart_lab.identification.prediction.rollout import Parts, measured_states
from dart_lab.identification.prediction.substeps import SUBSTEPS, quarters, rollout_substeps

from .drive import DERIVATIVE_POINTS, HALF_POINTS, READ_OUTS, RecordedDrive
from .policy import BLOCK_S
from .readings import (
    SENSORS,
    add_wheel_force,
    measured_motion,
    predict_readings,
    rest_motion,
    rest_residuals,
)
from .space import MESSAGE_AGE, NO_DELAY, RUN_MESSAGE_AGE, MessageTiming

MOTION = ("v_x", "v_y", "omega")
# By signal that only sensors read: the channels in which an effect on it shows.
SIGNAL_CHANNELS = MappingProxyType({"wheel": ("encoder",), "gyro": ("gyro",),
                                    "accel": ("accel_x", "accel_y")})
IMU = frozenset({"gyro", "accel"})
POSE, THROTTLE, SERVO, STEERING = (frozenset(c) for c in (
    ("pose",), ("throttle",), ("steering",), ("steering", "angle")))
MAX_CACHED_PARTS = 48  # parts of models, which are long series
MAX_CACHED_RESIDUALS = 256  # a fit returns to earlier points
MAX_CACHED_EVIDENCE = 2  # in one process: training and test recordings
# Block labels are integers: the block within a drive, plus this for each drive before it.
BLOCKS_PER_DRIVE = 1_000_000
# Messages at rest get labels of their own from here on: 50,000 blocks are longer than any drive.
REST_LABEL = 50_000
STATE_SAMPLES = [r + j for r in READ_OUTS for j in range(-HALF_POINTS, HALF_POINTS + 1)]
OFFSETS = np.arange(-HALF_POINTS, HALF_POINTS + 1)
# Weights of consecutive poses that give their derivative [1/s]: of a least-squares line through
# DERIVATIVE_POINTS poses, j / sum(j^2) per sample.
DERIVATIVE_WEIGHTS = OFFSETS / (OFFSETS @ OFFSETS) / SAMPLE
T = TypeVar("T")
SampleInputs = Callable[[FloatArray, IntArray], FloatArray]


@dataclass(frozen=True, slots=True)
class Residuals:
    """Predicted minus measured: motion (n, len(READ_OUTS) * 3) and sensors (m, 4).

    motion: of n windows, read-out by read-out. sensors: of m messages; those at rest are multiplied
    by ``Evidence.noise_scale``.
    """

    motion: FloatArray
    sensors: FloatArray


# Evidence that came from another process, by its identifier.
EVIDENCE_CACHE: OrderedDict[str, Evidence] = OrderedDict()


class Evidence:
    """Drives, and the residuals of any model on them."""

    has_mocap = True  # the state at the start of a window is measured

    def __init__(self, drives: Sequence[RecordedDrive], l_r: float, overlap: float = 2.0) -> None:
        """overlap: number of windows that predict each sample."""
        self.drives = tuple(drives)
        self.l_r = l_r
        self.overlap = overlap
        self._parts_cache: OrderedDict[Hashable, Any] = OrderedDict()
        self._residuals_cache: OrderedDict[Hashable, Any] = OrderedDict()
        self._name = uuid4().hex
        self.on_evaluation: Callable[[], None] | None = None
        self.motion_drive = np.repeat(np.arange(len(drives)), [len(d.starts) for d in drives])
        self.sensor_drive = np.repeat(np.arange(len(drives)),
                                      [len(d.message_samples) for d in drives])

    def __reduce__(self) -> tuple[Callable[..., Evidence], tuple[Any, ...]]:
        """Pickle the recordings without the caches, which are larger than the work they save.

        A process that has received this evidence before uses its own copy with its caches, so the
        recordings are pickled once and unpickled once per process.
        """
        return _restore_evidence, (type(self), self._name, self._pickled_state)

    @cached_property
    def _pickled_state(self) -> bytes:
        return pickle.dumps({**self.__dict__, "_parts_cache": OrderedDict(),
                             "_residuals_cache": OrderedDict(), "on_evaluation": None},
                            protocol=pickle.HIGHEST_PROTOCOL)

    def drop_drive(self, number: int) -> Evidence:
        """Return the evidence of all drives but one."""
        return Evidence([d for k, d in enumerate(self.drives) if k != number], self.l_r,
                        self.overlap)

    def motion_only(self, starts: Sequence[IntArray] | None = None) -> Evidence:
        """Return the evidence without messages of sensors.

        starts: first samples of the windows of each drive; None: unchanged.
        """
        mine = [d.starts for d in self.drives] if starts is None else starts
        return Evidence([replace(d, starts=first, message_samples=np.empty(0),
                                 readings=np.empty((0, 4)), at_rest=np.empty(0, dtype=np.bool_))
                         for d, first in zip(self.drives, mine, strict=True)],
                        self.l_r, self.overlap)

    @property
    def message_age(self) -> float:
        """Expected age of a message at its stamp [s], on the clock of the poses."""
        return RUN_MESSAGE_AGE if self.commands_stamped else MESSAGE_AGE

    @property
    def commands_stamped(self) -> bool:
        """Whether each command has a stamp, as in runs, which log the pulses.

        In the published recordings a command has the stamp of the next message.
        """
        return all(d.recording.schema == RUN for d in self.drives)

    @property
    def mounting(self) -> tuple[str, ...]:
        """Effects that every car has to a small degree, so they are not structure.

        Motion capture shows an error of 0.1 % of a gyro's scale in a minute, and the data sheet of
        a BNO055 allows 1 %, so it would be found in sound cars. Of runs alone: they are of the car
        whose model is extended, which then has that scale.
        """
        return ("gyro_scale",) if self.commands_stamped else ()

    @property
    def sensor_at_rest(self) -> BoolArray:
        """Messages (m,) of a car at rest."""
        return np.concatenate([np.empty(0, dtype=np.bool_), *(d.at_rest for d in self.drives)])

    @property
    def noise_scale(self) -> FloatArray:
        """Factors (m, 4) by which sensor residuals exceed SI units, see ``rest_residuals``."""
        rows = np.ones((len(self.sensor_drive), len(SENSORS)))
        for i, drive in enumerate(self.drives):
            rows[self.sensor_at_rest & (self.sensor_drive == i), 2:] = drive.noise_scale
        return rows

    @property
    def columns(self) -> dict[str, int]:
        """Column of each motion channel at its last read-out, and -4 .. -1 for the sensors."""
        return {**self._motion_columns(READ_OUTS[-1]),
                **{s: i - len(SENSORS) for i, s in enumerate(SENSORS)}}

    def columns_at(self, horizon: float) -> dict[str, int]:
        """Column of the motion at a horizon [s], by channel of the evaluation, if it has one."""
        names = {"v_x": "vx", "v_y": "vy", "omega": "yaw_rate"}
        sample = round(horizon / SAMPLE)
        return {} if sample not in READ_OUTS else {
            names[n]: i for n, i in self._motion_columns(sample).items()}

    def channel(self, column: int) -> str:
        """Name of a column of the motion, or of -1 - column of the sensors."""
        return MOTION[column % len(MOTION)] if column >= 0 else SENSORS[-1 - column]

    def _motion_columns(self, sample: int) -> dict[str, int]:
        first = READ_OUTS.index(sample) * len(MOTION)
        return {name: first + i for i, name in enumerate(MOTION)}

    def blocks(self, length: float = BLOCK_S) -> tuple[IntArray, IntArray]:
        """Label blocks of ``length`` [s]: each window (n,) and each message (m,).

        Messages at rest share no disturbance, so each is a block of its own.
        """
        none = np.empty(0)  # a folder may hold no usable recording
        windows = np.concatenate([none, *self._window_starts()]) * SAMPLE // length
        messages = np.concatenate([none, *(d.message_samples for d in self.drives)])
        messages = messages * SAMPLE // length
        at_rest = self.sensor_at_rest
        messages[at_rest] = REST_LABEL + np.arange(at_rest.sum())
        return (self.motion_drive * BLOCKS_PER_DRIVE + windows.astype(np.int64),
                self.sensor_drive * BLOCKS_PER_DRIVE + messages.astype(np.int64))

    def _window_starts(self) -> Sequence[FloatArray]:
        """Return the starts of the windows of each drive [samples]."""
        return [d.starts.astype(np.float64) for d in self.drives]

    def residuals(self, p: Vehicle, timing: MessageTiming = NO_DELAY) -> Residuals:
        """Compute the residuals of the vehicle p with its effects, see the module docstring.

        Where poses are late, commands and messages are moved earlier instead: to shift the poses
        by part of a sample would smooth them, and windows would start where the motion bends.
        """
        self.report_evaluation()
        p, timing = _align_clocks(p, timing)
        ages = timing.message_age, timing.gyro_age
        moving = _drop_reading_effects(p)
        q = apply_parameter_effects(p)
        # Motion and each sensor are cached by what they depend on: most steps of a search change
        # one of them.
        motion = self._cached_residuals(
            (moving, timing.age_spread), lambda: self._motion_residuals(moving, timing.age_spread))
        sensors = [self._cached_residuals(_readings_key(p, q, signal, *ages),
                                          partial(self._sensor_residuals, p, q, signal, *ages))
                   for signal in SIGNAL_CHANNELS]
        return Residuals(motion, np.concatenate(sensors, axis=1))

    def pose_errors(self, p: Vehicle, timing: MessageTiming, read_out: int) -> FloatArray:
        """Compute predicted minus measured x, y [m] and yaw [rad] of all windows, (n, 3).

        p, timing: as for ``residuals``; read_out: one of READ_OUTS.
        """
        p, timing = _align_clocks(p, timing)
        moving = _drop_reading_effects(p)
        q = apply_parameter_effects(moving)
        row = READ_OUTS.index(read_out) * DERIVATIVE_POINTS + HALF_POINTS
        predicted = self._states(moving, q, timing.age_spread)[row]
        measured_at = measured_states(self._parts(moving, q), (read_out,))[0]
        return np.asarray((predicted - measured_at)[:3].T)

    def report_evaluation(self) -> None:
        """Report one more evaluation to ``on_evaluation``."""
        if self.on_evaluation is not None:
            self.on_evaluation()

    def _cached_part(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Return a part of a model from the cache, or compute it."""
        return _get_cached(self._parts_cache, MAX_CACHED_PARTS, key, make)

    def _cached_residuals(self, key: Hashable, make: Callable[[], T]) -> T:
        """Return residuals from the cache, or compute them.

        They are kept longer than parts: an effect on a sensor does not change the motion and the
        reverse, and each phase of a diagnosis starts where the last one ended.
        """
        return _get_cached(self._residuals_cache, MAX_CACHED_RESIDUALS, key, make)

    def _motion_residuals(self, p: Vehicle, age_spread: float) -> FloatArray:
        """Compute the motion residuals (n, len(READ_OUTS) * 3)."""
        q = apply_parameter_effects(p)
        measured = self._cached_start_and_motion(p, q)[1]
        # Predicted poses are differentiated like measured ones, which smooths both equally.
        error = _velocities(self._states(p, q, age_spread)) - measured
        return np.asarray(error.reshape(len(READ_OUTS) * len(MOTION), -1).T)

    def _states(self, p: Vehicle, q: Vehicle, age_spread: float) -> FloatArray:
        """Predict the states (len(STATE_SAMPLES), 6, n) of all windows; q: p with its effects."""
        start, _ = self._cached_start_and_motion(p, q)
        # Inputs of the rollout: throttle constant over a sample, angle in quarters of one, as a
        # servo moves within it.
        throttle = self._cached_part(
            ("throttle", *throttle_key(p, q), age_spread), lambda: np.repeat(
                self._actuator_outputs(q, age_spread, "throttle", _sample_series), SUBSTEPS,
                axis=0))
        angle = self._cached_part(
            ("angle", *steering_key(p, q), age_spread),
            lambda: self._actuator_outputs(q, age_spread, "steering", _sample_quarters))
        return rollout_substeps(p, start, throttle, angle, STATE_SAMPLES)

    def _cached_start_and_motion(self, p: Vehicle, q: Vehicle) -> tuple[FloatArray, FloatArray]:
        """Return ``_start_and_motion`` from the cache."""
        pair: tuple[FloatArray, FloatArray] = self._cached_part(
            ("motion", q.body.l_r, _effects_on(p, POSE)), lambda: self._start_and_motion(p, q))
        return pair

    def _parts(self, p: Vehicle, q: Vehicle) -> Parts:
        """Return the measured motion of each drive, without the pose effects of p, and windows."""
        return [(g, d.starts) for g, d in zip(self._grids(p, q), self.drives, strict=True)]

    def _start_and_motion(self, p: Vehicle, q: Vehicle) -> tuple[FloatArray, FloatArray]:
        """Return the start state (6, n) and the velocities (len(READ_OUTS), 3, n) of windows."""
        states = measured_states(self._parts(p, q), (0, *READ_OUTS))
        return states[0], states[1:, 3:]

    def _actuator_outputs(self, q: Vehicle, age_spread: float, channel: str,
                          sample: SampleInputs) -> FloatArray:
        """Return the actuator output in all windows: (samples, n), or finer."""
        delay, lag = (getattr(q.delay, f"{channel}{part}") for part in ("_s", "_lag_s"))
        lagged = partial(
            self._cached_part, (channel, delay, lag, age_spread),
            lambda: self._delay_and_lag(channel, delay, lag, age_spread))
        if channel == "throttle":
            series = self._pass_actuator(partial(apply_command_effects, q, channel), lagged())
        else:  # the servo takes longest to compute, and no trim, play or map changes it
            servo = self._cached_part(
                ("servo", delay, lag, age_spread, _effects_on(q, SERVO)),
                lambda: self._pass_actuator(partial(apply_command_effects, q, channel), lagged()))
            series = self._pass_actuator(partial(road_wheel_angle, q), servo)
        parts = [sample(one, drive.starts + np.arange(STATE_SAMPLES[-1])[:, None])
                 for drive, one in zip(self.drives, series, strict=True)]
        return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)

    def _pass_actuator(self, stage: Callable[..., FloatArray], series: Sequence[FloatArray]
                       ) -> list[FloatArray]:
        """Pass a series of each drive through a stage of its actuator, in means over samples."""
        return [stage(one, drive.grid, "mean")
                for drive, one in zip(self.drives, series, strict=True)]

    def _delay_and_lag(self, channel: str, delay: float, lag: float, age_spread: float
                       ) -> list[FloatArray]:
        """Return means of a command over samples behind delay and lag, by drive.

        The command is averaged over the spread of its age; a delay may be part of a sample.
        """
        out = []
        sent = self._cached_part("sent", lambda: [d.message_times for d in self.drives])
        for drive, times in zip(self.drives, sent, strict=True):
            if times is None:
                # Schema C has no times of commands: shift its series of samples.
                command = spread_over(getattr(drive.grid, channel), age_spread)
                command = delay_command(command, delay, smooth=True)
            else:
                # Else shift the times at which each value begins, see ``command_at``.
                command = spread_over(drive.command_at(channel, times + delay), age_spread)
            out.append(first_order_lag(command, lag, "mean"))
        return out

    def _sensor_residuals(self, p: Vehicle, q: Vehicle, signal: str, message_age: float,
                          gyro_age: float) -> FloatArray:
        """Compute predicted minus measured readings (m, channels); q: p with its effects."""
        key = q.body.l_r, _effects_on(p, POSE)
        motion = self._cached_part(("measured", *key),
                                   lambda: [measured_motion(g) for g in self._grids(p, q)])
        if _effects_on(p, frozenset({signal})):  # such an effect may depend on the wheel force
            throttle = partial(
                self._cached_part, ("whole throttle", *throttle_key(p, q)),
                lambda: [behind_actuator(p, "throttle", d.grid.throttle, d.grid, smooth=True)
                         for d in self.drives])
            motion = self._cached_part(
                ("pulled", *key, q.motor, q.friction, *throttle_key(p, q)),
                lambda: [add_wheel_force(p, m, one)
                         for m, one in zip(motion, throttle(), strict=True)])
        still = self._cached_part("resting", lambda: [rest_motion(d) for d in self.drives])
        rest = self._cached_part(
            ("rest", q.body, _effects_on(p, IMU)),
            lambda: [rest_residuals(d, p, True, r)
                     for d, r in zip(self.drives, still, strict=True)])
        mine = [SENSORS.index(channel) for channel in SIGNAL_CHANNELS[signal]]
        age = message_age + gyro_age if signal == "gyro" else message_age
        return np.concatenate([part for drive, m, own in zip(self.drives, motion, rest, strict=True)
                               for part in (predict_readings(p, m, drive, signal, age)
                                            - drive.readings[~drive.at_rest][:, mine],
                                            own[:, mine])])

    def _grids(self, p: Vehicle, q: Vehicle) -> list[Grid]:
        """Return the measured motion of each drive without the pose effects of p."""
        grids: list[Grid] = self._cached_part(("grids", q.body.l_r, _effects_on(p, POSE)),
                                              lambda: [self._grid(d, p, q) for d in self.drives])
        return grids

    def _grid(self, drive: RecordedDrive, p: Vehicle, q: Vehicle) -> Grid:
        """Return the measured motion at the centre of mass of q."""
        g = drive.without_mocap_effects(p, self.l_r)
        # v_y of a point l further ahead on a rigid body is larger by l omega.
        shift = q.body.l_r - self.l_r
        return replace(g, v_y=g.v_y + shift * g.omega) if shift else g


def _get_cached(cache: OrderedDict[Hashable, Any], size: int, key: Hashable,
                make: Callable[[], T]) -> T:
    """Return the entry of a key, made if missing; the cache drops its oldest entry when full."""
    if key not in cache:
        cache[key] = make()
        if len(cache) > size:
            cache.popitem(last=False)
    cache.move_to_end(key)
    value: T = cache[key]
    return value


def _restore_evidence(kind: type[Evidence], name: str, packed: bytes) -> Evidence:
    """Return the evidence that this process has by that identifier, else unpickle it."""
    if name not in EVIDENCE_CACHE:
        EVIDENCE_CACHE[name] = kind.__new__(kind)
        EVIDENCE_CACHE[name].__dict__.update(pickle.loads(packed))
        if len(EVIDENCE_CACHE) > MAX_CACHED_EVIDENCE:
            EVIDENCE_CACHE.popitem(last=False)
    return EVIDENCE_CACHE[name]


def affects_readings_only(effect: Effect) -> bool:
    """Return whether an effect changes only what sensors read."""
    return (set(effect.signals) <= set(SIGNAL_CHANNELS) and effect.vehicle is None
            and effect.force is None)


def _align_clocks(p: Vehicle, timing: MessageTiming) -> tuple[Vehicle, MessageTiming]:
    """Remove the delay of poses, and count the delays of commands from their messages.

    Returns the vehicle, and the timing relative to the poses.
    """
    p, pose_delay = split_final_delay(p, "pose")
    timing = replace(timing, message_age=timing.message_age - pose_delay,
                     command_age=timing.command_age - pose_delay)
    return timing.shift_delays(p), timing


def _drop_reading_effects(p: Vehicle) -> Vehicle:
    """Return the vehicle without effects that only sensors show."""
    return replace(p, effects=tuple(a for a in p.effects if not affects_readings_only(a.effect)))


# Keys of caches: each lists all on which a part depends, and nothing else.
def _readings_key(p: Vehicle, q: Vehicle, signal: str, message_age: float, gyro_age: float
                  ) -> tuple[Hashable, ...]:
    """Return what the sensor residuals of a signal depend on; q: p with its effects."""
    on = _effects_on(p, frozenset({signal}))
    force = (q.motor, q.friction, throttle_key(p, q)) if on else ()
    return (signal, q.body, _effects_on(p, POSE), on, force, message_age,
            gyro_age if signal == "gyro" else 0.0)


def _effects_on(p: Vehicle, channels: frozenset[str]) -> tuple[ActiveEffect, ...]:
    """Return the effects on some signals."""
    return tuple(a for a in p.effects if channels & set(a.effect.signals))


def throttle_key(p: Vehicle, q: Vehicle) -> tuple[Hashable, ...]:
    """Return what the output of the throttle actuator depends on; q: p with its effects."""
    on = _effects_on(p, THROTTLE)
    dead_band = q.motor.g if isinstance(q.motor, Motor) else 0.0
    return (q.delay.throttle_s, q.delay.throttle_lag_s, on and dead_band, on)


def steering_key(p: Vehicle, q: Vehicle) -> tuple[Hashable, ...]:
    """Return what the road-wheel angle depends on; q: p with its effects."""
    return (q.delay.steering_s, q.delay.steering_lag_s, q.steering, _effects_on(p, STEERING))


def _sample_series(series: FloatArray, index: IntArray) -> FloatArray:
    """Return the series at samples of windows, held from sample to sample."""
    return np.asarray(series[index])


def _sample_quarters(series: FloatArray, index: IntArray) -> FloatArray:
    """Return the series at quarters of samples, each computed once for all windows with it."""
    parts = quarters(series)[index]
    return np.asarray(np.swapaxes(parts, 1, 2).reshape(len(index) * SUBSTEPS, index.shape[1]))


def _velocities(states: FloatArray) -> FloatArray:
    """Differentiate states (len(STATE_SAMPLES), 6, n) as motion capture does.

    Returns velocities (len(READ_OUTS), 3, n) in the frame of the car.
    """
    near = states.reshape(len(READ_OUTS), len(OFFSETS), *states.shape[1:])
    dx, dy, omega = np.einsum("j,rjcn->crn", DERIVATIVE_WEIGHTS, near[:, :, :3])
    c, s = np.cos(near[:, HALF_POINTS, 2]), np.sin(near[:, HALF_POINTS, 2])
    return np.stack([c * dx + s * dy, c * dy - s * dx, omega], axis=1)
