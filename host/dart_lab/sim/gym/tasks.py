"""What the car is asked to do: observation, reward and end, for one car or many.

Everything is computed with ``Ops``, so that the single and the vector
environment are the same formulas. Rewards and ends are judged by the truth,
observations come from the sensors.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

from dart_hal.control.tracks import track_named
from dart_hal.core.errors import UsageError
from dart_hal.vehicle.namespace import Value
from dart_lab.sim.gym.config import GymConfig
from dart_lab.sim.gym.lidar import BODY as OUTLINE
from dart_lab.sim.gym.lidar import MOST
from dart_lab.sim.gym.tracks import make_locate, make_point
from dart_lab.sim.light.ops import Ops
from dart_lab.sim.light.sense import Reading

AHEAD = (0.2, 0.4, 0.6, 0.9, 1.2)
"""m along the path from the closest point: the points that are observed."""
DRAWS = 8
"""Uniform numbers of 0 to 1 that a reset draws for a task."""
START_OFFSET, START_HEADING = 0.1, 0.2
"""m and rad: a path episode starts at most this far off."""
EFFORT = 0.05
"""Reward lost per squared change of a command."""
OFF_TRACK = -10.0
"""Reward of the step that leaves the track."""
SLOWER = (0.3, 0.6)
"""Least and largest share of the reference speed at which the opponents of an episode drive."""
LEVELS = 4
"""Reference speeds of an episode of the speed task."""
SLOWEST = 0.4
"""m/s, the least reference of the speed task."""

Limits = tuple[tuple[str, float], ...]
_COMMON: Limits = (("speed", 10.0), ("yaw_rate", 35.0), ("throttle", 1.0), ("steering", 1.0),
                   ("reference_speed", 10.0))


class Outcome(NamedTuple):
    """Of one step: reward, terminated, and true values for ``info``."""

    reward: Value
    terminated: Any
    info: dict[str, Value]


class Memory(NamedTuple):
    """What a task keeps between steps, per car; ``s`` grows over laps.

    kept: levels of the speed task; on a path the speed of the opponents [m/s], then arc length
    and distance to the left [m] of each.
    """

    s: Value
    kept: tuple[Value, ...]


class Task(Protocol):
    """``limits``: name and largest magnitude of every observed number; ``draws``: uniform numbers
    that a reset needs."""

    limits: Limits
    draws: int

    def start(self, u: Sequence[Value]) -> tuple[tuple[Value, ...], Memory]:
        """State of the centre of mass (6) and memory, from ``DRAWS`` uniform numbers."""

    def observe(self, r: Reading, command: Sequence[Value], m: Memory) -> list[Value]:
        """The observation, before it is clipped to the limits."""

    def judge(self, state: Sequence[Value], change: Value, k: Value,
              m: Memory) -> tuple[Outcome, Memory]:
        """Outcome of a step of the environment, the k-th; change: squared, of the commands."""


class PathTask:
    """Follow a closed path at a reference speed with the rear axle."""

    def __init__(self, c: GymConfig, ops: Ops, l_r: float) -> None:
        track = track_named(c.track)
        if not track.closed:
            raise UsageError("a track of the environment is closed", found="an open path",
                             remedy="docs/how_to/following.md lists the tracks")
        self._c, self._ops, self._l_r, self._length = c, ops, l_r, track.length
        self._point, self._locate = make_point(track, ops), make_locate(track, ops)
        self.limits: Limits = (*_COMMON, ("offset", 2.0), ("heading", math.pi), *(
            (f"{axis}_{ahead:g}", 5.0) for ahead in AHEAD for axis in ("x", "y")), *(
            (f"range_{360.0 * k / c.beams:g}", MOST) for k in range(c.beams)))
        self.draws = DRAWS + 2 * c.opponents

    def start(self, u: Sequence[Value]) -> tuple[tuple[Value, ...], Memory]:
        f = self._ops.f
        s = u[0] * self._length
        x, y, heading, _ = self._point(s)
        left = START_OFFSET * (2.0 * u[1] - 1.0)
        yaw = heading + START_HEADING * (2.0 * u[2] - 1.0)
        zero = 0.0 * s
        return ((x - left * f.sin(heading) + self._l_r * f.cos(yaw),
                 y + left * f.cos(heading) + self._l_r * f.sin(yaw), yaw,
                 u[3] * self._c.speed, zero, zero), Memory(s, self._opponents(u, s)))

    def _opponents(self, u: Sequence[Value], s: Value) -> tuple[Value, ...]:
        """Slower cars, spread over the lap before the car, each in its own lane."""
        c, n, low = self._c, self._c.opponents, SLOWER[0]
        if not n:
            return ()
        kept = [c.speed * (low + (SLOWER[1] - low) * u[4])]
        for k, (where, side) in enumerate(zip(u[DRAWS::2], u[DRAWS + 1::2], strict=True)):
            apart = self._length / (n + 1)
            kept += [s + apart * (k + 0.75 + 0.5 * where), c.half_width * (side - 0.5)]
        return tuple(kept)

    def others(self, kept: tuple[Value, ...]) -> list[tuple[Value, Value, Value]]:
        """x, y [m], yaw [rad] of the opponents' rear axles."""
        f, found = self._ops.f, []
        for s, left in zip(kept[1::2], kept[2::2], strict=True):
            x, y, heading, _ = self._point(s)
            found.append((x - left * f.sin(heading), y + left * f.cos(heading), heading))
        return found

    def observe(self, r: Reading, command: Sequence[Value], m: Memory) -> list[Value]:
        f = self._ops.f
        s, offset, heading = self._locate(r.x, r.y, m.s)
        c, d = f.cos(r.yaw), f.sin(r.yaw)
        seen = [r.speed, r.yaw_rate, *command, 0.0 * s + self._c.speed, offset,
                self._turn(r.yaw - heading)]
        for ahead in AHEAD:
            x, y, _, _ = self._point(s + ahead)
            seen += [(x - r.x) * c + (y - r.y) * d, (y - r.y) * c - (x - r.x) * d]
        return seen

    def judge(self, state: Sequence[Value], change: Value, k: Value,
              m: Memory) -> tuple[Outcome, Memory]:
        f, c = self._ops.f, self._c
        x, y, yaw = self.rear_axle(state)
        s, offset, heading = self._locate(x, y, m.s)
        kept = self._moved(m.kept)
        off = f.fabs(offset) > c.half_width
        progress = (s - m.s) / c.period
        good = 1.0 - f.fmin(2.0, f.fabs(progress - c.speed) / c.speed) - (
            offset / c.half_width) ** 2 - EFFORT * change
        info = {"s": s, "offset": offset, "heading": self._turn(yaw - heading),
                "speed": state[3]}
        if c.opponents:
            info["contact"] = contact = self._touches((x, y, yaw), kept)
            off = self._ops.either(off, contact > 0.0)
        reward = self._ops.choose(off, OFF_TRACK + 0.0 * good, good)
        return Outcome(reward, off, info), Memory(s, kept)

    def rear_axle(self, state: Sequence[Value]) -> tuple[Value, Value, Value]:
        """x, y [m], yaw [rad] of a state of the centre of mass."""
        x, y, yaw = state[0], state[1], state[2]
        return x - self._l_r * self._ops.f.cos(yaw), y - self._l_r * self._ops.f.sin(yaw), yaw

    def _moved(self, kept: tuple[Value, ...]) -> tuple[Value, ...]:
        """The opponents, one step further."""
        return (*kept[:1], *(v + kept[0] * self._c.period if k % 2 == 0 else v
                             for k, v in enumerate(kept[1:])))

    def _touches(self, pose: tuple[Value, Value, Value], kept: tuple[Value, ...]) -> Value:
        """1 where the car's outline overlaps an opponent's, else 0: no side of either has the other
        wholly beyond it."""
        f, ops, (x, y, yaw) = self._ops.f, self._ops, pose
        half_l, half_w = 0.5 * OUTLINE.length, 0.5 * OUTLINE.width
        found = 0.0 * x
        for ox, oy, turn in self.others(kept):
            dx = ox - x + OUTLINE.ahead * (f.cos(turn) - f.cos(yaw))
            dy = oy - y + OUTLINE.ahead * (f.sin(turn) - f.sin(yaw))
            c, s = f.fabs(f.cos(turn - yaw)), f.fabs(f.sin(turn - yaw))
            apart = -1.0 + 0.0 * x
            for at in (yaw, turn):
                ahead, left = dx * f.cos(at) + dy * f.sin(at), dy * f.cos(at) - dx * f.sin(at)
                apart = f.fmax(apart, f.fmax(
                    f.fabs(ahead) - half_l * (1.0 + c) - half_w * s,
                    f.fabs(left) - half_w * (1.0 + c) - half_l * s))
            found = ops.choose(apart < 0.0, 1.0 + found * 0.0, found)
        return found

    def _turn(self, angle: Value) -> Value:
        """The same angle between -pi and pi."""
        return self._ops.f.atan2(self._ops.f.sin(angle), self._ops.f.cos(angle))


