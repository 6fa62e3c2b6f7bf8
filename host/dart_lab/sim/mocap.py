"""A motion capture in the virtual world, with the faults of the published recordings.

It measures a marker frame on the car, in the coordinates of its room and with its own clock. The
position of the markers, the latency and the clock are drawn from the seed. Poses depend on the
world's time alone, so a run is repeatable.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from dart_hal.core.errors import UsageError
from dart_hal.core.types import ExternalPose, FloatArray, pose_cov
from dart_lab.sim.world import Truth, World

MOCAP_OFF = ("0", "none")
# Options that may be negative.
SIGNED_OPTIONS = ("lx", "ly", "theta", "skew")


@dataclass(frozen=True, slots=True)
class MocapParams:
    """Parameters and faults of a motion capture.

    rate [Hz]; noise [m], yaw_noise [rad]: one sigma of a row; latency [s] from
    measurement to arrival, jitter [s] the most that comes on top; lx, ly [m]
    of the marker frame from the rear axle, theta [rad] to be added to its yaw;
    skew: relative error of its clock, offset [s] its reading at the world's
    zero; x, y [m], yaw [rad]: the car's start in the room. dropout: share of
    single rows that are lost; outlier: share of rows at which 1 to 3 jump;
    occlusion, lock: per minute, rows missing for 0.1 to 1.5 s, and a false
    lock, at another place for 2 to 8 s; step: jumps of its clock per minute, by
    up to a second both ways. frame: what is set up wrong, of ``FRAME_ERRORS``.
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


# x, y [m], yaw [rad].
PlanarPose = tuple[float, float, float]
# Height of the markers above the floor [m].
MARKER_HEIGHT = 0.12
# Poses as a program shows them that expects the frame "right", by the frame of the stream.
FRAME_ERRORS: dict[str, Callable[[PlanarPose], PlanarPose]] = {
    "right": lambda pose: pose,
    # y and yaw of a left-handed frame
    "left": lambda pose: (pose[0], -pose[1], -pose[2]),
    # y is the height and z points the other way on the floor, so only the sign of cos(yaw) remains
    "yup": lambda pose: (pose[0], MARKER_HEIGHT, 0.0 if math.cos(pose[2]) >= 0.0 else math.pi),
    "mm": lambda pose: (1e3 * pose[0], 1e3 * pose[1], pose[2]),
    "deg": lambda pose: (pose[0], pose[1], math.degrees(math.remainder(pose[2], math.tau))),
    # another body, see ``_other_car``
    "other": lambda pose: pose,
}
# Circle of the other car about the room's origin [m, m/s].
OTHER_RADIUS = 1.2
OTHER_SPEED = 0.8

MOCAP_OPTIONS = tuple(f.name for f in fields(MocapParams)
                      if f.name not in ("offset", "x", "y", "yaw"))
_MAX_VALUES = {"rate": 1000.0, "latency": 1.0, "jitter": 1.0, "dropout": 0.9, "outlier": 0.3,
               "occlusion": 60.0, "lock": 30.0, "step": 60.0, "skew": 0.005}


