"""What the model says that was measured, minus what was: motion, and every sensor by itself."""

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
from dart_hal.vehicle.channels import late_last
from dart_hal.vehicle.compose import settled
from dart_hal.vehicle.delay import first_order_lag
from dart_hal.vehicle.effect import ActiveEffect, Effect
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.prediction.actuators import (
    behind_actuator,
    delay_command,
    reached,
    turned,
)
from dart_lab.identification.prediction.commands import spread_over
from dart_lab.identification.prediction.rollout import Parts
from dart_lab.identification.prediction.rollout import measured as measured_states
from dart_lab.identification.prediction.substeps import FINE, fine_rollout, quarters

from .drive import HALF, POINTS, READ_OUTS, Drive
from .readings import SENSORS, at_rest, driven, measured, pulled, resting
from .space import EXACT, LATE, POSES_LATE, Timing

MOTION = ("v_x", "v_y", "omega")
SENSED = MappingProxyType({"wheel": ("encoder",), "gyro": ("gyro",),
                           "accel": ("accel_x", "accel_y")})
"""By signal that is only read: channels of the residuals in which an effect on it shows."""
ALL, IMU = frozenset(SENSED), frozenset({"gyro", "accel"})
POSE, THROTTLE, SERVO, STEERING = (frozenset(c) for c in (
    ("pose",), ("throttle",), ("steering",), ("steering", "angle")))
KEPT, SAID = 48, 256  # parts of models, long ones; residuals, of which a fit asks for old ones
FEW = 2  # evidences of which a process keeps parts: to learn from, and to judge by
ALONE, MANY_BLOCKS = 50_000, 1_000_000  # labels of blocks: of messages alone, of the next drive
AT = [r + j for r in READ_OUTS for j in range(-HALF, HALF + 1)]
OFFSETS = np.arange(-HALF, HALF + 1)
SLOPE = OFFSETS / (OFFSETS @ OFFSETS) / SAMPLE
"""Weights by which POINTS poses give a derivative [1/s]."""
T = TypeVar("T")
Read = Callable[[FloatArray, IntArray], FloatArray]


@dataclass(frozen=True, slots=True)
class Residuals:
    """motion (n, len(READ_OUTS) * 3): errors of n windows, read-out by read-out; sensors (m, 4),
    those of a standing car larger by ``Evidence.noise_scale``."""

    motion: FloatArray
    sensors: FloatArray


HAD: OrderedDict[str, Evidence] = OrderedDict()
"""By name, evidence that came from another process."""


