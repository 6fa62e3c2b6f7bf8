"""The way to the truth about a simulated car. Who may take it is a rule.

Only ``dart-hal sim --reveal``, ``dart-hal demo``, ``dart-hal localize``, which gives a car the
map of its room and draws the true path, and tests import this module or ``dart_lab.sim.hidden``.
Estimation, calibration, control and diagnosis have to measure: a program that could peek would
prove nothing. A test reads the import graph and refuses every other importer.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from dart_hal.core.errors import UsageError
from dart_hal.core.url import Url
from dart_hal.devices.links.base import Backend
from dart_hal.devices.links.paced import PacedLink
from dart_hal.vehicle import make_steering
from dart_hal.vehicle.effect import ActiveEffect
from dart_lab.sim.backend import OPTIONS, lidar_in_room, mocap_in_room, room_in_view
from dart_lab.sim.drawn import car_of
from dart_lab.sim.hidden import HiddenCar, hidden_car
from dart_lab.sim.imu import ImuParams, rotation
from dart_lab.sim.lidar.maps import Room
from dart_lab.sim.link import SimLink
from dart_lab.sim.mock_nano import TO_UART
from dart_lab.sim.servo import HORN_RAD_PER_US
from dart_lab.sim.world import Truth, World

POINTS = 401
BUS = 0.92e-3
"""s of ten bytes on an I2C bus of 100 kHz."""


def world_of(backend: Backend) -> World:
    """The world behind an opened ``sim://``. Raises UsageError for another backend."""
    link = backend.link.link if isinstance(backend.link, PacedLink) else backend.link
    if not isinstance(link, SimLink):
        raise UsageError(f"{backend.url.text} is not a simulated car", expected="sim://")
    return link._world


def truth(backend: Backend, t: float | None = None) -> Truth:
    """What the simulated car does at time t [s], default: now."""
    return world_of(backend).truth(t)


def reveal(seed: int | None, ring: str | None = None) -> dict[str, Any]:
    """The object that ``sim --reveal`` prints (JSON types only); ``ring`` as in the URL."""
    return _revealed(hidden_car(seed, ring), ())


def reveal_url(url: Url) -> dict[str, Any]:
    """The same for any ``sim://`` URL. Raises what opening it would raise.

    The steering angle is the middle of the backlash loop at pulse =
    center_us + span_us * command. Throttle figures are distances from
    neutral [us]; the dead band ends where drive force begins (the ESC's or
    the motor's, whichever is wider). ``steering.backlash`` is the full width
    of the loop. All this is the car without its ``effects``, which come on top.
    ``mocap``: the parameters of ``MocapParams``, None without a motion capture; ``lidar``: those
    of ``LidarParams``, ``room``: name, lines, glass and start of a ``Room``, None without a lidar.
    """
    url.known(*OPTIONS)
    drawn = car_of(url)
    mocap = mocap_in_room(url, drawn.base.seed)
    shown = _revealed(drawn.base, drawn.effects)
    if mocap:
        shown["sensors"] |= {"mocap.marker_x": mocap.lx, "mocap.marker_y": mocap.ly,
                             "mocap.marker_yaw": mocap.theta, "mocap.latency": mocap.latency}
    seen = lidar_in_room(url, drawn.base.seed)
    if seen:
        unit = seen[0]
        shown["sensors"] |= {"lidar.mount_x": unit.x, "lidar.mount_y": unit.y,
                             "lidar.mount_yaw": unit.yaw, "lidar.scale": unit.scale}
    return {**shown, "mocap": mocap and asdict(mocap), "lidar": seen and asdict(seen[0]),
            "room": seen and _room(seen[1])}


def room_of_car(backend: Backend) -> Room:
    """The room in which a simulated lidar is. Raises UsageError where there is none."""
    found = lidar_in_room(backend.url, world_of(backend).car.seed)
    if found is None:
        raise UsageError(f"{backend.url.text} has no lidar", expected="sim://?lidar=1")
    return found[1]


def room_of_url(url: Url) -> Room | None:
    """The room that lidar and camera of a ``sim://`` URL see, None without. Raises UsageError."""
    return room_in_view(url, car_of(url).base.seed)


def _room(room: Room) -> dict[str, Any]:
    return {"name": room.name, "lines": room.lines.tolist(), "glass": room.glass.tolist(),
            "start": list(room.start)}


