"""Tasks of the environment: observation, reward and end of an episode, for one car or many.

Everything is computed with ``Ops``, so the single and the vector environment share all formulas.
Rewards and ends depend on the true state, observations on the sensors.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

from dart_hal.control.tracks import track_named
from dart_hal.core.errors import UsageError
from dart_hal.vehicle.namespace import Value
from dart_lab.sim.gym.config import GymConfig
from dart_lab.sim.gym.lidar import MAX_RANGE
from dart_lab.sim.gym.tracks import make_locate, make_point
from dart_lab.sim.light.ops import Ops
from dart_lab.sim.light.sense import Reading
from dart_lab.sim.light.world import CAR_OUTLINE

# Arc lengths from the closest point to the observed points of the path [m].
LOOKAHEADS = (0.2, 0.4, 0.6, 0.9, 1.2)
# Number of uniform draws of a reset for a task.
TASK_DRAWS = 8
# Largest offset [m] and heading error [rad] at the start of a path episode.
START_OFFSET = 0.1
START_HEADING = 0.2
# Weight of the squared change of the commands in the reward.
EFFORT_WEIGHT = 0.05
# Reward of a step that leaves the track or touches another car.
OFF_TRACK_REWARD = -10.0
# Smallest and largest speed of the opponents, relative to the reference speed.
OPPONENT_SPEEDS = (0.3, 0.6)
# Number of reference speeds in an episode of the speed task.
SPEED_LEVELS = 4
# Smallest reference speed of the speed task [m/s].
MIN_REFERENCE_SPEED = 0.4

Limits = tuple[tuple[str, float], ...]
_COMMON: Limits = (("speed", 10.0), ("yaw_rate", 35.0), ("throttle", 1.0), ("steering", 1.0),
                   ("reference_speed", 10.0))


class StepOutcome(NamedTuple):
    """Result of one step: reward, terminated, and true values for ``info``."""

    reward: Value
    terminated: Any
    info: dict[str, Value]


class Memory(NamedTuple):
    """State of a task between steps, per car.

    s: arc length [m], which grows over laps; in the speed task the number of steps. kept: speed
    levels of the speed task; on a path the speed of the opponents [m/s], then arc length and
    offset to the left [m] of each.
    """

    s: Value
    kept: tuple[Value, ...]


class Task(Protocol):
    """A task; limits: name and largest magnitude of every observed number; draws: number of uniform
    draws of a reset."""

    limits: Limits
    draws: int

    def start(self, u: Sequence[Value]) -> tuple[tuple[Value, ...], Memory]:
        """Return the start state of the centre of mass (6) and the memory from uniform numbers."""

    def observe(self, r: Reading, command: Sequence[Value], m: Memory) -> list[Value]:
        """Return the observation before it is clipped to the limits."""

    def judge(self, state: Sequence[Value], change: Value, k: Value,
              m: Memory) -> tuple[StepOutcome, Memory]:
        """Return the outcome of step k; change: squared change of the commands."""


class PathTask:
    """Follow a closed path at a reference speed with the rear axle."""

    def __init__(self, c: GymConfig, ops: Ops, l_r: float) -> None:
        track = track_named(c.track)
        if not track.closed:
            raise UsageError("the track of the environment must be closed", found="an open path",
                             remedy="docs/how_to/following.md lists the tracks")
        self._config = c
        self._ops = ops
        self._l_r = l_r
        self._length = track.length
        self._point = make_point(track, ops)
        self._locate = make_locate(track, ops)
        self.limits: Limits = (*_COMMON, ("offset", 2.0), ("heading", math.pi), *(
            (f"{axis}_{ahead:g}", 5.0) for ahead in LOOKAHEADS for axis in ("x", "y")), *(
            (f"range_{360.0 * k / c.beams:g}", MAX_RANGE) for k in range(c.beams)))
        self.draws = TASK_DRAWS + 2 * c.opponents

    def start(self, u: Sequence[Value]) -> tuple[tuple[Value, ...], Memory]:
        f = self._ops.f
        s = u[0] * self._length
        x, y, heading, _ = self._point(s)
        left = START_OFFSET * (2.0 * u[1] - 1.0)
        yaw = heading + START_HEADING * (2.0 * u[2] - 1.0)
        zero = 0.0 * s
        return ((x - left * f.sin(heading) + self._l_r * f.cos(yaw),
                 y + left * f.cos(heading) + self._l_r * f.sin(yaw), yaw,
                 u[3] * self._config.speed, zero, zero), Memory(s, self._opponents(u, s)))

    def _opponents(self, u: Sequence[Value], s: Value) -> tuple[Value, ...]:
        """Return slower cars, spread over the lap ahead of the car, each with its own offset."""
        c = self._config
        n = c.opponents
        low = OPPONENT_SPEEDS[0]
        if not n:
            return ()
        kept = [c.speed * (low + (OPPONENT_SPEEDS[1] - low) * u[4])]
        for k, (where, side) in enumerate(zip(u[TASK_DRAWS::2], u[TASK_DRAWS + 1::2], strict=True)):
            gap = self._length / (n + 1)
            kept += [s + gap * (k + 0.75 + 0.5 * where), c.half_width * (side - 0.5)]
        return tuple(kept)

    def others(self, kept: tuple[Value, ...]) -> list[tuple[Value, Value, Value]]:
        """Return x, y [m], yaw [rad] of the opponents' rear axles."""
        f = self._ops.f
        poses = []
        for s, left in zip(kept[1::2], kept[2::2], strict=True):
            x, y, heading, _ = self._point(s)
            poses.append((x - left * f.sin(heading), y + left * f.cos(heading), heading))
        return poses

    def observe(self, r: Reading, command: Sequence[Value], m: Memory) -> list[Value]:
        f = self._ops.f
        s, offset, heading = self._locate(r.x, r.y, m.s)
        c = f.cos(r.yaw)
        d = f.sin(r.yaw)
        values = [r.speed, r.yaw_rate, *command, 0.0 * s + self._config.speed, offset,
                  self._wrap_angle(r.yaw - heading)]
        for ahead in LOOKAHEADS:
            x, y, _, _ = self._point(s + ahead)
            # A point ahead, in the frame of the rear axle.
            values += [(x - r.x) * c + (y - r.y) * d, (y - r.y) * c - (x - r.x) * d]
        return values

    def judge(self, state: Sequence[Value], change: Value, k: Value,
              m: Memory) -> tuple[StepOutcome, Memory]:
        f = self._ops.f
        c = self._config
        x, y, yaw = self.rear_axle(state)
        s, offset, heading = self._locate(x, y, m.s)
        kept = self._advance_opponents(m.kept)
        # Reward: 1 - speed error - squared offset - effort, with progress along the path as speed.
        off = f.fabs(offset) > c.half_width
        progress = (s - m.s) / c.period
        good = 1.0 - f.fmin(2.0, f.fabs(progress - c.speed) / c.speed) - (
            offset / c.half_width) ** 2 - EFFORT_WEIGHT * change
        info = {"s": s, "offset": offset, "heading": self._wrap_angle(yaw - heading),
                "speed": state[3]}
        if c.opponents:
            info["contact"] = contact = self._touches((x, y, yaw), kept)
            off = self._ops.either(off, contact > 0.0)
        reward = self._ops.choose(off, OFF_TRACK_REWARD + 0.0 * good, good)
        return StepOutcome(reward, off, info), Memory(s, kept)

    def rear_axle(self, state: Sequence[Value]) -> tuple[Value, Value, Value]:
        """Return x, y [m], yaw [rad] of the rear axle from a state of the centre of mass."""
        x, y, yaw = state[:3]
        return x - self._l_r * self._ops.f.cos(yaw), y - self._l_r * self._ops.f.sin(yaw), yaw

    def _advance_opponents(self, kept: tuple[Value, ...]) -> tuple[Value, ...]:
        """Return the memory with the opponents advanced by one step."""
        return (*kept[:1], *(v + kept[0] * self._config.period if k % 2 == 0 else v
                             for k, v in enumerate(kept[1:])))

    def _touches(self, pose: tuple[Value, Value, Value], kept: tuple[Value, ...]) -> Value:
        """Return 1 where the car's outline overlaps that of an opponent, else 0.

        Separating axes: two rectangles overlap unless they are separate along a side of one.
        """
        f = self._ops.f
        ops = self._ops
        x, y, yaw = pose
        half_l = 0.5 * CAR_OUTLINE.length
        half_w = 0.5 * CAR_OUTLINE.width
        found = 0.0 * x
        for ox, oy, turn in self.others(kept):
            dx = ox - x + CAR_OUTLINE.ahead * (f.cos(turn) - f.cos(yaw))
            dy = oy - y + CAR_OUTLINE.ahead * (f.sin(turn) - f.sin(yaw))
            c = f.fabs(f.cos(turn - yaw))
            s = f.fabs(f.sin(turn - yaw))
            # Largest gap between the projections of both on the four sides; negative: overlap.
            gap = -1.0 + 0.0 * x
            for angle in (yaw, turn):
                ahead = dx * f.cos(angle) + dy * f.sin(angle)
                left = dy * f.cos(angle) - dx * f.sin(angle)
                gap = f.fmax(gap, f.fmax(
                    f.fabs(ahead) - half_l * (1.0 + c) - half_w * s,
                    f.fabs(left) - half_w * (1.0 + c) - half_l * s))
            found = ops.choose(gap < 0.0, 1.0 + found * 0.0, found)
        return found

    def _wrap_angle(self, angle: Value) -> Value:
        """Return the same angle between -pi and pi."""
        return self._ops.f.atan2(self._ops.f.sin(angle), self._ops.f.cos(angle))


