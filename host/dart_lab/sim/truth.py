"""Access to the truth about a simulated car, restricted to a few programs.

Only ``dart-hal sim --reveal``, ``dart-hal demo``, ``dart-hal localize`` and tests import this
module or ``dart_lab.sim.hidden``. ``localize`` gives a car the map of its room and draws the true
path.
Estimation, calibration, control and diagnosis have to measure, otherwise their results would prove
nothing. A test checks the import graph.
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
from dart_lab.sim.backend import URL_OPTIONS, lidar_in_room, mocap_in_room, room_in_view
from dart_lab.sim.car_file import THROTTLE_SPAN_US
from dart_lab.sim.drawn import resolve_car
from dart_lab.sim.hidden import HiddenCar, hidden_car
from dart_lab.sim.imu import ImuParams, rotation
from dart_lab.sim.lidar.maps import RoomMap
from dart_lab.sim.link import SimLink
from dart_lab.sim.mock_nano import LATCH_TO_UART
from dart_lab.sim.sealed import check_may_reveal
from dart_lab.sim.servo import HORN_RAD_PER_US
from dart_lab.sim.world import Truth, World

# Points of the revealed steering map.
STEERING_POINTS = 401
# Time of ten bytes on an I2C bus of 100 kHz [s].
BUS_TIME = 0.92e-3


def world_of(backend: Backend) -> World:
    """Return the world of an opened ``sim://``. Raises UsageError for another backend."""
    link = backend.link.link if isinstance(backend.link, PacedLink) else backend.link
    if not isinstance(link, SimLink):
        raise UsageError(f"{backend.url.text} is not a simulated car", expected="sim://")
    return link._world


def truth(backend: Backend, t: float | None = None) -> Truth:
    """Return the true state of the simulated car at time t [s], default now."""
    return world_of(backend).truth(t)


def reveal(seed: int | None, ring: str | None = None) -> dict[str, Any]:
    """Return what ``sim --reveal`` prints, in JSON types only; ``ring`` as in the URL."""
    return _describe_car(hidden_car(seed, ring), ())


def reveal_url(url: Url, secret: bytes | None = None) -> dict[str, Any]:
    """Return the same for any ``sim://`` URL. Raises what opening it would raise.

    secret: that of the class of a sealed car, which is refused without it.

    The steering angle is the middle of the backlash loop at pulse =
    center_us + span_us * command. Throttle figures are distances from
    neutral [us]; the dead band ends where drive force begins (the ESC's or
    the motor's, whichever is wider). ``steering.backlash`` is the full width
    of the loop. All this is the car without its ``effects``, which are listed separately.
    ``mocap``: the parameters of ``MocapParams``, None without a motion capture; ``lidar``: those of
    ``LidarParams``, ``room``: name, lines, glass and start of a ``RoomMap``, None without a lidar.
    """
    url.known(*URL_OPTIONS)
    check_may_reveal(url, secret)
    resolved = resolve_car(url)
    mocap = mocap_in_room(url, resolved.base.seed)
    revealed = _describe_car(resolved.base, resolved.effects)
    if mocap:
        revealed["sensors"] |= {"mocap.marker_x": mocap.lx, "mocap.marker_y": mocap.ly,
                             "mocap.marker_yaw": mocap.theta, "mocap.latency": mocap.latency}
    lidar = lidar_in_room(url, resolved.base.seed)
    if lidar:
        unit = lidar[0]
        revealed["sensors"] |= {"lidar.mount_x": unit.x, "lidar.mount_y": unit.y,
                             "lidar.mount_yaw": unit.yaw, "lidar.scale": unit.scale}
    return {**revealed, "mocap": mocap and asdict(mocap), "lidar": lidar and asdict(lidar[0]),
            "room": lidar and _describe_room(lidar[1])}


def room_of_car(backend: Backend) -> RoomMap:
    """Return the room of a simulated lidar. Raises UsageError without a lidar."""
    found = lidar_in_room(backend.url, world_of(backend).car.seed)
    if found is None:
        raise UsageError(f"{backend.url.text} has no lidar", expected="sim://?lidar=1")
    return found[1]


def room_of_url(url: Url) -> RoomMap | None:
    """Return the room of a ``sim://`` URL with lidar or camera, else None. Raises UsageError."""
    return room_in_view(url, resolve_car(url).base.seed)


def _describe_room(room: RoomMap) -> dict[str, Any]:
    return {"name": room.name, "lines": room.lines.tolist(), "glass": room.glass.tolist(),
            "start": list(room.start)}