class Evidence:
    """Drives and how the residuals of any model on them are computed."""

    exact = True  # but for noise, with the right model nothing is left

    def __init__(self, drives: Sequence[Drive], l_r: float, overlap: float = 2.0) -> None:
        """overlap: how often the windows predict every sample."""
        self.drives, self.l_r, self.overlap = tuple(drives), l_r, overlap
        self._kept: OrderedDict[Hashable, Any] = OrderedDict()
        self._said: OrderedDict[Hashable, Any] = OrderedDict()
        self._name = uuid4().hex
        self.told: Callable[[], None] | None = None  # of each evaluation
        self.motion_drive = np.repeat(np.arange(len(drives)), [len(d.starts) for d in drives])
        self.sensor_drive = np.repeat(np.arange(len(drives)), [len(d.at) for d in drives])

    def __reduce__(self) -> tuple[Callable[..., Evidence], tuple[Any, ...]]:
        """For another process: what is kept is larger than what it takes to make it.

        A process that has had this evidence before goes on with its own, and what it kept. So the
        recordings are pickled once, and opened where they have not been.
        """
        return _had, (type(self), self._name, self._packed)

    @cached_property
    def _packed(self) -> bytes:
        return pickle.dumps({**self.__dict__, "_kept": OrderedDict(), "_said": OrderedDict(),
                             "told": None}, protocol=pickle.HIGHEST_PROTOCOL)

    def without(self, drive: int) -> Evidence:
        """The evidence of all drives but one, by its number."""
        return Evidence([d for k, d in enumerate(self.drives) if k != drive], self.l_r,
                        self.overlap)

    def motion_alone(self, starts: Sequence[IntArray] | None = None) -> Evidence:
        """The evidence without messages of sensors.

        starts: first samples of the windows of each drive; None: as they are.
        """
        mine = [d.starts for d in self.drives] if starts is None else starts
        return Evidence([replace(d, starts=first, at=np.empty(0), read=np.empty((0, 4)),
                                 still=np.empty(0, dtype=np.bool_))
                         for d, first in zip(self.drives, mine, strict=True)],
                        self.l_r, self.overlap)

    @property
    def late(self) -> float:
        """What age of a message is expected [s], on the clock of the poses."""
        return POSES_LATE if self.commands_stamped else LATE

    @property
    def commands_stamped(self) -> bool:
        """Whether every command has its own instant: in runs of our own, which hold the pulses. In
        the published recordings it has that of the next message."""
        return all(d.recording.schema == RUN for d in self.drives)

    @property
    def mounting(self) -> tuple[str, ...]:
        """Effects that every car has a little of, and what they do is no structure.

        Beside motion capture the scale of a gyro is seen to 0.1 % in a minute; that of a BNO055 is
        good to 1 %, and a run of our own is of the car whose model it is.
        """
        return ("gyro_scale",) if self.commands_stamped else ()

    @property
    def sensor_still(self) -> BoolArray:
        """Messages (m,) of a standing car."""
        return np.concatenate([np.empty(0, dtype=np.bool_), *(d.still for d in self.drives)])

    @property
    def noise_scale(self) -> FloatArray:
        """(m, 4): by what residuals of sensors are larger than in SI units, see ``at_rest``."""
        rows = np.ones((len(self.sensor_drive), len(SENSORS)))
        for i, drive in enumerate(self.drives):
            rows[self.sensor_still & (self.sensor_drive == i), 2:] = drive.noise_scale
        return rows

    @property
    def columns(self) -> dict[str, int]:
        """By name: column of the motion at its end, or -4 .. -1 of the sensors."""
        return {**self._motion_at(READ_OUTS[-1]),
                **{s: i - len(SENSORS) for i, s in enumerate(SENSORS)}}

    def columns_at(self, horizon: float) -> dict[str, int]:
        """By channel of the evaluation: column of the motion at a horizon [s], if it has one."""
        names = {"v_x": "vx", "v_y": "vy", "omega": "yaw_rate"}
        sample = round(horizon / SAMPLE)
        return {} if sample not in READ_OUTS else {
            names[n]: i for n, i in self._motion_at(sample).items()}

    def channel(self, column: int) -> str:
        """Name of a column of the motion, or of -1 - column of the sensors."""
        return MOTION[column % len(MOTION)] if column >= 0 else SENSORS[-1 - column]

    def _motion_at(self, sample: int) -> dict[str, int]:
        first = READ_OUTS.index(sample) * len(MOTION)
        return {name: first + i for i, name in enumerate(MOTION)}

    def blocks(self, length: float) -> tuple[IntArray, IntArray]:
        """Stretches of ``length`` [s]: one label for each window (n,) and each message (m,).

        Messages of a standing car have nothing in common but what is looked for.
        """
        none = np.empty(0)  # a folder may hold nothing that can be used
        windows = np.concatenate([none, *self._begins()]) * SAMPLE // length
        messages = np.concatenate([none, *(d.at for d in self.drives)]) * SAMPLE // length
        still = self.sensor_still
        messages[still] = ALONE + np.arange(still.sum())
        return (self.motion_drive * MANY_BLOCKS + windows.astype(np.int64),
                self.sensor_drive * MANY_BLOCKS + messages.astype(np.int64))

    def _begins(self) -> Sequence[FloatArray]:
        """When the windows of each drive start [samples]."""
        return [d.starts.astype(np.float64) for d in self.drives]

    def residuals(self, p: Vehicle, timing: Timing = EXACT) -> Residuals:
        """Of the model p with its effects, at the timing of the recordings.

        Where poses come late, all else is early: shifted by parts of a sample
        they would be smoothed, and windows would start where the motion bends.
        """
        self.tell()
        p, timing = _advanced(p, timing)
        late = timing.late, timing.gyro
        moves, q = _moves(p), settled(p)
        return Residuals(
            self._again((moves, timing.spread), lambda: self._motion(moves, timing.spread)),
            np.concatenate([self._again(_reads(p, q, signal, *late),
                                        partial(self._sensor, p, q, signal, *late))
                            for signal in SENSED], axis=1))

    def pose_errors(self, p: Vehicle, timing: Timing, read_out: int) -> FloatArray:
        """Compute predicted minus measured x, y [m] and yaw [rad] of all windows, (n, 3).

        p, timing: as for ``residuals``; read_out: one of READ_OUTS.
        """
        p, timing = _advanced(p, timing)
        moves = _moves(p)
        q = settled(moves)
        predicted = self._states(moves, q, timing.spread)[READ_OUTS.index(read_out) * POINTS + HALF]
        measured_at = measured_states(self._parts(moves, q), (read_out,))[0]
        return np.asarray((predicted - measured_at)[:3].T)

    def tell(self) -> None:
        """One more evaluation, to whom it may concern."""
        if self.told is not None:
            self.told()

    def _once(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """A part, kept for a while."""
        return _kept(self._kept, KEPT, key, make)

    def _again(self, key: Hashable, make: Callable[[], T]) -> T:
        """Residuals, kept for longer: effects on sensors leave the motion as it is, and
        the reverse; and one phase ends where the next one begins."""
        return _kept(self._said, SAID, key, make)

    def _motion(self, p: Vehicle, spread: float) -> FloatArray:
        q = settled(p)
        error = _velocities(self._states(p, q, spread)) - self._start_and_seen(p, q)[1]
        return np.asarray(error.reshape(len(READ_OUTS) * len(MOTION), -1).T)

    def _states(self, p: Vehicle, q: Vehicle, spread: float) -> FloatArray:
        """Predicted states (len(AT), 6, n) of all windows; q: p settled."""
        start, _ = self._start_and_seen(p, q)
        throttle = self._once(("throttle", *pulled_by(p, q), spread), lambda: np.repeat(
            self._inputs(q, spread, "throttle", _held), FINE, axis=0))
        angle = self._once(("angle", *steered_by(p, q), spread),
                           lambda: self._inputs(q, spread, "steering", _in_parts))
        return fine_rollout(p, start, throttle, angle, AT)

    def _start_and_seen(self, p: Vehicle, q: Vehicle) -> tuple[FloatArray, FloatArray]:
        """As ``_seen``, kept for a while."""
        pair: tuple[FloatArray, FloatArray] = self._once(
            ("seen", q.body.l_r, _on(p, POSE)), lambda: self._seen(p, q))
        return pair

    def _parts(self, p: Vehicle, q: Vehicle) -> Parts:
        """The motion of each drive as p measures it, and its windows."""
        return [(g, d.starts) for g, d in zip(self._grids(p, q), self.drives, strict=True)]

    def _seen(self, p: Vehicle, q: Vehicle) -> tuple[FloatArray, FloatArray]:
        """Of all windows: start (6, n) and motion seen (len(READ_OUTS), 3, n)."""
        states = measured_states(self._parts(p, q), (0, *READ_OUTS))
        return states[0], states[1:, 3:]

    def _inputs(self, q: Vehicle, spread: float, channel: str, read: Read) -> FloatArray:
        """Of all windows, what an actuator did with its command: (samples, n) or finer."""
        delay, lag = (getattr(q.delay, f"{channel}{part}") for part in ("_s", "_lag_s"))
        lagged = partial(self._once, (channel, delay, lag, spread), lambda: self._lagged(
            channel, delay, lag, spread))
        if channel == "throttle":
            series = self._each(partial(reached, q, channel), lagged())
        else:  # the slowest of it, and no trim, play or map changes it
            servo = self._once(("servo", delay, lag, spread, _on(q, SERVO)),
                               lambda: self._each(partial(reached, q, channel), lagged()))
            series = self._each(partial(turned, q), servo)
        parts = [read(one, drive.starts + np.arange(AT[-1])[:, None])
                 for drive, one in zip(self.drives, series, strict=True)]
        return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)

    def _each(self, behind: Callable[..., FloatArray], series: Sequence[FloatArray]
              ) -> list[FloatArray]:
        """A series of each drive behind a part of its actuator, in means over samples."""
        return [behind(one, drive.grid.t, "mean")
                for drive, one in zip(self.drives, series, strict=True)]

    def _lagged(self, channel: str, delay: float, lag: float, spread: float) -> list[FloatArray]:
        """Of each drive, means of a command over samples behind delay and lag, spread by so
        much; delays to a part of a sample."""
        out = []
        sent = self._once("sent", lambda: [d.sent for d in self.drives])
        for drive, at in zip(self.drives, sent, strict=True):
            if at is None:
                command = spread_over(getattr(drive.grid, channel), spread)
                command = delay_command(command, delay, smooth=True)
            else:
                command = spread_over(drive.commanded(channel, at + delay), spread)
            out.append(first_order_lag(command, lag, "mean"))
        return out

    def _sensor(self, p: Vehicle, q: Vehicle, signal: str, late: float, apart: float
                ) -> FloatArray:
        """(m, channels of a signal that is only read), what it should read minus what it did.

        q: p settled.
        """
        key = q.body.l_r, _on(p, POSE)
        seen = self._once(("measured", *key), lambda: [measured(g) for g in self._grids(p, q)])
        if _on(p, frozenset({signal})):  # it may know the force
            throttle = partial(self._once, ("whole throttle", *pulled_by(p, q)), lambda: [
                behind_actuator(p, "throttle", d.grid.throttle, d.grid.t, smooth=True)
                for d in self.drives])
            seen = self._once(("pulled", *key, q.motor, q.friction, *pulled_by(p, q)), lambda: [
                pulled(p, m, one) for m, one in zip(seen, throttle(), strict=True)])
        still = self._once("resting", lambda: [resting(d) for d in self.drives])
        rest = self._once(("rest", q.body, _on(p, IMU)), lambda: [
            at_rest(d, p, True, r) for d, r in zip(self.drives, still, strict=True)])
        mine = [SENSORS.index(channel) for channel in SENSED[signal]]
        age = late + apart if signal == "gyro" else late
        return np.concatenate([part for drive, m, read in zip(self.drives, seen, rest, strict=True)
                               for part in (driven(p, m, drive, signal, age)
                                            - drive.read[~drive.still][:, mine], read[:, mine])])

    def _grids(self, p: Vehicle, q: Vehicle) -> list[Grid]:
        """The motion of each drive, without what p does to poses; q: p settled."""
        grids: list[Grid] = self._once(("grids", q.body.l_r, _on(p, POSE)),
                                       lambda: [self._grid(d, p, q) for d in self.drives])
        return grids

    def _grid(self, drive: Drive, p: Vehicle, q: Vehicle) -> Grid:
        g = drive.without_mocap_effects(p, self.l_r)
        moved = q.body.l_r - self.l_r
        return replace(g, v_y=g.v_y + moved * g.omega) if moved else g


