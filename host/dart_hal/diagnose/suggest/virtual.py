"""A drive that nobody has driven: a recording of a car with known effects, free of noise.

What the noise would do is known from the data at hand; here only the
difference between two cars counts.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path

import numpy as np

from dart_hal.identify.commands import actuated
from dart_hal.recording.dart import Grid, Messages, Mocap, Recording, Reference
from dart_hal.recording.dart.model import freeze, freeze_flags, freeze_index
from dart_hal.types import FloatArray
from dart_hal.vehicle.batch import rollout
from dart_hal.vehicle.channels import through
from dart_hal.vehicle.compose import settled
from dart_hal.vehicle.effect import Now
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.motor import make_motor
from dart_hal.vehicle.namespace import ARRAY
from dart_hal.vehicle.parameters import GEAR_REVOLUTION, Vehicle

from ..drive import STEP, held

EVERY = 10  # samples from message to message
AHEAD = 0.05
"""s that a command acts before the message that tells of it: the middle of what a 10 Hz log
leaves open, so that a hypothesis may hide behind it to both sides."""
STANDS = 0.02
"""m/s; below it hardly a mark passes in 0.1 s, and what the equations creep at rest is not real."""
EPOCH = datetime(2024, 9, 8, tzinfo=timezone.utc).timestamp()


@dataclass(frozen=True, slots=True)
class Commands:
    """throttle, steering -1..1, (n,) on a grid of 0.01 s."""

    throttle: FloatArray
    steering: FloatArray

    @property
    def seconds(self) -> float:
        return len(self.throttle) * STEP


def record(p: Vehicle, commands: Commands, reference: Reference, name: str = "drive",
           yaw: float = 0.0) -> Recording:
    """The drive of the car p, from standstill at heading ``yaw`` [rad]."""
    n = len(commands.throttle)
    when = np.arange(EVERY, n - 1, EVERY)
    sent = np.asarray(when * STEP, dtype=np.float64)
    # the last 10 Hz decide what the car gets, as with the logger of the recordings
    index = np.clip(when - round(AHEAD / STEP), 0, n - 1)
    throttle, steering = commands.throttle[index], commands.steering[index]
    g = _grid(n, held(sent - AHEAD, throttle, n), held(sent - AHEAD, steering, n), reference)
    tau, angle = actuated(p, g, smooth=True)
    start = np.array([[0.0], [0.0], [yaw], [0.0], [0.0], [0.0]])
    s = rollout(p, start, tau[:-1, None], angle[:-1, None], at=range(n))[:, :, 0]
    speed, rate, a_x, a_y = _sensors(p, g, s, tau)
    mocap = _mocap(p, g, s, settled(p).body.l_r)
    way = np.concatenate([[0.0], np.cumsum(0.5 * np.abs(speed[1:] + speed[:-1]))])
    counted = (way[when] - way[when - EVERY]) / EVERY
    m = Messages(
        t=freeze(sent), arrival=freeze(sent), segment=freeze_index(np.zeros(len(sent))),
        throttle=freeze(throttle), throttle_raw=freeze(throttle), steering=freeze(steering),
        gate=freeze_flags(np.ones(len(sent))),
        speed=freeze(np.where(counted < STANDS, 0.0, counted)), yaw_rate=freeze(rate[when]),
        accel_x=freeze(a_x[when]), accel_y=freeze(a_y[when]))
    return Recording(Path("suggested") / name, "B", m, mocap, "ok", None, "", ())


def _grid(n: int, throttle: FloatArray, steering: FloatArray, reference: Reference) -> Grid:
    none = np.zeros(n)
    t = np.asarray(np.arange(n) * STEP, dtype=np.float64)
    return Grid(t, none, none, none, none, none, none, throttle, steering,
                none, np.zeros(n, dtype=np.bool_), reference)


def _now(p: Vehicle, g: Grid, s: FloatArray, tau: FloatArray) -> Now:
    """states s (n, 6) of the centre of mass as the sensors' effects see them."""
    q = settled(p)
    _, _, yaw, v_x, v_y, omega = s.T
    rates = [np.gradient(v, STEP) for v in (v_x, v_y, omega)]
    force = make_motor(q.motor, ARRAY)(tau, v_x) + make_friction(q.friction, ARRAY)(v_x)
    return Now(g.t, v_x, v_y, omega, yaw, rates[0] - omega * v_y, rates[1] + omega * v_x,
               rates[2], force, np.cumsum(v_x) * STEP / GEAR_REVOLUTION)


def _sensors(p: Vehicle, g: Grid, s: FloatArray, tau: FloatArray
             ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    now = _now(p, g, s, tau)
    a_x, a_y = through(p, "accel", (now.a_x, now.a_y), now, STEP)
    return (through(p, "wheel", s[:, 3].copy(), now, STEP),
            through(p, "gyro", s[:, 5].copy(), now, STEP), a_x, a_y)


def _mocap(p: Vehicle, g: Grid, s: FloatArray, l_r: float) -> Mocap:
    x, y, yaw, v_x, v_y, omega = s.T
    c, sn, ref = np.cos(yaw), np.sin(yaw), g.reference
    forward = ref.lx - l_r
    marker = (x + forward * c - ref.ly * sn, y + forward * sn + ref.ly * c, yaw - ref.theta)
    x, y, yaw = through(p, "pose", marker, Now(g.t, v_x, v_y, omega, yaw), STEP)
    return Mocap(freeze(g.t), EPOCH, freeze(x), freeze(y), freeze(yaw),
                 freeze_flags(np.zeros(len(g))))