def hidden_mocap(seed: int) -> MocapParams:
    """Return the motion capture of a seed; seed 0: at the rear axle, no latency, no faults.

    Marker frames of the published recordings are 0.086 to 0.115 m before the axle, within 0.01 m
    of the middle and within 0.027 rad. Optical systems have a latency of some frames. 50 ppm is
    the error of a plain quartz.
    """
    if seed == 0:
        return MocapParams()
    rng = np.random.default_rng([seed, 500])

    def draw(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    return MocapParams(
        lx=draw(0.08, 0.12), ly=draw(-0.01, 0.01), theta=draw(-0.03, 0.03),
        latency=draw(0.003, 0.015), skew=draw(-5e-5, 5e-5), offset=draw(100.0, 1e5),
        x=draw(-2.0, 2.0), y=draw(-2.0, 2.0), yaw=draw(-math.pi, math.pi), dropout=0.002)


def parse_mocap(text: str, seed: int) -> MocapParams | None:
    """Parse ``mocap=...`` of a URL: 1, or ``rate=50,lock=2``; None = no motion capture."""
    if text in MOCAP_OFF:
        return None
    hidden = hidden_mocap(seed)
    if text == "1":
        return hidden
    given: dict[str, float | str] = {}
    for part in text.split(","):
        name, equals, value = part.partition("=")
        if name not in MOCAP_OPTIONS or not equals or name in given:
            raise UsageError(f"mocap={text!r}: {part!r} is not understood", found=part,
                             expected="1, or NAME=NUMBER,... once each, of "
                                      + ", ".join(MOCAP_OPTIONS))
        given[name] = _parse_frame(value) if name == "frame" else _parse_number(name, value)
    return replace(hidden, **given)  # type: ignore[arg-type]


def _parse_frame(text: str) -> str:
    if text not in FRAME_ERRORS:
        raise UsageError(f"mocap: frame={text} does not exist", found=text,
                         expected=" or ".join(FRAME_ERRORS))
    return text


def _parse_number(name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    most = _MAX_VALUES.get(name, 10.0)
    least = -most if name in SIGNED_OPTIONS else 1.0 if name == "rate" else 0.0
    if not least <= value <= most:
        raise UsageError(f"mocap: {name}={text} is out of range", found=text,
                         expected=f"a number from {least:g} to {most:g}")
    return value


class SimMocap:
    """The motion capture of a world, as a source of poses (``dart_hal.core.ports.PoseSource``)."""

    name = "the motion capture of sim://"

    on_board = False
    map_std = 0.0

    def __init__(self, world: World, params: MocapParams) -> None:
        self._world = world
        self._params = params
        seed = world.car.seed
        self._noise = np.random.default_rng([seed, 501])
        self._faults = MocapFaults(params, np.random.default_rng([seed, 502]))
        self._clock = MocapClock(params, np.random.default_rng([seed, 503]))
        self._row = 0
        self._next: tuple[float, float] | None = None
        self._arrived = 0.0
        self._cov = pose_cov(params.noise, params.yaw_noise)

    def poll(self, now: float) -> Sequence[ExternalPose]:
        """Return the poses that have arrived by ``now``, in the world's time [s]."""
        out: list[ExternalPose] = []
        while True:
            t, arrival = self._next_row_times()
            if arrival > now:
                return out
            self._next = None
            self._row += 1
            self._arrived = arrival
            pose = self._faults.apply(t, self._measure(t))
            stamp = self._clock.read(t)
            if pose is not None:
                out.append(ExternalPose(stamp, arrival, *self._to_frame(pose), self._cov))

    def close(self) -> None:
        """Do nothing: there is nothing to release."""

    def _to_frame(self, pose: PlanarPose) -> PlanarPose:
        """Return a pose in the frame of the set-up; the height of ``yup`` is noisy too."""
        x, y, yaw = FRAME_ERRORS[self._params.frame](pose)
        if self._params.frame == "yup":
            lateral, turn = self._noise.normal(size=2).tolist()
            return x, y + self._params.noise * lateral, yaw + self._params.yaw_noise * turn
        return x, y, yaw

    def _next_row_times(self) -> tuple[float, float]:
        """Return (time of measurement, arrival) of the next pose [s]; poses never overtake."""
        if self._next is None:
            p = self._params
            t = self._row / self._params.rate
            delay = p.latency + p.jitter * float(self._noise.uniform())
            self._next = t, max(t + delay, self._arrived)
        return self._next

    def _measure(self, t: float) -> PlanarPose:
        """Return x, y [m], yaw [rad] of the marker frame in the room, with noise."""
        p = self._params
        true = self._world.truth(t)
        z = self._noise.normal(size=3).tolist()
        if p.frame == "other":
            true = _other_car(t, true)
        # From the rear axle to the markers, then from the frame of the start to that of the room.
        c = math.cos(true.yaw)
        s = math.sin(true.yaw)
        x = true.x + p.lx * c - p.ly * s
        y = true.y + p.lx * s + p.ly * c
        c = math.cos(p.yaw)
        s = math.sin(p.yaw)
        return (p.x + c * x - s * y + p.noise * z[0], p.y + s * x + c * y + p.noise * z[1],
                p.yaw + true.yaw - p.theta + p.yaw_noise * z[2])


def _other_car(t: float, car: Truth) -> Truth:
    """Return the state of another car at t [s], which drives on a circle."""
    angle = OTHER_SPEED / OTHER_RADIUS * t
    return replace(car, x=OTHER_RADIUS * math.sin(angle), y=-OTHER_RADIUS * math.cos(angle),
                   yaw=angle)


class MocapClock:
    """The clock of the motion capture's computer, which is set to another time now and then."""

    def __init__(self, params: MocapParams, rng: np.random.Generator) -> None:
        self._params = params
        self._rng = rng
        self._stepped = 0.0

    def read(self, t: float) -> float:
        """Return the stamp of the pose at t [s], at least 0; to be called once for each pose."""
        p = self._params
        if p.step and self._rng.uniform() < p.step / (60.0 * p.rate):
            self._stepped += float(self._rng.uniform(-1.0, 1.0))
        return max(p.offset + t * (1.0 + p.skew) + self._stepped, 0.0)


class MocapFaults:
    """Faults of a motion capture: poses that are lost, jump, or are of another place."""

    def __init__(self, params: MocapParams, rng: np.random.Generator) -> None:
        self._params = params
        self._rng = rng
        self._hidden_until = self._locked_until = -math.inf
        self._locked_pose: FloatArray = np.zeros(3)
        self._jumping = 0
        self._jump = np.zeros(3)

    def apply(self, t: float, pose: PlanarPose) -> PlanarPose | None:
        """Return the pose at t [s] with the faults, None = it is lost.

        Five uniform numbers are drawn for each pose, whatever faults are active. A false lock or
        an outlier draws further ones when it begins.
        """
        p = self._params
        rng = self._rng
        per_row = 1.0 / (60.0 * p.rate)
        lost, jumps, hides, locks, length = rng.uniform(size=5)
        if hides < p.occlusion * per_row and t >= self._hidden_until:
            self._hidden_until = t + 0.1 + 1.4 * length
        if locks < p.lock * per_row and t >= self._locked_until:
            self._locked_until = t + 2.0 + 6.0 * length
            angles = rng.uniform(-math.pi, math.pi, 2)
            x, y, yaw = pose
            self._locked_pose = np.array((x + 5.0 * math.cos(angles[0]),
                                          y + 5.0 * math.sin(angles[0]), yaw + angles[1]))
        if jumps < p.outlier and not self._jumping:
            self._jumping = 1 + int(3.0 * length)
            self._jump = rng.choice((-1.0, 1.0), 3) * rng.uniform((0.1, 0.1, 0.3), (0.5, 0.5, 0.7))
        if lost < p.dropout or t < self._hidden_until:
            return None
        if t < self._locked_until:
            jitter = rng.normal(size=3) * (p.noise, p.noise, p.yaw_noise)
            x, y, yaw = self._locked_pose + jitter
            return float(x), float(y), float(yaw)
        if self._jumping:
            self._jumping -= 1
            x, y, yaw = np.array(pose) + self._jump
            return float(x), float(y), float(yaw)
        return pose
