"""One simulated drive as cars of several sizes would log it, by dynamic similarity.

With lengths L, masses m, and speeds such that v^2 / (g L) is the same, times are as sqrt(L / g)
and forces as m g. So a drive of the car of the paper is one of a car of another size, exactly. It
is logged at 100 Hz at any size. Noise is as the channel: of poses as L, of the encoder as the
speed, of the gyro as the yaw rate; that of the accelerometer does not change.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dart_hal.car.runs import read_any
from dart_hal.core.config import Quantity
from dart_hal.core.timing import SAMPLE
from dart_hal.recording.dart import Reference
from dart_hal.recording.imported import ImportedData, Stream, write_imported
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.channels import transform_signal
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.effect import Now
from dart_hal.vehicle.new_car import MeasuredSizes, describe_car
from studies.diagnosis import hidden_drive

# Of the car of the paper: noise of a pose [m, rad], an encoder [m/s], a gyro and an accelerometer.
POSE_STD = 1e-4
YAW_STD = 5e-4
SPEED_STD = 0.01
GYRO_NOISE_STD = 0.003
ACCEL_STD = 0.5
SIZE_NAMES = ("wheelbase", "l_f", "mass", "yaw_inertia")
PULSE = 0.1
"""s between two commands of the car of the paper."""


@dataclass(frozen=True)
class Size:
    """wheelbase [m] and mass [kg] of a car."""

    wheelbase: float
    mass: float

    @property
    def length(self):
        """Length over that of the car of the paper."""
        return self.wheelbase / PAPER.body.wheelbase

    @property
    def time(self):
        """Time over that of the car of the paper."""
        return np.sqrt(self.length)

    @property
    def force(self):
        """Force over that of the car of the paper."""
        return self.mass / PAPER.body.mass

    def car_file(self):
        """Return the text of a car.toml, as ``dart-hal car new`` writes it."""
        b = self.scale(PAPER).body
        sizes = {key: Quantity(getattr(b, key), 0.01 * getattr(b, key)) for key in SIZE_NAMES}
        return describe_car("scaled", MeasuredSizes(sizes, Quantity(0.35, 0.05)))

    def scale(self, p):
        """Return the vehicle of this size with the motion of p."""
        speed = self.length / self.time
        f = self.force
        return replace(
            p, name="scaled",
            body=replace(p.body, wheelbase=p.body.wheelbase * self.length,
                         l_f=p.body.l_f * self.length, l_r=p.body.l_r * self.length,
                         mass=p.body.mass * f, yaw_inertia=p.body.yaw_inertia * f * self.length**2),
            friction=replace(p.friction, a=p.friction.a * f, b=p.friction.b / speed,
                             c=p.friction.c * f / speed, q=p.friction.q * f / speed**2),
            motor=replace(p.motor, d=p.motor.d * f, e=p.motor.e * f / speed),
            tyres=replace(
                p.tyres, front_D=p.tyres.front_D * f, rear_max=p.tyres.rear_max * f,
                rear_cornering_stiffness=p.tyres.rear_cornering_stiffness * f),
            delay=replace(p.delay, **{key: getattr(p.delay, key) * self.time for key in (
                "steering_s", "throttle_s", "steering_lag_s", "throttle_lag_s")}))


CAR_SIZES = {"1:43": Size(0.06, 0.04), "1:10": Size(PAPER.body.wheelbase, PAPER.body.mass),
         "1:1": Size(2.6, 1000.0)}


@dataclass(frozen=True)
class Drive:
    """A drive of the car of the paper, every ``hidden_drive.DT``: poses of the marker (n, 3),
    commands (n, 2), speed of the wheels (n,), yaw rate (n,) and acceleration (n, 2)."""

    poses: np.ndarray
    commands: np.ndarray
    wheel: np.ndarray
    yaw_rate: np.ndarray
    accel: np.ndarray


def simulate(p, seed, seconds):
    """Return a drive of p, which has the size of the car of the paper."""
    dt = hidden_drive.DT
    rng = np.random.default_rng(seed)
    plan = hidden_drive.Plan(seconds=seconds)
    throttle, steering = hidden_drive.commands(plan, rng)
    every = round(PULSE / dt)
    throttle, steering = (np.repeat(c[::every], every)[:len(c)] for c in (throttle, steering))
    states, accel, drive = hidden_drive.motion(p, throttle, steering, plan, rng)
    s = states[1:]
    t = (np.arange(len(s)) + 1) * dt
    now = Now(t, *s[:, [3, 4, 5, 2]].T, *accel.T, drive, np.cumsum(s[:, 3]) * dt / 0.0412925)
    ahead = hidden_drive.LX - apply_parameter_effects(p).body.l_r
    left = hidden_drive.LY
    cos = np.cos(s[:, 2])
    sin = np.sin(s[:, 2])
    pose = (s[:, 0] + ahead * cos - left * sin, s[:, 1] + ahead * sin + left * cos,
            s[:, 2] - hidden_drive.THETA)
    return Drive(
        np.stack(transform_signal(p, "pose", pose, now, dt), axis=1),
        np.stack([steering, throttle], axis=1),
        transform_signal(p, "wheel", s[:, 3].copy(), now, dt),
        transform_signal(p, "gyro", s[:, 5].copy(), now, dt),
        np.stack(transform_signal(p, "accel", (accel[:, 0].copy(), accel[:, 1].copy()), now, dt),
                 axis=1))


def log(drive, size, path, seed=0):
    """Write the log of a car of that size and return the recording."""
    rng = np.random.default_rng(seed)
    fine = (np.arange(len(drive.wheel)) + 1) * hidden_drive.DT * size.time
    t = np.arange(fine[0], fine[-1], SAMPLE)

    def sample(values, scale, std):
        columns = [np.interp(t, fine, c) for c in values.reshape(len(values), -1).T]
        out = np.stack(columns, axis=1) * scale
        return Stream(t, out + rng.normal(size=out.shape) * std * scale)

    lengths = np.array([size.length, size.length, 1.0])
    changes = np.flatnonzero(np.any(np.diff(drive.commands, axis=0, prepend=np.nan) != 0.0, axis=1))
    # A state is that at the end of its step, a command acts from the beginning on.
    sent = np.concatenate([fine[changes] - hidden_drive.DT * size.time, [fine[-1]]])
    streams = {
        "poses": sample(drive.poses, lengths, [POSE_STD, POSE_STD, YAW_STD]),
        "commands": Stream(sent, drive.commands[[*changes, -1]]),
        "encoder": sample(drive.wheel, size.length / size.time, SPEED_STD),
        "gyro": sample(drive.yaw_rate, 1.0 / size.time, GYRO_NOISE_STD),
        "accelerometer": sample(drive.accel, 1.0, ACCEL_STD)}
    marker = Reference(hidden_drive.LX * size.length, hidden_drive.THETA,
                       hidden_drive.LY * size.length, "stated")
    write_imported(ImportedData(streams, marker=marker, car=size.car_file()), path)
    return read_any([path])[0][0]
