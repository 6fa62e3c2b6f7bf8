"""Checks of ``dart-hal doctor``: one function each, with a remedy for a fault.

Each check compares one property of an open car with its expected value:

1. Open the backend, then the car. A fault here is one failed check.
2. Listen to the stream: firmware, rates, losses, clock, IMU, encoder.
3. Check the files of the car, and external poses, lidar and camera if there are any.
4. Check whether arm() would refuse.
5. Checks that could not run are reported as skipped.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from dart_hal.car import Car
from dart_hal.car.camera import open_named_camera
from dart_hal.core.config.car import BatteryConfig, RcConfig
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

SourceT = TypeVar("SourceT")
# STATE frames per second, by the protocol.
STATE_FRAME_RATE = 100.0
# m/s2, without gravity: larger than the offset of an IMU on a level car at rest.
MAX_ACCEL_AT_REST = 0.35


@dataclass(frozen=True, slots=True)
class DoctorCheck:
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


CHECK_TITLES = {
    "port": "port", "bus": "I2C and PCA9685", "files": "files of the car", "hello": "firmware",
    "schema": "message definitions", "rate": "frame rate", "losses": "losses",
    "clock": "clock", "imu": "IMU", "encoder": "encoder", "cutoff": "hardware cut-off",
    "pwm": "PWM clock", "calibration": "calibration", "arming": "arming", "cautions": "cautions",
}
# With the checks of optional sensors. The order is that of the report.
ALL_TITLES = {**CHECK_TITLES, "poses": "external poses", "lidar": "lidar", "camera": "camera",
              "battery": "battery", "rc": "RC receiver"}


def _make_check(name: str, good: bool, found: str, *, bad: str = "fail", expected: str = "",
                cause: str = "", remedy: str = "") -> DoctorCheck:
    """Return a check: "ok" if good, else the verdict ``bad``."""
    verdict = "ok" if good else bad
    return DoctorCheck(name, ALL_TITLES[name], verdict, found, expected, cause, remedy)


def _check_of_error(name: str, error: DartHalError) -> DoctorCheck:
    """Return the failed check of an error."""
    found = f"{error.what}: {error.found}" if error.found else error.what
    return DoctorCheck(name, ALL_TITLES[name], "fail", found, error.expected, error.likely,
                       error.remedy)


def run_checks(url: str, car_name: str, cars: Path | None, seconds: float,
               poses: str | None = None, camera: str | None = None) -> list[DoctorCheck]:
    """Open a car and check it; checks that a fault prevents are skipped."""
    checks: list[DoctorCheck] = []
    try:
        backend = open_backend(url)
    except (UnknownScheme, UsageError):
        # The command line is wrong, not the car.
        raise
    except DartHalError as error:
        checks.append(_check_of_error("bus" if isinstance(error, BusError) else "port", error))
        return checks + _list_skipped(checks)
    checks.append(_make_check("port", True, f"{url} is open"))
    # A faulty sensor is one failed check: the car is checked without it.
    pose_source = _open_source("poses", lambda: open_poses(poses or ""), backend, checks
                               ) if poses else None
    image_source = _open_source("camera", lambda: open_named_camera(backend, camera or ""), backend,
                                checks) if camera else None
    car = _open_car(backend, url, car_name, cars, checks, pose_source, image_source)
    if car is None:
        for source in (pose_source, image_source):
            if source is not None:
                source.close()
        return checks + _list_skipped(checks)
    try:
        # All checks of the stream use the same seconds, so the doctor listens only once.
        states = list(car.states(duration=seconds, timeout=1.0))
        checks += _check_stream(car, states)
        checks += _check_files(car, cars)
        if backend.poses is not None and states[-1].external is not None:
            checks.append(_check_poses(backend.poses, states))
        if backend.lidar is not None:
            checks.append(_check_lidar(car))
        if backend.camera is not None:
            checks.append(_check_camera(car))
        if car.has_battery:
            checks.append(_check_battery(car, states))
        if car.files.config.rc is not None and car.files.config.rc.enabled:
            checks.append(_check_rc(car, car.files.config.rc))
        checks += [_check_arming(car), _check_cautions(car, cars)]
    except DartHalError as error:
        # A fault in between is one of the stream; checks that were not reached are skipped.
        checks.append(_check_of_error("rate", error))
    finally:
        car.close()
    return _sort_checks(checks + _list_skipped(checks))


def _open_source(name: str, opener: Callable[[], SourceT], backend: Backend,
                 checks: list[DoctorCheck]) -> SourceT | None:
    """Open a source of poses or images; None and a failed check if that is impossible."""
    try:
        return opener()
    except UsageError:
        backend.close()
        raise
    except DartHalError as error:
        checks.append(_check_of_error(name, error))
        return None


def _open_car(backend: Backend, url: str, car_name: str, cars: Path | None,
              checks: list[DoctorCheck], poses: PoseSource | None,
              camera: ImageSource | None) -> Car | None:
    """Open the car, without its I2C bus if that has a fault; None if it cannot be opened."""
    try:
        if backend.bus is None:
            checks.append(check_missing_bus(url))
        car = Car.over(backend, car=car_name, cars=cars, poses=poses, camera=camera)
    except BusError as error:
        checks.append(_check_of_error("bus", error))
        backend = open_backend(url)
        backend.bus = None
        return _open_without_bus(backend, car_name, cars, checks)
    except ConfigError as error:
        checks.append(_check_of_error("files", error))
        return None
    except DartHalError as error:
        checks.append(_check_of_error("hello", error))
        return None
    if backend.bus is not None:
        # Send neutral first, so that the report states a pulse that the pins have now.
        applied = car.stop()
        pulse = (f"throttle at {applied.throttle_us:.1f} us" if applied.throttle_us
                 else "no pulse before the Nano's first message")
        checks.append(_make_check("bus", True, f"PCA9685 answers correctly, {pulse}"))
    return car


def check_missing_bus(url: str) -> DoctorCheck:
    """Return the check of a URL without an I2C bus."""
    # The bus is an option of the URL of a real car; other backends have none to name.
    remedy = f"--url '{url}{'&' if '?' in url else '?'}i2c=1'"
    if not url.startswith(("serial:", "hwgrep:")):
        remedy = "nothing to do: this backend has no actuators"
    return DoctorCheck("bus", CHECK_TITLES["bus"], "warn", "no I2C bus behind this URL",
                       remedy=remedy, cause="commands are not sent")


def _open_without_bus(backend: Backend, car_name: str, cars: Path | None,
                      checks: list[DoctorCheck]) -> Car | None:
    try:
        return Car.over(backend, car=car_name, cars=cars)
    except DartHalError as error:
        checks.append(_check_of_error("hello", error))
        return None


def _check_stream(car: Car, states: list[State]) -> list[DoctorCheck]:
    """Check firmware, frame rate, losses, clock, IMU and encoder."""
    hello = car.hello
    version = ".".join(map(str, hello.version))
    if not states:
        raise LinkLost("the Nano sent HELLO, but no STATE frame",
                       found=f"{car.timing.damaged} damaged frames")
    last = states[-1]
    timing = car.timing
    # n frames last n periods: from the first to the last time stamp and one period more. The rate
    # by sequence numbers includes lost frames; the smaller of both rates is reported.
    duration = max(last.t - states[0].t + 1 / STATE_FRAME_RATE, 1e-3)
    rate = min(last.seq - states[0].seq + 1, len(states)) / duration
    lost_fraction = timing.lost / max(last.seq, 1)
    return [
        _make_check("hello", not hello.mock, f"version {version}, board {hello.board_id:08x}, "
                    f"boot {hello.boot_count}" + (", MockNano: no firmware" if hello.mock else ""),
                    bad="warn", expected="the firmware",
                    cause="the URL asks for it" if "nano=mock" in car.url else
                    "the emulator was not built",
                    remedy="the same URL without nano=mock" if "nano=mock" in car.url else
                    "make firmware"),
        _make_check("schema", hello.same_schema, f"{hello.schema:08x}", expected=f"{SCHEMA:08x}",
                    cause="firmware and library are of different versions",
                    remedy="dart-hal flash"),
        _make_check("rate", abs(rate - STATE_FRAME_RATE) < 2.0,
                    f"{rate:.1f} STATE frames per second", expected="100",
                    cause="a slow USB hub or a busy computer",
                    remedy="another USB port; close other programs"),
        _make_check("losses", lost_fraction < 1e-3 and timing.damaged == 0,
                    f"{timing.lost} frames lost, {timing.damaged} damaged", expected="none",
                    bad="warn" if lost_fraction < 0.02 else "fail", cause="a poor USB cable or a "
                                                                          "ground loop",
                    remedy="another cable, shorter, away from the motor leads"),
        _make_check("clock", last.health.t_std < 1e-3, "standard deviation of the time stamps "
                    f"{last.health.t_std * 1e3:.2f} ms", bad="warn", expected="below 1 ms",
                    cause="USB latency timer of 16 ms",
                    remedy="setserial PORT low_latency, or the udev rule of the handbook"),
        _check_imu(states), _check_encoder(states),
    ]


def _check_imu(states: list[State]) -> DoctorCheck:
    last = states[-1]
    flags = last.health.flags
    for name in ("IMU_ABSENT", "IMU_STUCK", "IMU_STALE"):
        if name in flags:
            refusal = BY_NAME[name]
            return _make_check("imu", False, refusal.text, expected="a sample each 10 ms",
                               cause="SDA/SCL swapped, loose jumper, or no 5 V at D4",
                               remedy="check the four wires against the wiring page; "
                               + refusal.remedy)
    if last.yaw_rate is None:
        return _make_check("imu", False, "no valid sample", expected="a sample each 10 ms",
                           cause="still starting", remedy="run doctor again")
    # At rest both readings are offsets only. The mean averages the noise of the gyro out; a car
    # that is moved or rotated exceeds the limits.
    rates = [s.yaw_rate for s in states if s.yaw_rate is not None]
    mean_rate = sum(rates) / len(rates)
    acceleration = max(abs(last.accel_x or 0.0), abs(last.accel_y or 0.0))
    return _make_check("imu", abs(mean_rate) < 0.1 and acceleration < 3 * MAX_ACCEL_AT_REST,
                       f"yaw rate {mean_rate:+.4f} rad/s, age {last.health.imu_age * 1e3:.0f} ms",
                       bad="warn", expected="near zero while the car is at rest",
                       cause="the car is being moved",
                       remedy="do not move the car, and run doctor again")


def _check_encoder(states: list[State]) -> DoctorCheck:
    # Edges without a speed are flicker: the sensor is at the border of a mark.
    edges = states[-1].ticks - states[0].ticks
    return _make_check("encoder", edges == 0 or abs(states[-1].speed) > 0.05,
                       f"{edges} edges while listening ({states[-1].ticks} since boot); "
                       "turn a wheel by hand to see them", bad="warn",
                       expected="none at rest", cause="the sensor is at an edge of a mark and "
                                                      "flickers",
                       remedy="turn its potentiometer until the LED is steady")


def _check_poses(source: PoseSource, states: list[State]) -> DoctorCheck:
    """Check whether external poses arrive, and report the last one."""
    external = [s.external for s in states if s.external is not None]
    # A pose stays the newest until the next one comes: distinct stamps count the poses.
    stamps = {e.newest.stamp for e in external if e.newest is not None}
    why = str(getattr(source, "why", ""))
    last = external[-1] if external else None
    if last is None or last.pose is None or not stamps:
        return _make_check("poses", False, f"no pose: {why or 'no message from the source'}",
                           bad="warn", expected="poses of the car",
                           cause="no stream, another body, or a firewall",
                           remedy="docs/how_to/poses.md")
    found = (f"a new pose in {len(stamps)} of {len(states)} frames, {last.tracking.value}, "
             f"x {last.pose.x:+.2f} m y {last.pose.y:+.2f} m yaw {last.pose.yaw:+.2f} rad")
    return _make_check("poses", last.tracking is Tracking.TRACKING,
                       found + (f"; {why}" if why else ""), bad="warn", expected="TRACKING",
                       cause="the car is hidden, or the poses are of another body",
                       remedy="docs/how_to/poses.md, section Tracking")


def _check_lidar(car: Car) -> DoctorCheck:
    """Check whether scans arrive, and report the problems that they show."""
    error = car.lidar.trouble
    health = car.lidar.health
    count = len(car.lidar.scans())
    if error is not None:
        return replace(_check_of_error("lidar", error), verdict="warn")
    if health is None:
        return _make_check("lidar", False, "no complete revolution yet", bad="warn",
                           expected="8 per second", cause="its motor needs 1 to 2 s to start",
                           remedy="dart-hal doctor --seconds 6")
    problems = list(health.sentences())
    return _make_check("lidar", not problems, "; ".join((
        f"{count} revolutions, {health.rate:.2f} per second of {health.beams:.0f} beams, "
        f"{100.0 * health.returned:.0f} % with a return", *problems)), bad="warn",
        expected="no problem", remedy="docs/how_to/lidar.md, section Health")


def _check_camera(car: Car) -> DoctorCheck:
    """Check whether images arrive, and report the problems that they show."""
    error = car.camera.trouble
    health = car.camera.health
    image = (car.camera.images() or (None,))[-1]
    if error is not None:
        return replace(_check_of_error("camera", error), verdict="warn")
    if health is None or image is None:
        return _make_check("camera", False, "fewer than two images", bad="warn",
                           expected="10 per second or more", cause="it was opened just now",
                           remedy="dart-hal doctor --seconds 6")
    problems = list(health.sentences())
    width, height = image.size
    return _make_check("camera", not problems, "; ".join((
        f"{width} x {height}, {health.rate:.1f} per second of {1e-3 * health.size:.0f} kB, "
        f"{1e3 * health.age:.0f} ms old", *problems)), bad="warn",
        expected="no problem", remedy="docs/how_to/camera.md, section Whether it is well")


def _battery_advice(config: BatteryConfig) -> dict[str, str]:
    """Return what a car without a voltage should have, and what to do."""
    if config.source == "nano":
        return {"expected": "a divider at A0 of the Nano", "cause": "a wire of the divider is off, "
                "or another ratio or number of cells",
                "remedy": "docs/build_guide/06_wiring.md, section Options"}
    return {"expected": f"an INA219 at 0x{config.address:02x}",
            "cause": "no such chip, another address, or no battery at its board",
            "remedy": "sudo i2cdetect -y BUS ; then [battery] address in car.toml"}


def _check_battery(car: Car, states: list[State]) -> DoctorCheck:
    """Check whether the voltage is measured, and whether the battery is charged."""
    config = car.files.config.battery or BatteryConfig()
    voltages = [s.battery for s in states if s.battery is not None]
    if not voltages:
        return _make_check("battery", False, "no voltage", bad="warn",
                           **_battery_advice(config))
    # The highest: a load lowers the voltage for a moment.
    cell = max(voltages) / config.cells
    return _make_check("battery", cell >= config.warn_cell,
                       f"{max(voltages):.2f} V, {cell:.2f} V per cell", bad="warn",
                       expected=f"{config.warn_cell:g} V per cell or more",
                       remedy="charge it; forward throttle is limited below "
                              f"{config.limit_cell:g} V per cell")


def _check_rc(car: Car, config: RcConfig) -> DoctorCheck:
    """Check whether the RC receiver has a signal on every channel that is used."""
    pulses = car.rc_pulses or (0.0, 0.0, 0.0)
    used = pulses if config.mode_us is not None else pulses[:2]
    return _make_check("rc", all(used), ", ".join(
        f"{name} {pulse:.0f} us" if pulse else f"{name} no signal"
        for name, pulse in zip(("steering", "throttle", "mode"), used, strict=False)), bad="warn",
        expected="800 to 2200 us on every channel", cause="the transmitter is off, or a wire",
        remedy="switch it on; docs/build_guide/06_wiring.md, section Options")


def _check_files(car: Car, cars: Path | None) -> list[DoctorCheck]:
    """Check the files, the hardware cut-off, the PWM clock and the calibration of the car."""
    files = car.files
    # A kind that this version does not know counts as none, as it does for arming.
    fitted = car.hello.cutoff != "none"
    map_ = files.calibration.steering.map if files.calibration else None
    return [
        _make_check("files", True, f"{files.origin}"),
        _make_check("cutoff", fitted, "fitted" if fitted else
                    "none: if the computer fails, the car keeps its throttle", bad="warn",
                    expected="/OE or multiplexer on the Nano",
                    remedy="hardware/README.md, section Hardware cut-off"),
        _make_check("pwm", files.oscillator_hz is not None, "measured" if files.oscillator_hz else
                    "not measured: neutral may be wrong by 100 us", bad="warn",
                    expected="[pwm] oscillator_hz in car.toml",
                    remedy=BY_NAME["PWM_CLOCK_UNCALIBRATED"].remedy),
        _make_check("calibration", map_ is not None, "steering map of this car" if map_ else
                    "no steering map: the paper's is used", bad="warn",
                    expected=str(files.folder / "calibration.toml"),
                    remedy=f"dart-hal calibrate steering {_car_options(car, cars)}"),
    ]


def _car_options(car: Car, cars: Path | None) -> str:
    """Return the options of the command line that select this car, as passed to the doctor."""
    named = [] if car.url.startswith("sim:") else ["--car", car.files.config.name]
    folder = [] if cars is None else ["--cars", str(cars)]
    url = shlex.quote(car.url) if "'" in car.url else f"'{car.url}'"
    return " ".join(["--url", url, shlex.join([*named, *folder])]).strip()


def _check_arming(car: Car) -> DoctorCheck:
    """Check whether arm() would refuse, and report the reasons."""
    if not car.drives:
        return _make_check("arming", False, "nothing to arm: commands are not sent", bad="warn",
                           remedy="see I2C above")
    names = car.refusals()
    # Only what a user may waive is offered; all else has to be fixed.
    waived = "".join(f" --waive {n}" for n in names if BY_NAME[n].waivable)
    remedy = "fix the problems above" + (f", or drive with{waived}" if waived else "")
    return _make_check("arming", not names, "arm() would arm" if not names else
                       "arm() would refuse: " + ", ".join(names),
                       bad="warn" if all(BY_NAME[n].waivable for n in names) else "fail",
                       expected="no reason to refuse", remedy=remedy)


def _check_cautions(car: Car, cars: Path | None) -> DoctorCheck:
    """Report the cautions of arm() that no other check reports."""
    cautions = [c for c in car.cautions if c.name != "NO_HARDWARE_CUTOFF"]
    verb = "dart-hal calibrate steering"
    remedies = [c.remedy.replace(verb, f"{verb} {_car_options(car, cars)}") for c in cautions]
    return _make_check("cautions", not cautions,
                       "; ".join(f"{c.name}: {c.text}" for c in cautions) or "none", bad="warn",
                       remedy="; ".join(remedies))


def _list_skipped(checks: list[DoctorCheck]) -> list[DoctorCheck]:
    done = {c.id for c in checks}
    return [DoctorCheck(name, title, "skip", "not reached") for name, title in CHECK_TITLES.items()
            if name not in done]


def _sort_checks(checks: list[DoctorCheck]) -> list[DoctorCheck]:
    order = list(ALL_TITLES)
    return sorted(checks, key=lambda c: order.index(c.id))

