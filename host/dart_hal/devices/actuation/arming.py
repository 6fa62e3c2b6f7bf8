"""Why a car may not arm: every refusal has a name, a sentence and a remedy.

``refusals`` returns all that apply, not only the first. A refusal is waived by name, in the call
of ``arm``, and the waiver is recorded.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from dart_hal.core.errors import NotArmed

# ms that a Nano with a cut-off waits for a heartbeat. The ESC is then at neutral within 140 ms.
BEAT_LIMIT_MS = 110
# s since the last byte of the guard process; it writes one each 20 ms. The check runs each frame
# (10 ms), and a pulse that has begun ends within 20 ms: neutral 80 + 10 + 20 = 110 ms after the
# guard's last byte.
MAX_GUARD_AGE = 0.08
# s, one PWM frame: with a larger delay of its pulses, the loop does not keep up.
MAX_PULSE_DELAY = 0.02
# s for which every check must pass before ARMED.
MIN_GOOD_TIME = 0.5


@dataclass(frozen=True, slots=True)
class Facts:
    """State of car, link and process as the checks need it; the defaults are those of a good car.

    Times in s. ``wheel_moves``: edges arrive at neutral; ``moves_at_neutral``: they arrived
    faster and faster, the pulses are off, and the wheels have not come to rest since.
    ``bus_fault``: "absent", "mode", "prescale" or "write", None = the PCA9685 works.
    ``cutoff``: the Nano's safety_out; ``cutoff_test``: "pending", "passed", "failed", "unwired"
    (no pulse arrived through the capture wire). ``car_moves``: the wheels must be off the ground,
    and the IMU does not show a car at rest. ``beat_limit``: the Nano's heartbeat limit [ms],
    None = not received yet. ``other_board``: the calibration was measured with another Nano;
    ``calibration_unbound``: it does not name one. ``guard_age``: since the guard's last byte,
    None = there is no guard process; a backend in virtual time needs none and passes 0.
    ``loop_late``: 99th percentile of the delay with which pulses are written.
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
    moves_at_neutral: bool = False
    encoder_lost: bool = False
    encoder_noisy: bool = False
    car_moves: bool = False
    bus_fault: str | None = None
    neutral_for: float = math.inf
    arm_neutral: float = 2.0
    clock_calibrated: bool = True
    throttle: float = 0.0
    command_ok: bool = True
    raw_open: bool = False
    run_stop: bool = False
    rc_lost: bool = False
    guard_age: float | None = 0.0
    loop_late: float = 0.0
    latched: bool = False
    calibration_missing: bool = False
    calibration_old: bool = False
    other_board: bool = False
    calibration_unbound: bool = False
    cutoff_required: bool = False
    cutoff: str = "none"
    cutoff_test: str = "passed"
    cutoff_test_required: bool = False
    beat_limit: int | None = BEAT_LIMIT_MS
    watchdog_fired: bool = False
    imu_calibrated: bool = True
    firmware_dirty: bool = False
    simulated: bool = False


@dataclass(frozen=True, slots=True)
class Refusal:
    """One reason not to arm: whether it applies to facts, what it means, what to do."""

    name: str
    group: str
    text: str
    remedy: str
    holds: Callable[[Facts], bool]
    waivable: bool = False


