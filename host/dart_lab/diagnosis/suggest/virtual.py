"""Virtual drives: a recording of a car with known effects, without noise.

The noise is known from the data at hand. Here only the difference between two cars matters.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import datetime, timezone
from pathlib import Path

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import BatteryVoltage, Grid, Messages, Mocap, Recording, Reference
from dart_hal.recording.dart.model import freeze, freeze_flags, freeze_index
from dart_hal.vehicle.batch import rollout
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.prediction.actuators import actuator_outputs
from dart_lab.identification.prediction.commands import zero_order_hold
from dart_lab.identification.prediction.sensors import (
    add_drive_force,
    marker_pose,
    motion,
    read_sensors,
)

MESSAGE_SAMPLES = 10  # between messages
# s from the effect of a command to the message that reports it: the middle of the range that a
# 10 Hz log leaves open, so that a hypothesis can hide behind it in both directions.
COMMAND_AGE = 0.05
# m/s; at lower speeds hardly a mark passes in 0.1 s, and the creep of the equations at rest is
# not real.
MIN_ENCODER_SPEED = 0.02
# 1/s by which the battery of a drive loses its voltage: with it, battery_fade is the same number by
# the voltage and by the time.
VOLTAGE_DROP_RATE = 1e-3
EPOCH = datetime(2024, 9, 8, tzinfo=timezone.utc).timestamp()


@dataclass(frozen=True, slots=True)
class VirtualCommands:
    """Throttle and steering -1..1, (n,) on a grid of 0.01 s; of a speed loop m/s and -1..1."""

    throttle: FloatArray
    steering: FloatArray

    @property
    def seconds(self) -> float:
        return len(self.throttle) * SAMPLE


def record(p: Vehicle, commands: VirtualCommands, reference: Reference, name: str = "drive",
           yaw: float = 0.0) -> Recording:
    """Record the drive of the car p, from standstill at heading ``yaw`` [rad]."""
    n = len(commands.throttle)
    samples = np.arange(MESSAGE_SAMPLES, n - 1, MESSAGE_SAMPLES)
    sent = np.asarray(samples * SAMPLE, dtype=np.float64)
    # The car receives commands at 10 Hz, as with the logger of the recordings.
    index = np.clip(samples - round(COMMAND_AGE / SAMPLE), 0, n - 1)
    throttle = commands.throttle[index]
    steering = commands.steering[index]
    held = [zero_order_hold(sent - COMMAND_AGE, u, n) for u in (throttle, steering)]
    g = _grid(n, held[0], held[1], reference)
    battery = None
    if p.motor_voltage is not None:
        battery = BatteryVoltage(g.t, p.motor_voltage * (1.0 - VOLTAGE_DROP_RATE * g.t))
        g = replace(g, voltage=battery.voltage)
    tau, angle = actuator_outputs(p, g, smooth=True)
    start = np.array([[0.0], [0.0], [yaw], [0.0], [0.0], [0.0]])
    s = rollout(p, start, tau[:-1, None], angle[:-1, None], output_samples=range(n))[:, :, 0].T
    rates = np.gradient(s[3:], SAMPLE, axis=1)
    speed, rate, a_x, a_y = read_sensors(p, add_drive_force(p, motion(g.t, s, rates), tau))
    mocap = _mocap(p, g, s, apply_parameter_effects(p).body.l_r)
    distance = np.concatenate([[0.0], np.cumsum(0.5 * np.abs(speed[1:] + speed[:-1]))])
    counted = (distance[samples] - distance[samples - MESSAGE_SAMPLES]) / MESSAGE_SAMPLES
    m = Messages(t=freeze(sent), arrival=freeze(sent), segment=freeze_index(np.zeros(len(sent))),
                 throttle=freeze(throttle), throttle_raw=freeze(throttle),
                 steering=freeze(steering), gate=freeze_flags(np.ones(len(sent))),
                 speed=freeze(np.where(counted < MIN_ENCODER_SPEED, 0.0, counted)),
                 yaw_rate=freeze(rate[samples]), accel_x=freeze(a_x[samples]),
                 accel_y=freeze(a_y[samples]))
    return Recording(Path("suggested") / name, "B", m, mocap, "ok", None, "", (),
                     drive=p.drive, battery=battery)


def _grid(n: int, throttle: FloatArray, steering: FloatArray, reference: Reference) -> Grid:
    zeros = np.zeros(n)
    t = np.asarray(np.arange(n) * SAMPLE, dtype=np.float64)
    return Grid(t, zeros, zeros, zeros, zeros, zeros, zeros, throttle, steering,
                zeros, np.zeros(n, dtype=np.bool_), reference)


def _mocap(p: Vehicle, g: Grid, s: FloatArray, l_r: float) -> Mocap:
    marker = (*g.reference.marker(l_r, *s[:3]), s[2] - g.reference.theta)
    x, y, yaw = marker_pose(p, g.t, s, marker)
    return Mocap(freeze(g.t), EPOCH, freeze(x), freeze(y), freeze(yaw),
                 freeze_flags(np.zeros(len(g))))
