"""A motion capture in the virtual world, with the faults of the published recordings.

It sees a marker frame on the car, from a corner of a room that is not the
car's, with a clock of its own; where the markers sit, how late it tells and how
its clock runs is drawn from the seed. Poses are told by the world's time, so
they repeat.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from dart_hal.core.errors import UsageError
from dart_hal.core.types import ExternalPose, FloatArray, pose_cov
from dart_lab.sim.world import Truth, World

OFF = ("0", "none")
SIGNED = ("lx", "ly", "theta", "skew")


@dataclass(frozen=True, slots=True)
class MocapParams:
    """What a motion capture does to the pose of its marker frame.

    rate [Hz]; noise [m], yaw_noise [rad]: one sigma of a row; latency [s] from
    measurement to arrival, jitter [s] the most that comes on top; lx, ly [m]
    of the marker frame from the rear axle, theta [rad] to be added to its yaw;
    skew: relative error of its clock, offset [s] its reading at the world's
    zero; x, y [m], yaw [rad]: the car's start in the room. dropout: share of
    single rows that are lost; outlier: share of rows at which 1 to 3 jump;
    occlusion, lock: per minute, rows missing for 0.1 to 1.5 s, and a false
    lock, at another place for 2 to 8 s; step: jumps of its clock per minute, by
    up to a second both ways. frame: what is set up wrong, of ``FRAMES``.
    """

    rate: float = 100.0
    noise: float = 5e-4
    yaw_noise: float = 1e-3
    latency: float = 0.0
    jitter: float = 5e-4
    lx: float = 0.0
    ly: float = 0.0
    theta: float = 0.0
    skew: float = 0.0
    offset: float = 0.0
    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    dropout: float = 0.0
    outlier: float = 0.0
    occlusion: float = 0.0
    lock: float = 0.0
    step: float = 0.0
    frame: str = "right"


Seen = tuple[float, float, float]
"""x, y [m], yaw [rad]."""
HEIGHT = 0.12
"""m of the markers above the floor."""
FRAMES: dict[str, Callable[[Seen], Seen]] = {
    "right": lambda seen: seen,
    # y and yaw of a left-handed frame
    "left": lambda seen: (seen[0], -seen[1], -seen[2]),
    # y is the height and z the other way on the floor: the yaw that is left is that of a shadow
    "yup": lambda seen: (seen[0], HEIGHT, 0.0 if math.cos(seen[2]) >= 0.0 else math.pi),
    "mm": lambda seen: (1e3 * seen[0], 1e3 * seen[1], seen[2]),
    "deg": lambda seen: (seen[0], seen[1], math.degrees(math.remainder(seen[2], math.tau))),
    "other": lambda seen: seen,  # another body: it goes its own way, see ``_other``
}
"""What a program shows that takes the stream of a wrong set-up for a right one."""
OTHER_RADIUS, OTHER_SPEED = 1.2, 0.8
"""m, m/s: another car's circle about the room's origin."""

OPTIONS = tuple(f.name for f in fields(MocapParams) if f.name not in ("offset", "x", "y", "yaw"))
_MOST = {"rate": 1000.0, "latency": 1.0, "jitter": 1.0, "dropout": 0.9, "outlier": 0.3,
         "occlusion": 60.0, "lock": 30.0, "step": 60.0, "skew": 0.005}


def hidden_mocap(seed: int) -> MocapParams:
    """The motion capture of a seed; of seed 0: at the rear axle, at once, without a fault.

    Marker frames of the published recordings: 0.086 to 0.115 m before the
    axle, within 0.01 m of the middle, within 0.027 rad. Latencies of optical systems
    are some frames; 50 ppm is a plain quartz.
    """
    if seed == 0:
        return MocapParams()
    rng = np.random.default_rng([seed, 500])

    def between(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    return MocapParams(
        lx=between(0.08, 0.12), ly=between(-0.01, 0.01), theta=between(-0.03, 0.03),
        latency=between(0.003, 0.015), skew=between(-5e-5, 5e-5), offset=between(100.0, 1e5),
        x=between(-2.0, 2.0), y=between(-2.0, 2.0), yaw=between(-math.pi, math.pi), dropout=0.002)


def mocap_of(text: str, seed: int) -> MocapParams | None:
    """What ``mocap=...`` of a URL means: 1, or ``rate=50,lock=2``; None = there is none."""
    if text in OFF:
        return None
    hidden = hidden_mocap(seed)
    if text == "1":
        return hidden
    given: dict[str, float | str] = {}
    for part in text.split(","):
        name, equals, value = part.partition("=")
        if name not in OPTIONS or not equals or name in given:
            raise UsageError(f"mocap={text!r}: {part!r} is not understood", found=part,
                             expected="1, or NAME=NUMBER,... once each, of " + ", ".join(OPTIONS))
        given[name] = _frame(value) if name == "frame" else _number(name, value)
    return replace(hidden, **given)  # type: ignore[arg-type]


def _frame(text: str) -> str:
    if text not in FRAMES:
        raise UsageError(f"mocap: frame={text} makes no sense", found=text,
                         expected=" or ".join(FRAMES))
    return text


def _number(name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    most = _MOST.get(name, 10.0)
    least = -most if name in SIGNED else 1.0 if name == "rate" else 0.0
    if not least <= value <= most:
        raise UsageError(f"mocap: {name}={text} makes no sense", found=text,
                         expected=f"a number from {least:g} to {most:g}")
    return value


class SimMocap:
    """The motion capture of a world, as a source of poses (``dart_hal.core.ports.PoseSource``)."""

    name = "the motion capture of sim://"

    on_board = False

    def __init__(self, world: World, params: MocapParams) -> None:
        self._world, self._params = world, params
        seed = world.car.seed
        self._noise = np.random.default_rng([seed, 501])
        self._faults = Faults(params, np.random.default_rng([seed, 502]))
        self._clock = ClockSteps(params, np.random.default_rng([seed, 503]))
        self._row = 0
        self._next: tuple[float, float] | None = None
        self._arrived = 0.0
        self._cov = pose_cov(params.noise, params.yaw_noise)

    def poll(self, now: float) -> Sequence[ExternalPose]:
        """Rows whose arrival lies before ``now``, the world's time [s]."""
        out: list[ExternalPose] = []
        while True:
            t, arrival = self._due()
            if arrival > now:
                return out
            self._next, self._row, self._arrived = None, self._row + 1, arrival
            seen = self._faults.see(t, self._measured(t))
            stamp = self._clock.at(t)
            if seen is not None:
                out.append(ExternalPose(stamp, arrival, *self._told(seen), self._cov))

    def close(self) -> None:
        """Nothing is held."""

    def _told(self, seen: Seen) -> Seen:
        """A row in the frame that is set up; the height of ``yup`` is noisy too."""
        x, y, yaw = FRAMES[self._params.frame](seen)
        if self._params.frame == "yup":
            across, turn = self._noise.normal(size=2).tolist()
            return x, y + self._params.noise * across, yaw + self._params.yaw_noise * turn
        return x, y, yaw

    def _due(self) -> tuple[float, float]:
        """(time of measurement, arrival) of the next row [s]; rows do not overtake."""
        if self._next is None:
            p, t = self._params, self._row / self._params.rate
            late = p.latency + p.jitter * float(self._noise.uniform())
            self._next = t, max(t + late, self._arrived)
        return self._next

    def _measured(self, t: float) -> Seen:
        """x, y [m], yaw [rad] of the marker frame in the room, with noise."""
        p, true = self._params, self._world.truth(t)
        z = self._noise.normal(size=3).tolist()
        if p.frame == "other":
            true = _other(t, true)
        c, s = math.cos(true.yaw), math.sin(true.yaw)
        x, y = true.x + p.lx * c - p.ly * s, true.y + p.lx * s + p.ly * c
        c, s = math.cos(p.yaw), math.sin(p.yaw)
        return (p.x + c * x - s * y + p.noise * z[0], p.y + s * x + c * y + p.noise * z[1],
                p.yaw + true.yaw - p.theta + p.yaw_noise * z[2])


