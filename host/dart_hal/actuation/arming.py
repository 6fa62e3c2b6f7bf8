"""Why a car may not arm: every reason has a name, a sentence and a remedy.

``refusals`` names all that hold, not the first one found. What may be waived
is waived by name, in the call, and written to the recording.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from dart_hal.errors import NotArmed

GOOD_FOR = 0.5
"""s for which every check must hold before ARMED."""


@dataclass(frozen=True, slots=True)
class Facts:
    """What is known about car, link and process; the defaults are those of a good car.

    Times in s. ``wheel_moves``: edges come in at neutral. ``calibration``:
    "ok", "missing", "other_car" or "invalid". ``cutoff``: the Nano's
    safety_out. ``guard_age`` None = there is no guard process; a backend in
    virtual time needs none and passes 0.
    """

    hello: bool = True
    schema_ok: bool = True
    protocol_ok: bool = True
    link_good_for: float = math.inf
    frame_loss: float = 0.0
    clock_synced: bool = True
    rebooted: bool = False
    imu_required: bool = True
    imu_absent: bool = False
    imu_stale: bool = False
    imu_stuck: bool = False
    imu_doubted: bool = False
    wheel_moves: bool = False
    encoder_lost: bool = False
    encoder_noisy: bool = False
    pca_present: bool = True
    pca_mode_ok: bool = True
    prescale_ok: bool = True
    write_failed: bool = False
    neutral_for: float = math.inf
    arm_neutral: float = 2.0
    clock_calibrated: bool = True
    throttle: float = 0.0
    command_ok: bool = True
    raw_open: bool = False
    run_stop: bool = False
    guard_age: float | None = 0.0
    loop_p99: float = 0.0
    latched: bool = False
    calibration: str = "ok"
    cutoff_required: bool = False
    cutoff: str = "none"
    cutoff_tested: bool = True
    watchdog_fired: bool = False
    calibration_old: bool = False
    imu_calibrated: bool = True
    watchdog_on: bool = True
    firmware_dirty: bool = False


@dataclass(frozen=True, slots=True)
class Refusal:
    """One reason: holds(facts), what it means, what to do."""

    name: str
    group: str
    text: str
    remedy: str
    holds: Callable[[Facts], bool]
    waivable: bool = False


_DOCTOR = "dart-hal doctor"
REFUSALS: tuple[Refusal, ...] = (
    Refusal("NO_HELLO", "link", "the Nano has not said who it is", _DOCTOR,
            lambda f: not f.hello),
    Refusal("SCHEMA_MISMATCH", "link", "the firmware speaks other messages", "dart-hal flash",
            lambda f: not f.schema_ok),
    Refusal("PROTOCOL_TOO_OLD", "link", "the firmware speaks an older protocol",
            "dart-hal flash", lambda f: not f.protocol_ok),
    Refusal("LINK_NOT_GOOD_500MS", "link", "no gap-free 0.5 s of frames yet",
            "wait; if it stays: " + _DOCTOR, lambda f: f.link_good_for < GOOD_FOR),
    Refusal("FRAME_LOSS", "link", "more than 2 % of the frames are lost",
            "another USB cable or port", lambda f: f.frame_loss > 0.02),
    Refusal("CLOCK_NOT_SYNCED", "link", "the Nano's clock is not fitted to the host's yet",
            "wait 1 s for the time pings", lambda f: not f.clock_synced),
    Refusal("MCU_REBOOTED", "link", "the Nano restarted since the last arm()",
            "find out why (supply, reset button), then arm() again", lambda f: f.rebooted),
    Refusal("IMU_ABSENT", "sensors", "the IMU does not answer", "check its four wires",
            lambda f: f.imu_required and f.imu_absent),
    Refusal("IMU_STALE", "sensors", "the IMU's samples are old", _DOCTOR,
            lambda f: f.imu_required and f.imu_stale),
    Refusal("IMU_STUCK", "sensors", "the IMU repeats one sample",
            "switch the Nano off and on", lambda f: f.imu_required and f.imu_stuck),
    Refusal("IMU_DOUBTED", "sensors", "the IMU's numbers cannot be, or the wheels contradict them",
            "check its plug and its mount (car.toml [imu]), then " + _DOCTOR,
            lambda f: f.imu_required and f.imu_doubted),
    Refusal("ENCODER_MOVING", "sensors", "the wheels turn at neutral",
            "hold the car still; else [throttle] neutral_us in car.toml", lambda f: f.wheel_moves),
    Refusal("ENCODER_LOST", "sensors", "edges were missing while the car drove",
            "check the gap from sensor to ring; turn a wheel by hand", lambda f: f.encoder_lost),
    Refusal("ENCODER_NOISY", "sensors", "the encoder counts more edges than the car can make",
            "shade the sensor, shorten its wires", lambda f: f.encoder_noisy),
    Refusal("PCA_ABSENT", "actuators", "no PCA9685 answers", _DOCTOR,
            lambda f: not f.pca_present),
    Refusal("PCA_MODE", "actuators", "the PCA9685 sleeps or is in another mode",
            "close and open the car again", lambda f: not f.pca_mode_ok),
    Refusal("PCA_PRESCALE", "actuators", "the PCA9685's frequency is not verified",
            "close and open the car again", lambda f: not f.prescale_ok),
    Refusal("PCA_WRITE_FAILED", "actuators", "the last write to the PCA9685 failed", _DOCTOR,
            lambda f: f.write_failed),
    Refusal("NEUTRAL_TOO_SHORT", "actuators", "the ESC has not seen neutral long enough",
            "wait; arm() waits by itself", lambda f: f.neutral_for < f.arm_neutral),
    Refusal("PWM_CLOCK_UNCALIBRATED", "actuators",
            "the PCA9685's clock was never measured: neutral may be 100 us off",
            'enter [pwm] oscillator_hz in car.toml (hardware/README.md, section PWM clock), or '
            'arm(waive=["PWM_CLOCK_UNCALIBRATED"]), in a shell --waive PWM_CLOCK_UNCALIBRATED',
            lambda f: not f.clock_calibrated, waivable=True),
    Refusal("THROTTLE_NOT_NEUTRAL", "command", "a source asks for throttle",
            "release the throttle, then arm()", lambda f: f.throttle != 0.0),
    Refusal("COMMAND_INVALID", "command", "the last command was not a number",
            "check the controller's output", lambda f: not f.command_ok),
    Refusal("RAW_MODE_OPEN", "command", "raw() is open", "leave the raw() block",
            lambda f: f.raw_open),
    Refusal("RUN_STOP", "command", "the run-stop is pressed", "release it",
            lambda f: f.run_stop),
    Refusal("GUARD_MISSING", "process", "no guard process runs",
            "open the car again", lambda f: f.guard_age is None),
    Refusal("GUARD_SILENT", "process", "the guard process has not answered for 0.1 s",
            "open the car again", lambda f: f.guard_age is not None and f.guard_age > 0.1),
    Refusal("LOOP_TOO_SLOW", "process", "the loop's p99 is above 20 ms",
            "close other programs; nice -n -5", lambda f: f.loop_p99 > 0.020),
    Refusal("LATCHED", "process", "three trips in 60 s locked the car",
            'car.unlock("reason")', lambda f: f.latched),
    Refusal("CALIBRATION_MISSING", "files", "this car has no calibration.toml",
            'dart-hal calibrate steering, or arm(waive=["CALIBRATION_MISSING"]), in a shell '
            '--waive CALIBRATION_MISSING',
            lambda f: f.calibration == "missing", waivable=True),
    Refusal("CALIBRATION_OTHER_CAR", "files", "calibration.toml belongs to another car",
            "dart-hal calibrate steering", lambda f: f.calibration == "other_car"),
    Refusal("CALIBRATION_INVALID", "files", "calibration.toml cannot be used",
            "dart-hal calibrate steering", lambda f: f.calibration == "invalid"),
    Refusal("CUTOFF_REQUIRED", "hardware", "car.toml demands a hardware cut-off, none is fitted",
            "fit it (docs), or cutoff_required = false",
            lambda f: f.cutoff_required and f.cutoff == "none"),
    Refusal("CUTOFF_TEST_FAILED", "hardware", "the hardware cut-off did not cut in its test",
            "check its wiring", lambda f: f.cutoff != "none" and not f.cutoff_tested),
    Refusal("MCU_WATCHDOG_FIRED", "hardware", "the Nano's watchdog fired at its last run",
            "power the Nano off and on; report it with the recording",
            lambda f: f.watchdog_fired),
)
BY_NAME = {r.name: r for r in REFUSALS}
WAIVABLE = tuple(r.name for r in REFUSALS if r.waivable)

WARNINGS: tuple[tuple[str, Callable[[Facts], bool]], ...] = (
    ("NO_HARDWARE_CUTOFF", lambda f: f.cutoff == "none"),
    ("CALIBRATION_OLD", lambda f: f.calibration_old),
    ("IMU_UNCALIBRATED", lambda f: not f.imu_calibrated),
    ("WATCHDOG_OFF", lambda f: not f.watchdog_on),
    ("FIRMWARE_DIRTY", lambda f: f.firmware_dirty),
)


def refusals(facts: Facts, waive: Iterable[str] = ()) -> tuple[str, ...]:
    """Names of every reason that holds and is not waived.

    Raises NotArmed for a waiver that does not exist or may not be given.
    """
    given = set(waive)
    wrong = sorted(given - set(WAIVABLE))
    if wrong:
        raise NotArmed(f"{', '.join(wrong)} cannot be waived", found=", ".join(wrong),
                       remedy="waivable: " + ", ".join(WAIVABLE))
    return tuple(r.name for r in REFUSALS if r.name not in given and r.holds(facts))


def warnings(facts: Facts) -> tuple[str, ...]:
    """Names of what does not refuse but should be known."""
    return tuple(name for name, holds in WARNINGS if holds(facts))


def not_armed(names: Iterable[str]) -> NotArmed:
    """The error that lists every reason with its sentence and remedy."""
    known = [BY_NAME[name] for name in names]
    found = "\n".join(f"{r.name}: {r.text}" for r in known)
    remedy = "\n".join(dict.fromkeys(r.remedy for r in known))
    return NotArmed("the car does not arm", reasons=tuple(r.name for r in known), found=found,
                    remedy=remedy)