def _revealed(car: HiddenCar, effects: tuple[ActiveEffect, ...]) -> dict[str, Any]:
    curve = make_steering(car.servo.curve)
    commands = [-1.0 + 2.0 * k / (POINTS - 1) for k in range(POINTS)]
    return {"seed": car.seed, "vehicle": _vehicle(car),
            "steering": {"command": commands, "angle_rad": [curve(s) for s in commands]},
            "sensors": _sensors(car), "effects": [_effect(a) for a in effects]}


def _effect(a: ActiveEffect) -> dict[str, Any]:
    pairs = zip(a.effect.parameters, a.values, strict=True)
    return {"name": a.name, "parameters": {q.name: _value(v, q.unit) for q, v in pairs}}


def _value(value: float, unit: str) -> dict[str, Any]:
    return {"value": value, "unit": unit}


def _vehicle(car: HiddenCar) -> dict[str, Any]:
    v = car.vehicle
    groups = {"body": v.body, "friction": v.friction, "motor": v.motor, "steering": v.steering,
              "tyres": v.tyres}
    table: dict[str, Any] = {
        name: {f: _value(getattr(group, f), spec.metadata["unit"])
               for f, spec in group.__dataclass_fields__.items() if "unit" in spec.metadata}
        for name, group in groups.items()}
    table["name"] = v.name
    table["delay"] = {"steering_s": _value(car.servo.delay, "s"),
                      "throttle_s": _value(car.esc.delay, "s"),
                      "steering_lag_s": _value(car.servo.lag, "s"),
                      "throttle_lag_s": _value(car.esc.lag, "s")}
    table["servo"] = {"rate": _value(car.servo.rate, "rad/s")}
    table["esc"] = {"deadband_forward_us": _value(car.esc.deadband_forward_us, "us"),
                    "deadband_reverse_us": _value(car.esc.deadband_reverse_us, "us"),
                    "brake_force": _value(car.brake_force, "N")}
    table["stand"] = {"wheel_mass": _value(car.wheel_mass, "kg"),
                      "drivetrain": _value(car.drivetrain, "-")}
    table["nano"] = {"clock_error": _value(car.clock_error, "-")}
    return table


def _sensors(car: HiddenCar) -> dict[str, Any]:
    onset = -car.vehicle.motor.g * car.esc.saturation_us
    return {
        "pwm.oscillator_hz": car.oscillator_hz,
        "steering.backlash": car.servo.backlash,
        "throttle.neutral_us": car.esc.neutral_us,
        "throttle.deadband_forward_us": max(car.esc.deadband_forward_us, onset),
        "throttle.deadband_reverse_us": max(car.esc.deadband_reverse_us, onset),
        "throttle.saturation_us": car.esc.saturation_us,
        "throttle.reverse_rest": car.esc.reverse_gap,
        "throttle.signal_loss": car.esc.signal_loss,
        "encoder.metres_per_edge": car.gear_revolution / car.ring_a.n,
        "encoder.ring": list(car.ring_a.fractions),
        "imu.gyro_bias": _yaw_bias(car.imu),
        "imu.gyro_scale": car.imu.gyro_scale,
        "imu.mount_yaw": car.imu.mount_yaw,
        "imu.mount_pitch": car.imu.mount_pitch,
        "imu.mount_roll": car.imu.mount_roll,
        # a command takes the bus, waits for the next frame of the PWM, uniform over 20 ms,
        # and acts at the end of its pulse of 1.5 ms
        "latency.command_to_pulse": 0.5 * round(car.oscillator_hz / 4096 / 50) * 4096
        / car.oscillator_hz + 1.5e-3 + BUS,
        "latency.pulse_to_wheel": car.esc.delay,
        "latency.pulse_to_wheel_lag": car.esc.lag,
        "latency.pulse_to_yaw": car.servo.delay,
        "latency.pulse_to_yaw_lag": car.servo.lag,
        "steering.slew_us_s": car.servo.rate / HORN_RAD_PER_US,
        "latency.sensor_to_host": TO_UART + 44 * 20e-6,
    }


def _yaw_bias(imu: ImuParams) -> float:
    """Offset of the yaw rate [rad/s] once mounting and scale have been applied."""
    row = rotation(imu.mount_yaw, imu.mount_pitch, imu.mount_roll)[2]
    return sum(r * b for r, b in zip(row, imu.gyro_bias, strict=True)) / imu.gyro_scale