def _other(t: float, car: Truth) -> Truth:
    """Another car at t [s]: it drives its circle whatever ours does."""
    angle = OTHER_SPEED / OTHER_RADIUS * t
    return replace(car, x=OTHER_RADIUS * math.sin(angle), y=-OTHER_RADIUS * math.cos(angle),
                   yaw=angle)


class ClockSteps:
    """The clock of the motion capture's computer, which somebody sets now and then."""

    def __init__(self, params: MocapParams, rng: np.random.Generator) -> None:
        self._params, self._rng = params, rng
        self._stepped = 0.0

    def at(self, t: float) -> float:
        """Its reading at the row at t [s]; asked row by row. Never below 0."""
        p = self._params
        if p.step and self._rng.uniform() < p.step / (60.0 * p.rate):
            self._stepped += float(self._rng.uniform(-1.0, 1.0))
        return max(p.offset + t * (1.0 + p.skew) + self._stepped, 0.0)


class Faults:
    """Which rows are lost, jump, or show another place; drawn row by row."""

    def __init__(self, params: MocapParams, rng: np.random.Generator) -> None:
        self._params, self._rng = params, rng
        self._hidden_until = self._locked_until = -math.inf
        self._at: FloatArray = np.zeros(3)
        self._jumping, self._jump = 0, np.zeros(3)

    def see(self, t: float, pose: Seen
            ) -> Seen | None:
        """The row at t [s] as it is told; None = it is not."""
        p, rng = self._params, self._rng
        per_row = 1.0 / (60.0 * p.rate)
        lost, jumps, hides, locks, length = rng.uniform(size=5)
        if hides < p.occlusion * per_row and t >= self._hidden_until:
            self._hidden_until = t + 0.1 + 1.4 * length
        if locks < p.lock * per_row and t >= self._locked_until:
            self._locked_until = t + 2.0 + 6.0 * length
            away = rng.uniform(-math.pi, math.pi, 2)
            x, y, yaw = pose
            self._at = np.array((x + 5.0 * math.cos(away[0]), y + 5.0 * math.sin(away[0]),
                                 yaw + away[1]))
        if jumps < p.outlier and not self._jumping:
            self._jumping = 1 + int(3.0 * length)
            self._jump = rng.choice((-1.0, 1.0), 3) * rng.uniform((0.1, 0.1, 0.3), (0.5, 0.5, 0.7))
        if lost < p.dropout or t < self._hidden_until:
            return None
        if t < self._locked_until:
            jitter = rng.normal(size=3) * (p.noise, p.noise, p.yaw_noise)
            x, y, yaw = self._at + jitter
            return float(x), float(y), float(yaw)
        if self._jumping:
            self._jumping -= 1
            x, y, yaw = np.array(pose) + self._jump
            return float(x), float(y), float(yaw)
        return pose
