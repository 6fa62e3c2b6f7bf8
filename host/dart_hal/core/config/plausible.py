"""Valid ranges of the numbers of ``car.toml`` and ``calibration.toml``.

They include every car from 1:43 to 1:1, so a value outside is a typing error, a wrong unit or a
damaged file. Without this check it would cause an overflow or a division by zero during a drive.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import tau
from typing import Any

from dart_hal.core.config.parse import require
from dart_hal.core.config.quantity import Quantities, Quantity

Range = tuple[float, float, str]

# Lowest and highest value and unit, by key of car.toml.
CAR_RANGES: Mapping[str, Range] = {
    "geometry.wheelbase": (0.02, 10.0, "m"),
    "geometry.l_f": (0.001, 10.0, "m"),
    "geometry.l_r": (0.001, 10.0, "m"),
    "geometry.mass": (0.02, 1e4, "kg"),
    "geometry.yaw_inertia": (1e-6, 1e5, "kg m2"),
    "geometry.length": (0.02, 20.0, "m"),
    "geometry.width": (0.01, 10.0, "m"),
    "geometry.track": (0.01, 10.0, "m"),
    "geometry.wheel_radius": (0.002, 2.0, "m"),
    "geometry.lidar_x": (-10.0, 10.0, "m"),
    "geometry.front_share": (0.0, 1.0, "of the wheel force"),
    "throttle.arm_neutral": (0.0, 60.0, "s"),
    "throttle.stop_ramp": (0.0, 60.0, "s"),
    "throttle.deadband_us": (0.0, 500.0, "us"),
    "throttle.saturation_us": (0.0, 1000.0, "us"),
    "throttle.signal_loss": (0.0, 60.0, "s"),
    "pwm.bus": (0, 255, ""),
    "pwm.clock_channel": (0, 15, ""),
    "imu.mount_yaw": (-tau, tau, "rad; are these degrees?"),
    "imu.mount_pitch": (-tau, tau, "rad; are these degrees?"),
    "imu.mount_roll": (-tau, tau, "rad; are these degrees?"),
    "imu.x": (-10.0, 10.0, "m"),
    "imu.y": (-10.0, 10.0, "m"),
    "lidar.y": (-10.0, 10.0, "m"),
    "lidar.mount_yaw": (-tau, tau, "rad; are these degrees?"),
    "battery.cells": (1, 6, ""),
    "battery.ratio": (1.0, 30.0, ""),
    "battery.warn_cell": (2.5, 4.2, "V of one cell"),
    "battery.limit_cell": (2.5, 4.2, "V of one cell"),
    "battery.limited_throttle": (0.0, 1.0, ""),
    "rc.dead_band_us": (10.0, 200.0, "us"),
    "rc.mode_us": (900.0, 2100.0, "us"),
    "limits.max_speed": (1e-3, 100.0, "m/s"),
    "limits.steering_slew": (1e-6, 1e6, "1/s"),
    "limits.throttle_slew": (1e-6, 1e6, "1/s"),
    "limits.encoder_lost_throttle": (0.0, 1.0, ""),
}
# The same of calibration.toml.
CALIBRATION_RANGES: Mapping[str, Range] = {
    "steering.backlash": (-0.5, 0.5, "rad; are these degrees?"),
    "steering.slew_us_s": (1.0, 1e7, "us/s"),
    "throttle.deadband_forward_us": (-500.0, 2500.0, "us"),
    "throttle.deadband_reverse_us": (-500.0, 2500.0, "us"),
    "throttle.saturation_us": (1.0, 2500.0, "us"),
    "throttle.reverse_rest": (0.0, 60.0, "s"),
    "throttle.signal_loss": (0.0, 60.0, "s"),
    "throttle.brake": (0.0, 100.0, "m/s2"),
    "encoder.ring": (0.0, 64.0, "of the mean interval"),
    "imu.gyro_bias": (-10.0, 10.0, "rad/s"),
    "imu.gyro_scale": (0.1, 10.0, ""),
    "imu.mount_yaw": (-tau, tau, "rad; are these degrees?"),
    "imu.mount_pitch": (-tau, tau, "rad; are these degrees?"),
    "imu.mount_roll": (-tau, tau, "rad; are these degrees?"),
    "latency.command_to_pulse": (-1.0, 10.0, "s"),
    "latency.pulse_to_wheel": (-1.0, 10.0, "s"),
    "latency.pulse_to_wheel_lag": (-1.0, 10.0, "s"),
    "latency.pulse_to_yaw": (-1.0, 10.0, "s"),
    "latency.pulse_to_yaw_lag": (-1.0, 10.0, "s"),
    "latency.sensor_to_host": (-1.0, 10.0, "s"),
    "mocap.marker_x": (-10.0, 10.0, "m"),
    "mocap.marker_y": (-10.0, 10.0, "m"),
    "mocap.marker_yaw": (-tau, tau, "rad; are these degrees?"),
    "mocap.latency": (-1.0, 10.0, "s"),
    "lidar.mount_x": (-10.0, 10.0, "m"),
    "lidar.mount_y": (-10.0, 10.0, "m"),
    "lidar.mount_yaw": (-tau, tau, "rad; are these degrees?"),
}
# Characters with a special meaning in terminals, browsers or shells.
FORBIDDEN_CHARACTERS = "<>[]{}\\\"`$|;"


def check_ranges(thing: Any, ranges: Mapping[str, Range], origin: str) -> None:
    """Raise ConfigError at the first number of a file that is out of its range."""
    for key, (low, high, unit) in ranges.items():
        table, _, name = key.partition(".")
        entry = getattr(getattr(thing, table), name, None)
        for number in _numbers(entry):
            require(low <= number <= high, origin, key, number,
                    f"{low:g} to {high:g} {unit}".rstrip())


def check_name(name: str, origin: str) -> None:
    """Raise ConfigError for a name that is not usable as a folder or not safe to print."""
    usable = (bool(name.strip()) and name.isprintable() and len(name) <= 64 and "/" not in name
              and name not in (".", "..") and not set(name) & set(FORBIDDEN_CHARACTERS))
    require(usable, origin, "name", repr(name[:80]),
            "a folder name of at most 64 characters: letters, digits, blanks, . - _")


def _numbers(entry: Any) -> tuple[float, ...]:
    if entry is None:
        return ()
    if isinstance(entry, Quantity):
        return (entry.value,)
    return tuple(entry.value) if isinstance(entry, Quantities) else (entry,)