def _describe_car(car: HiddenCar, effects: tuple[ActiveEffect, ...]) -> dict[str, Any]:
    curve = make_steering(car.servo.curve)
    commands = [-1.0 + 2.0 * k / (STEERING_POINTS - 1) for k in range(STEERING_POINTS)]
    return {"seed": car.seed, "vehicle": _describe_vehicle(car),
            "steering": {"command": commands, "angle_rad": [curve(s) for s in commands]},
            "sensors": sensor_truth(car), "effects": [_describe_effect(a) for a in effects]}


def _describe_effect(a: ActiveEffect) -> dict[str, Any]:
    pairs = zip(a.effect.parameters, a.values, strict=True)
    return {"name": a.name, "parameters": {q.name: _with_unit(v, q.unit) for q, v in pairs}}


def _with_unit(value: float, unit: str) -> dict[str, Any]:
    return {"value": value, "unit": unit}


def _describe_vehicle(car: HiddenCar) -> dict[str, Any]:
    v = car.vehicle
    groups = {"body": v.body, "friction": v.friction, "motor": v.motor, "steering": v.steering,
              "tyres": v.tyres}
    table: dict[str, Any] = {
        name: {f: _with_unit(getattr(group, f), spec.metadata["unit"])
               for f, spec in group.__dataclass_fields__.items() if "unit" in spec.metadata}
        for name, group in groups.items()}
    table["name"] = v.name
    table["delay"] = {"steering_s": _with_unit(car.servo.delay, "s"),
                      "throttle_s": _with_unit(car.esc.delay, "s"),
                      "steering_lag_s": _with_unit(car.servo.lag, "s"),
                      "throttle_lag_s": _with_unit(car.esc.lag, "s")}
    table["servo"] = {"rate": _with_unit(car.servo.rate, "rad/s")}
    table["esc"] = {"deadband_forward_us": _with_unit(car.esc.deadband_forward_us, "us"),
                    "deadband_reverse_us": _with_unit(car.esc.deadband_reverse_us, "us"),
                    "brake_force": _with_unit(car.brake_force, "N")}
    table["stand"] = {"wheel_mass": _with_unit(car.wheel_mass, "kg"),
                      "drivetrain": _with_unit(car.drivetrain, "-")}
    table["nano"] = {"clock_error": _with_unit(car.clock_error, "-")}
    return table


def sensor_truth(car: HiddenCar) -> dict[str, Any]:
    """Return the true values of sensors and actuators, by their names in calibration.toml."""
    onset = -car.vehicle.duty_motor.g * car.esc.saturation_us
    return {
        "pwm.oscillator_hz": car.oscillator_hz,
        "steering.backlash": car.servo.backlash,
        "throttle.neutral_us": car.esc.neutral_us,
        "throttle.deadband_forward_us": max(car.esc.deadband_forward_us, onset),
        "throttle.deadband_reverse_us": max(car.esc.deadband_reverse_us, onset),
        "throttle.saturation_us": car.esc.saturation_us,
        "throttle.reverse_rest": car.esc.reverse_gap,
        "throttle.signal_loss": car.esc.signal_loss,
        # Of a pulse of the whole span, not only of the part up to the ESC's saturation.
        "throttle.brake": car.brake_force / car.vehicle.body.mass
        * THROTTLE_SPAN_US / car.esc.saturation_us,
        "encoder.metres_per_edge": car.gear_revolution / car.ring_a.n,
        "encoder.ring": list(car.ring_a.fractions),
        "imu.gyro_bias": _yaw_bias(car.imu),
        "imu.gyro_scale": car.imu.gyro_scale,
        "imu.mount_yaw": car.imu.mount_yaw,
        "imu.mount_pitch": car.imu.mount_pitch,
        "imu.mount_roll": car.imu.mount_roll,
        # A command takes the time of the bus, waits for the next PWM frame, uniform over 20 ms,
        # and acts at the end of its pulse of 1.5 ms.
        "latency.command_to_pulse": 0.5 * round(car.oscillator_hz / 4096 / 50) * 4096
        / car.oscillator_hz + 1.5e-3 + BUS_TIME,
        "latency.pulse_to_wheel": car.esc.delay,
        "latency.pulse_to_wheel_lag": car.esc.lag,
        "latency.pulse_to_yaw": car.servo.delay,
        "latency.pulse_to_yaw_lag": car.servo.lag,
        "steering.slew_us_s": car.servo.rate / HORN_RAD_PER_US,
        "latency.sensor_to_host": LATCH_TO_UART + 44 * 20e-6,
    }


def _yaw_bias(imu: ImuParams) -> float:
    """Return the offset of the yaw rate [rad/s] after mounting and scale are applied."""
    row = rotation(imu.mount_yaw, imu.mount_pitch, imu.mount_roll)[2]
    return sum(r * b for r, b in zip(row, imu.gyro_bias, strict=True)) / imu.gyro_scale