_DOCTOR = "dart-hal doctor"
REFUSALS: tuple[Refusal, ...] = (
    Refusal("NO_HELLO", "link", "the Nano has not sent HELLO, its identification", _DOCTOR,
            lambda f: not f.hello),
    Refusal("SCHEMA_MISMATCH", "link", "the messages of the firmware have another layout",
            "dart-hal flash", lambda f: not f.schema_ok),
    Refusal("PROTOCOL_TOO_OLD", "link", "the firmware uses an older protocol",
            "dart-hal flash", lambda f: not f.protocol_ok),
    Refusal("LINK_NOT_GOOD_500MS", "link", "no gap-free 0.5 s of frames yet",
            "wait; if it stays: " + _DOCTOR, lambda f: f.link_good_for < MIN_GOOD_TIME),
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
    Refusal("IMU_DOUBTED", "sensors", "the IMU's values are impossible, or contradict the wheels",
            "check its plug and its mount (car.toml [imu]), then " + _DOCTOR,
            lambda f: f.imu_required and f.imu_doubted),
    Refusal("ENCODER_MOVING", "sensors", "the wheels turn at neutral",
            "wait until the car is at rest; if it stays: [throttle] neutral_us in car.toml",
            lambda f: f.wheel_moves),
    Refusal("MOVES_AT_NEUTRAL", "sensors",
            "the wheels turned faster while the throttle was neutral; the pulses are off",
            "hold the car still and arm() again; if it comes again, check the marks of the encoder "
            "ring, [throttle] neutral_us, [pwm] oscillator_hz and the channels in the car's files",
            lambda f: f.moves_at_neutral),
    Refusal("ENCODER_LOST", "sensors", "edges were missing while the car drove",
            "check the gap from sensor to ring; turn a wheel by hand", lambda f: f.encoder_lost),
    Refusal("ENCODER_NOISY", "sensors", "the encoder counts more edges than the car can make",
            "shade the sensor, shorten its wires", lambda f: f.encoder_noisy),
    Refusal("CAR_MOVES", "sensors",
            "the IMU does not show a car at rest with its wheels off the ground",
            "put the car on blocks and hold it still; the IMU must be valid",
            lambda f: f.car_moves),
    Refusal("PCA_ABSENT", "actuators", "no PCA9685 answers", _DOCTOR,
            lambda f: f.bus_fault == "absent"),
    Refusal("PCA_MODE", "actuators", "the PCA9685 sleeps, or another program writes to it",
            "check its 3.3 V, end other programs on the bus, then open the car again",
            lambda f: f.bus_fault == "mode"),
    Refusal("PCA_PRESCALE", "actuators", "the PCA9685 runs at another frequency than was set",
            "check its 3.3 V, end other programs on the bus, then open the car again",
            lambda f: f.bus_fault == "prescale"),
    Refusal("PCA_WRITE_FAILED", "actuators", "the last write to the PCA9685 failed", _DOCTOR,
            lambda f: f.bus_fault == "write"),
    Refusal("NEUTRAL_TOO_SHORT", "actuators", "the ESC has not received neutral for long enough",
            "wait; arm() waits by itself", lambda f: f.neutral_for < f.arm_neutral),
    Refusal("PWM_CLOCK_UNCALIBRATED", "actuators",
            "the PCA9685's clock was never measured: neutral may be 100 us off",
            'enter [pwm] oscillator_hz in car.toml (hardware/README.md, section PWM clock), or '
            'arm(waive=["PWM_CLOCK_UNCALIBRATED"]), in a shell --waive PWM_CLOCK_UNCALIBRATED',
            lambda f: not f.clock_calibrated, waivable=True),
    Refusal("THROTTLE_NOT_NEUTRAL", "command", "a source requests throttle",
            "release the throttle, then arm()", lambda f: f.throttle != 0.0),
    Refusal("COMMAND_INVALID", "command", "the last command was not a number",
            "check the controller's output; 0.5 s later arm() again", lambda f: not f.command_ok),
    Refusal("RAW_MODE_OPEN", "command", "raw() is open", "leave the raw() block",
            lambda f: f.raw_open),
    Refusal("RUN_STOP", "command",
            "a run-stop is pressed: at a page, by a program, or in a room that no program watches",
            "release it; a page and a room release theirs 0.5 s after the last stop. A room also "
            "needs its watching program: dart-hal fleet watch",
            lambda f: f.run_stop),
    Refusal("RC_LOST", "command",
            "the signal of the RC transmitter was lost while its driver drove",
            "switch the transmitter on, go closer; or [rc] enabled = false in car.toml",
            lambda f: f.rc_lost),
    Refusal("GUARD_MISSING", "process", "no guard process runs",
            "open the car again", lambda f: f.guard_age is None),
    Refusal("GUARD_SILENT", "process",
            f"the guard process has not answered for {MAX_GUARD_AGE:g} s", "open the car again",
            lambda f: f.guard_age is not None and f.guard_age > MAX_GUARD_AGE),
    Refusal("LATCHED", "process", "three trips in 60 s locked the car",
            'car.unlock("reason")', lambda f: f.latched),
    Refusal("CALIBRATION_MISSING", "files", "this car has no calibration.toml",
            'dart-hal calibrate steering, or arm(waive=["CALIBRATION_MISSING"]), in a shell '
            '--waive CALIBRATION_MISSING',
            lambda f: f.calibration_missing, waivable=True),
    Refusal("CALIBRATION_OTHER_BOARD", "files",
            "calibration.toml was measured with another Nano than the one that answers",
            "same car, new Nano: dart-hal calibrate accept-board; else use the files of this car",
            lambda f: f.other_board),
    Refusal("CUTOFF_REQUIRED", "hardware", "car.toml requires a hardware cut-off, none is fitted",
            "fit it (docs), or cutoff_required = false",
            lambda f: f.cutoff_required and f.cutoff == "none"),
    Refusal("CUTOFF_UNTESTED", "hardware", "the test of the hardware cut-off is not finished",
            "wait; arm() waits by itself",
            lambda f: f.cutoff != "none" and f.cutoff_test == "pending"),
    Refusal("CUTOFF_TEST_FAILED", "hardware",
            "the hardware cut-off did not cut, or no capture wire shows that it does",
            "check its wiring (docs, hardware cut-off); without a capture wire: [safety] "
            "cutoff_test = false",
            lambda f: f.cutoff != "none" and (f.cutoff_test == "failed" or (
                f.cutoff_test == "unwired" and f.cutoff_test_required))),
    Refusal("BEAT_LIMIT_UNKNOWN", "hardware", "the Nano has not reported its heartbeat limit",
            "wait; if it stays: dart-hal flash",
            lambda f: f.cutoff != "none" and f.beat_limit is None),
    Refusal("BEAT_LIMIT_TOO_LONG", "hardware",
            f"the Nano waits longer than {BEAT_LIMIT_MS} ms for a heartbeat before it cuts",
            f"dart-hal parameter beat_timeout_ms {BEAT_LIMIT_MS}",
            lambda f: f.cutoff != "none" and (f.beat_limit or 0) > BEAT_LIMIT_MS),
    Refusal("MCU_WATCHDOG_FIRED", "hardware", "the Nano's watchdog fired in its last run",
            "power the Nano off and on; report it with the recording",
            lambda f: f.watchdog_fired),
)
BY_NAME = {r.name: r for r in REFUSALS}
WAIVABLE = tuple(r.name for r in REFUSALS if r.waivable)


