"""The checks of ``doctor``: each a function of what was found, with a remedy."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from dart_hal.car import Car
from dart_hal.car.camera import camera_of
from dart_hal.core.errors import (
    BusError,
    ConfigError,
    DartHalError,
    LinkLost,
    UnknownScheme,
    UsageError,
)
from dart_hal.core.ports import ImageSource, PoseSource
from dart_hal.core.types import State, Tracking
from dart_hal.devices.actuation.arming import BY_NAME
from dart_hal.devices.links.base import Backend, open_backend
from dart_hal.devices.poses import open_poses
from dart_hal.wire.messages import SCHEMA

T = TypeVar("T")
RATE = 100.0
"""STATE frames per second."""
MOUNTED_STILL = 0.35
"""m/s2 of acceleration without gravity that a standing, levelled car may show."""


@dataclass(frozen=True, slots=True)
class Check:
    """One line of the doctor's report."""

    id: str
    title: str
    verdict: str
    found: str
    expected: str = ""
    cause: str = ""
    remedy: str = ""

    def as_json(self) -> dict[str, str]:
        return {"id": self.id, "title": self.title, "verdict": self.verdict, "found": self.found,
                "expected": self.expected, "cause": self.cause, "try": self.remedy}


TITLES = {
    "port": "port", "bus": "I2C and PCA9685", "files": "files of the car", "hello": "firmware",
    "schema": "message definitions", "rate": "frame rate", "losses": "losses",
    "clock": "clock", "imu": "IMU", "encoder": "encoder", "cutoff": "hardware cut-off",
    "pwm": "PWM clock", "calibration": "calibration", "arming": "arming", "cautions": "to be known",
}
_TITLES = {**TITLES, "poses": "poses from outside", "lidar": "lidar", "camera": "camera"}
"""With the checks of what most cars do not have."""


def _check(name: str, good: bool, found: str, *, bad: str = "fail", expected: str = "",
           cause: str = "", remedy: str = "") -> Check:
    return Check(name, _TITLES[name], "ok" if good else bad, found, expected, cause, remedy)


def _failed(name: str, error: DartHalError) -> Check:
    found = f"{error.what}: {error.found}" if error.found else error.what
    return Check(name, _TITLES[name], "fail", found, error.expected, error.likely, error.remedy)


def examine(url: str, car_name: str, cars: Path | None, seconds: float,
            poses: str | None = None, camera: str | None = None) -> list[Check]:
    """Open what can be opened and look at it; what depends on a fault is skipped."""
    checks: list[Check] = []
    try:
        backend = open_backend(url)
    except (UnknownScheme, UsageError):
        raise  # the command is wrong, not the car
    except DartHalError as error:
        checks.append(_failed("bus" if isinstance(error, BusError) else "port", error))
        return checks + _skipped(checks)
    checks.append(_check("port", True, f"{url} is open"))
    source = _source("poses", lambda: open_poses(poses or ""), backend, checks) if poses else None
    eye = _source("camera", lambda: camera_of(backend, camera or ""), backend, checks
                  ) if camera else None
    car = _open(backend, url, car_name, cars, checks, source, eye)
    if car is None:
        for one in (source, eye):
            if one is not None:
                one.close()
        return checks + _skipped(checks)
    try:
        states = list(car.states(duration=seconds, timeout=1.0))
        checks += _stream(car, states)
        checks += _car(car, cars)
        if backend.poses is not None and states[-1].external is not None:
            checks.append(_poses(backend.poses, states))
        if backend.lidar is not None:
            checks.append(_lidar(car))
        if backend.camera is not None:
            checks.append(_camera(car))
        checks += [_arming(car), _cautions(car, cars)]
    except DartHalError as error:
        checks.append(_failed("rate", error))
    finally:
        car.close()
    return _ordered(checks + _skipped(checks))


def _source(name: str, opener: Callable[[], T], backend: Backend, checks: list[Check]) -> T | None:
    """What is opened beside the car; None and a check where it is not there."""
    try:
        return opener()
    except UsageError:
        backend.close()
        raise
    except DartHalError as error:
        checks.append(_failed(name, error))
        return None


def _open(backend: Backend, url: str, car_name: str, cars: Path | None, checks: list[Check],
          poses: PoseSource | None, camera: ImageSource | None) -> Car | None:
    """The car; without its I2C bus if that is the fault."""
    try:
        if backend.bus is None:
            checks.append(no_bus(url))
        car = Car.over(backend, car=car_name, cars=cars, poses=poses, camera=camera)
    except BusError as error:
        checks.append(_failed("bus", error))
        backend = open_backend(url)
        backend.bus = None
        return _without_bus(backend, car_name, cars, checks)
    except ConfigError as error:
        checks.append(_failed("files", error))
        return None
    except DartHalError as error:
        checks.append(_failed("hello", error))
        return None
    if backend.bus is not None:
        applied = car.stop()
        pulse = (f"throttle at {applied.throttle_us:.1f} us" if applied.throttle_us
                 else "no pulse before the Nano's first message")
        checks.append(_check("bus", True, f"PCA9685 read back well, {pulse}"))
    return car