class SpeedTask:
    """Follow reference speeds that change, and drive straight."""

    def __init__(self, c: GymConfig, ops: Ops, l_r: float) -> None:
        self._config = c
        self._ops = ops
        self.limits: Limits = (*_COMMON, ("error", 10.0))
        self.draws = TASK_DRAWS

    def start(self, u: Sequence[Value]) -> tuple[tuple[Value, ...], Memory]:
        zero = 0.0 * u[0]
        low = min(MIN_REFERENCE_SPEED, self._config.speed)
        levels = tuple(low + (self._config.speed - low) * v for v in u[1:1 + SPEED_LEVELS])
        return ((zero, zero, zero, u[0] * self._config.speed, zero, zero), Memory(zero, levels))

    def rear_axle(self, state: Sequence[Value]) -> tuple[Value, Value, Value]:
        """Return x, y [m], yaw [rad] of the centre of mass, which no lidar uses in this task."""
        return state[0], state[1], state[2]

    def others(self, kept: tuple[Value, ...]) -> list[tuple[Value, Value, Value]]:
        """Return no opponents."""
        return []

    def _reference(self, m: Memory) -> Value:
        """Return the reference speed [m/s]; ``m.s`` is the number of steps in the episode."""
        part = self._config.limit / SPEED_LEVELS
        now = m.kept[0]
        for i, level in enumerate(m.kept[1:], start=1):
            now = self._ops.choose(m.s >= i * part, level, now)
        return now

    def observe(self, r: Reading, command: Sequence[Value], m: Memory) -> list[Value]:
        reference = self._reference(m)
        return [r.speed, r.yaw_rate, *command, reference, reference - r.speed]

    def judge(self, state: Sequence[Value], change: Value, k: Value,
              m: Memory) -> tuple[StepOutcome, Memory]:
        f = self._ops.f
        error = self._reference(m) - state[3]
        good = 1.0 - f.fmin(2.0, f.fabs(error)) - 0.1 * f.fmin(10.0, f.fabs(state[5])) - (
            EFFORT_WEIGHT * change)
        info = {"speed": state[3], "error": error}
        never = f.fabs(error) < 0.0
        return StepOutcome(good, never, info), Memory(1.0 * k, m.kept)


def make_task(c: GymConfig, ops: Ops, l_r: float) -> PathTask | SpeedTask:
    """Make the task of a configuration, for one car or many."""
    return (PathTask if c.task == "path" else SpeedTask)(c, ops, l_r)