def _kept(memory: OrderedDict[Hashable, Any], most: int, key: Hashable,
          make: Callable[[], T]) -> T:
    """What is in the memory by that key, the oldest of too many forgotten."""
    if key not in memory:
        memory[key] = make()
        if len(memory) > most:
            memory.popitem(last=False)
    memory.move_to_end(key)
    value: T = memory[key]
    return value


def _had(kind: type[Evidence], name: str, packed: bytes) -> Evidence:
    """The evidence that this process has had by that name, or what is packed."""
    if name not in HAD:
        HAD[name] = kind.__new__(kind)
        HAD[name].__dict__.update(pickle.loads(packed))
        if len(HAD) > FEW:
            HAD.popitem(last=False)
    return HAD[name]


def only_read(effect: Effect) -> bool:
    """Whether an effect changes nothing but what sensors read."""
    return (set(effect.signals) <= set(SENSED) and effect.vehicle is None
            and effect.force is None)


def _advanced(p: Vehicle, timing: Timing) -> tuple[Vehicle, Timing]:
    """The vehicle with delays counted from the messages, poses in time; and what timing is left."""
    p, behind = late_last(p, "pose")
    timing = replace(timing, late=timing.late - behind, command_age=timing.command_age - behind)
    return timing.advanced(p), timing