def no_bus(url: str) -> Check:
    """The check of a URL that names no I2C bus."""
    remedy = f"--url '{url}{'&' if '?' in url else '?'}i2c=1'"
    if not url.startswith(("serial:", "hwgrep:")):
        remedy = "nothing to do: this backend has no actuators"
    return Check("bus", TITLES["bus"], "warn", "no I2C bus behind this URL", remedy=remedy,
                 cause="commands are not sent")


def _without_bus(backend: Backend, car_name: str, cars: Path | None,
                 checks: list[Check]) -> Car | None:
    try:
        return Car.over(backend, car=car_name, cars=cars)
    except DartHalError as error:
        checks.append(_failed("hello", error))
        return None


def _stream(car: Car, states: list[State]) -> list[Check]:
    hello = car.hello
    version = ".".join(map(str, hello.version))
    if not states:
        raise LinkLost("the Nano said who it is, but no STATE frame came",
                       found=f"{car.timing.damaged} damaged frames")
    last, timing = states[-1], car.timing
    rate = (last.seq - states[0].seq + 1) / max(last.t - states[0].t + 1 / RATE, 1e-3)
    rate = min(rate, len(states) / max(last.t - states[0].t + 1 / RATE, 1e-3))
    share = timing.lost / max(last.seq, 1)
    return [
        _check("hello", not hello.mock, f"version {version}, board {hello.board_id:08x}, "
               f"boot {hello.boot_count}" + (", MockNano: no firmware" if hello.mock else ""),
               bad="warn", expected="the firmware",
               cause="the URL asks for it" if "nano=mock" in car.url else
               "the emulator was not built",
               remedy="the same URL without nano=mock" if "nano=mock" in car.url else
               "make firmware"),
        _check("schema", hello.same_schema, f"{hello.schema:08x}", expected=f"{SCHEMA:08x}",
               cause="firmware and library are of different versions", remedy="dart-hal flash"),
        _check("rate", abs(rate - RATE) < 2.0, f"{rate:.1f} STATE frames per second",
               expected="100", cause="a slow USB hub or a busy computer",
               remedy="another USB port; close other programs"),
        _check("losses", share < 1e-3 and timing.damaged == 0,
               f"{timing.lost} frames lost, {timing.damaged} damaged", expected="none",
               bad="warn" if share < 0.02 else "fail", cause="a poor USB cable or a ground loop",
               remedy="another cable, shorter, away from the motor leads"),
        _check("clock", last.health.t_std < 1e-3, f"samples timed to {last.health.t_std * 1e3:.2f} "
               "ms", bad="warn", expected="below 1 ms", cause="USB latency timer of 16 ms",
               remedy="setserial PORT low_latency, or the udev rule of the handbook"),
        _imu(states), _encoder(states),
    ]


def _imu(states: list[State]) -> Check:
    last = states[-1]
    flags = last.health.flags
    for name in ("IMU_ABSENT", "IMU_STUCK", "IMU_STALE"):
        if name in flags:
            refusal = BY_NAME[name]
            return _check("imu", False, refusal.text, expected="a sample each 10 ms",
                          cause="SDA/SCL swapped, loose jumper, or no 5 V at D4",
                          remedy="check the four wires against the wiring page; " + refusal.remedy)
    if last.yaw_rate is None:
        return _check("imu", False, "no valid sample", expected="a sample each 10 ms",
                      cause="still starting", remedy="run doctor again")
    rates = [s.yaw_rate for s in states if s.yaw_rate is not None]
    still = sum(rates) / len(rates)
    acceleration = max(abs(last.accel_x or 0.0), abs(last.accel_y or 0.0))
    return _check("imu", abs(still) < 0.1 and acceleration < 3 * MOUNTED_STILL,
                  f"yaw rate {still:+.4f} rad/s, age {last.health.imu_age * 1e3:.0f} ms",
                  bad="warn", expected="near zero while the car stands",
                  cause="the car is being moved", remedy="leave it still and run doctor again")


def _encoder(states: list[State]) -> Check:
    edges = states[-1].ticks - states[0].ticks
    return _check("encoder", edges == 0 or abs(states[-1].speed) > 0.05,
                  f"{edges} edges while listening ({states[-1].ticks} since boot); "
                  "turn a wheel by hand to see them", bad="warn",
                  expected="none at standstill", cause="the sensor sits on an edge and flickers",
                  remedy="turn its potentiometer until the LED is steady")


def _poses(source: PoseSource, states: list[State]) -> Check:
    """Whether something outside sees the car, and where."""
    seen = [s.external for s in states if s.external is not None]
    stamps = {e.newest.stamp for e in seen if e.newest is not None}
    why = str(getattr(source, "why", ""))
    last = seen[-1] if seen else None
    if last is None or last.pose is None or not stamps:
        return _check("poses", False, f"none came: {why or 'the source said nothing'}", bad="warn",
                      expected="poses of the car", cause="no stream, another body, or a firewall",
                      remedy="docs/how_to/poses.md")
    found = (f"a new one in {len(stamps)} of {len(states)} frames, {last.tracking.value}, "
             f"x {last.pose.x:+.2f} m y {last.pose.y:+.2f} m yaw {last.pose.yaw:+.2f} rad")
    return _check("poses", last.tracking is Tracking.TRACKING, found + (f"; {why}" if why else ""),
                  bad="warn", expected="TRACKING",
                  cause="the car is hidden, or another body is told",
                  remedy="docs/how_to/poses.md, section What State says")