class SpeedTask:
    """Hold reference speeds that change, and go straight."""

    def __init__(self, c: GymConfig, ops: Ops, l_r: float) -> None:
        self._c, self._ops = c, ops
        self.limits: Limits = (*_COMMON, ("error", 10.0))
        self.draws = DRAWS

    def start(self, u: Sequence[Value]) -> tuple[tuple[Value, ...], Memory]:
        zero = 0.0 * u[0]
        low = min(SLOWEST, self._c.speed)
        levels = tuple(low + (self._c.speed - low) * v for v in u[1:1 + LEVELS])
        return ((zero, zero, zero, u[0] * self._c.speed, zero, zero), Memory(zero, levels))

    def rear_axle(self, state: Sequence[Value]) -> tuple[Value, Value, Value]:
        """The car alone counts here."""
        return state[0], state[1], state[2]

    def others(self, kept: tuple[Value, ...]) -> list[tuple[Value, Value, Value]]:
        """Nobody."""
        return []

    def _reference(self, m: Memory) -> Value:
        """``m.s`` counts the steps of the episode."""
        part = self._c.limit / LEVELS
        now = m.kept[0]
        for i, level in enumerate(m.kept[1:], start=1):
            now = self._ops.choose(m.s >= i * part, level, now)
        return now

    def observe(self, r: Reading, command: Sequence[Value], m: Memory) -> list[Value]:
        wanted = self._reference(m)
        return [r.speed, r.yaw_rate, *command, wanted, wanted - r.speed]

    def judge(self, state: Sequence[Value], change: Value, k: Value,
              m: Memory) -> tuple[Outcome, Memory]:
        f, wanted = self._ops.f, self._reference(m)
        error = wanted - state[3]
        good = 1.0 - f.fmin(2.0, f.fabs(error)) - 0.1 * f.fmin(10.0, f.fabs(state[5])) - (
            EFFORT * change)
        info = {"speed": state[3], "error": error}
        never = f.fabs(error) < 0.0
        return Outcome(good, never, info), Memory(1.0 * k, m.kept)


def make_task(c: GymConfig, ops: Ops, l_r: float) -> PathTask | SpeedTask:
    """The task of a configuration, for one car or many."""
    return (PathTask if c.task == "path" else SpeedTask)(c, ops, l_r)