@dataclass(frozen=True, slots=True)
class Caution:
    """A warning that does not prevent arming: whether it applies, what it means, what to do."""

    name: str
    text: str
    remedy: str
    holds: Callable[[Facts], bool]

    def __str__(self) -> str:
        return f"{self.name}: {self.text}; {self.remedy}"


CAUTIONS: tuple[Caution, ...] = (
    Caution("NO_HARDWARE_CUTOFF", "if the computer dies the car keeps its throttle",
             "fit a cut-off (docs, hardware cut-off)",
             lambda f: f.cutoff == "none" and not f.simulated),
    Caution("CUTOFF_UNPROVEN", "no capture wire shows whether the hardware cut-off cuts",
             "lead channel 15 through the cut-off to D8",
             lambda f: f.cutoff != "none" and f.cutoff_test == "unwired"),
    Caution("CALIBRATION_OLD", "the car was calibrated more than half a year ago",
             "dart-hal calibrate steering", lambda f: f.calibration_old),
    Caution("CALIBRATION_UNBOUND", "calibration.toml does not name the Nano it was measured with",
             "dart-hal calibrate accept-board", lambda f: f.calibration_unbound),
    Caution("IMU_UNCALIBRATED", "the gyro has not calibrated itself",
             "keep the car at rest for some seconds", lambda f: not f.imu_calibrated),
    Caution("LOOP_LATE", "pulses are written more than 20 ms late (p99)",
             "close other programs; nice -n -5", lambda f: f.loop_late > MAX_PULSE_DELAY),
    Caution("FIRMWARE_DIRTY", "the firmware was built from sources that were not committed",
             "dart-hal flash", lambda f: f.firmware_dirty),
)


def refusals(facts: Facts, waive: Iterable[str] = ()) -> tuple[str, ...]:
    """Return the names of all refusals that apply and are not waived.

    Raises NotArmed for a waiver that does not exist or is not allowed.
    """
    given = set(waive)
    wrong = sorted(given - set(WAIVABLE))
    if wrong:
        raise NotArmed(f"{', '.join(wrong)} cannot be waived", found=", ".join(wrong),
                       remedy="waivable: " + ", ".join(WAIVABLE))
    return tuple(r.name for r in REFUSALS if r.name not in given and r.holds(facts))


def list_cautions(facts: Facts) -> tuple[Caution, ...]:
    """Return the warnings that apply and do not prevent arming."""
    return tuple(c for c in CAUTIONS if c.holds(facts))


def not_armed_error(names: Iterable[str]) -> NotArmed:
    """Return the error that lists every refusal with its sentence and remedy."""
    reasons = [BY_NAME[name] for name in names]
    found = "\n".join(f"{r.name}: {r.text}" for r in reasons)
    remedy = "\n".join(dict.fromkeys(r.remedy for r in reasons))
    return NotArmed("the car does not arm", reasons=tuple(r.name for r in reasons), found=found,
                    remedy=remedy)