def _lidar(car: Car) -> Check:
    """Whether scans come, and what they say of the lidar."""
    trouble, health, count = car.lidar.trouble, car.lidar.health, len(car.lidar.scans())
    if trouble is not None:
        return replace(_failed("lidar", trouble), verdict="warn")
    if health is None:
        return _check("lidar", False, "no revolution was whole yet", bad="warn",
                      expected="8 a second", cause="its motor needs 1 to 2 s",
                      remedy="again with --seconds 6")
    told = list(health.sentences())
    return _check("lidar", not told, "; ".join((
        f"{count} revolutions, {health.rate:.2f} a second of {health.beams:.0f} beams, "
        f"{100.0 * health.returned:.0f} % come back", *told)), bad="warn",
        expected="nothing to say of it", remedy="docs/how_to/lidar.md, section Whether it is well")


def _camera(car: Car) -> Check:
    """Whether images come, and what they say of the camera."""
    trouble, health = car.camera.trouble, car.camera.health
    image = (car.camera.images() or (None,))[-1]
    if trouble is not None:
        return replace(_failed("camera", trouble), verdict="warn")
    if health is None or image is None:
        return _check("camera", False, "not two images yet", bad="warn",
                      expected="10 a second and more", cause="it has just been opened",
                      remedy="again with --seconds 6")
    told, (width, height) = list(health.sentences()), image.size
    return _check("camera", not told, "; ".join((
        f"{width} x {height}, {health.rate:.1f} a second of {1e-3 * health.size:.0f} kB, "
        f"{1e3 * health.age:.0f} ms old", *told)), bad="warn",
        expected="nothing to say of it", remedy="docs/how_to/camera.md, section Whether it is well")


def _car(car: Car, cars: Path | None) -> list[Check]:
    files = car.files
    fitted = car.hello.caps >> 2 & 3
    map_ = files.calibration.steering.map if files.calibration else None
    return [
        _check("files", True, f"{files.origin}"),
        _check("cutoff", bool(fitted), "fitted" if fitted else
               "none: if the computer dies the car keeps its throttle", bad="warn",
               expected="/OE or multiplexer on the Nano",
               remedy="hardware/README.md, section Hardware cut-off"),
        _check("pwm", files.oscillator_hz is not None, "measured" if files.oscillator_hz else
               "never measured: neutral may be 100 us off", bad="warn",
               expected="[pwm] oscillator_hz in car.toml",
               remedy=BY_NAME["PWM_CLOCK_UNCALIBRATED"].remedy),
        _check("calibration", map_ is not None, "steering map of this car" if map_ else
               "no steering map: the paper's is used", bad="warn",
               expected=str(files.folder / "calibration.toml"),
               remedy=f"dart-hal calibrate steering {_car_options(car, cars)}"),
    ]


def _car_options(car: Car, cars: Path | None) -> str:
    """Return the options that name this car on a command line, as the doctor was given them."""
    named = [] if car.url.startswith("sim:") else ["--car", car.files.config.name]
    folder = [] if cars is None else ["--cars", str(cars)]
    url = shlex.quote(car.url) if "'" in car.url else f"'{car.url}'"
    return " ".join(["--url", url, shlex.join([*named, *folder])]).strip()


def _arming(car: Car) -> Check:
    """Whether arm() would refuse, and why."""
    if not car.drives:
        return _check("arming", False, "nothing to arm: commands are not sent", bad="warn",
                      remedy="see I2C above")
    names = car.refusals()
    waived = "".join(f" --waive {n}" for n in names if BY_NAME[n].waivable)
    remedy = "cure the lines above" + (f", or drive with{waived}" if waived else "")
    return _check("arming", not names, "arm() would arm" if not names else
                  "arm() would refuse: " + ", ".join(names),
                  bad="warn" if all(BY_NAME[n].waivable for n in names) else "fail",
                  expected="no reason to refuse", remedy=remedy)


def _cautions(car: Car, cars: Path | None) -> Check:
    """What arm() would warn of and no line above has told."""
    told = [c for c in car.cautions if c.name != "NO_HARDWARE_CUTOFF"]
    verb = "dart-hal calibrate steering"
    remedies = [c.remedy.replace(verb, f"{verb} {_car_options(car, cars)}") for c in told]
    return _check("cautions", not told, "; ".join(f"{c.name}: {c.text}" for c in told)
                  or "nothing", bad="warn", remedy="; ".join(remedies))


def _skipped(checks: list[Check]) -> list[Check]:
    done = {c.id for c in checks}
    return [Check(name, title, "skip", "not reached") for name, title in TITLES.items()
            if name not in done]


def _ordered(checks: list[Check]) -> list[Check]:
    order = list(_TITLES)
    return sorted(checks, key=lambda c: order.index(c.id))