def _moves(p: Vehicle) -> Vehicle:
    return replace(p, effects=tuple(a for a in p.effects if not only_read(a.effect)))


def _reads(p: Vehicle, q: Vehicle, signal: str, late: float, apart: float) -> tuple[Hashable, ...]:
    """What readings of a signal depend on, of a vehicle, settled: q, and a measured motion."""
    on = _on(p, frozenset({signal}))
    drive = (q.motor, q.friction, pulled_by(p, q)) if on else ()
    return (signal, q.body, _on(p, POSE), on, drive, late, apart if signal == "gyro" else 0.0)


def _on(p: Vehicle, channels: frozenset[str]) -> tuple[ActiveEffect, ...]:
    """The effects on some signals."""
    return tuple(a for a in p.effects if channels & set(a.effect.signals))


def pulled_by(p: Vehicle, q: Vehicle) -> tuple[Hashable, ...]:
    """What the throttle behind its actuator depends on; q: p settled."""
    on = _on(p, THROTTLE)
    return (q.delay.throttle_s, q.delay.throttle_lag_s, on and q.motor.g, on)


def steered_by(p: Vehicle, q: Vehicle) -> tuple[Hashable, ...]:
    """The same of the road-wheel angle."""
    return (q.delay.steering_s, q.delay.steering_lag_s, q.steering, _on(p, STEERING))


def _held(series: FloatArray, at: IntArray) -> FloatArray:
    return np.asarray(series[at])


def _in_parts(series: FloatArray, at: IntArray) -> FloatArray:
    """Quarters of samples: of each sample once, however many windows overlap."""
    parts = quarters(series)[at]
    return np.asarray(np.swapaxes(parts, 1, 2).reshape(len(at) * FINE, at.shape[1]))


def _velocities(states: FloatArray) -> FloatArray:
    """Velocities (len(READ_OUTS), 3, n) of states (len(AT), 6, n), derived as the mocap's are."""
    near = states.reshape(len(READ_OUTS), len(OFFSETS), *states.shape[1:])
    dx, dy, omega = np.einsum("j,rjcn->crn", SLOPE, near[:, :, :3])
    c, s = np.cos(near[:, HALF, 2]), np.sin(near[:, HALF, 2])
    return np.stack([c * dx + s * dy, c * dy - s * dx, omega], axis=1)
