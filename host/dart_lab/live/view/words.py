"""Messages for the user of the page: why the car does not drive, and what to do.

The error messages of the package are for programmers: they name functions and keys of files. The
user of the page has buttons instead. Names without an entry here use the message of the package,
which also applies to a page.
"""

from __future__ import annotations

from dart_hal.devices.actuation.arming import BY_NAME
from dart_hal.devices.actuation.trips import TRIPS

# What happened, and what to do.
Words = tuple[str, str]
ARM = "Arm when the way is free."
WAIT_FOR_REST = "Wait until the car is at rest, then arm."
DOCTOR = "At the car's computer: dart-hal doctor."
REOPEN = "End the program that serves this page and start it again."

TRIP_WORDS: dict[str, Words] = {
    "COMMAND_EXPIRED": ("The car received no new command in time.",
                        "The network or the car's computer was too slow: go closer, close other "
                        f"programs. {ARM}"),
    "COMMAND_INVALID": ("A command was not a number.",
                        f"Look for the fault in the program that drives. {ARM}"),
    "TIME_BACKWARD": ("The clock of the car's computer went back.", ARM),
    "LINK_STALE": ("No message came from the Nano.", f"Check its cable and its power. {DOCTOR}"),
    "MCU_REBOOTED": ("The Nano restarted while the car was armed.",
                     f"Check its power and its cable. {DOCTOR}"),
    "PCA_WRITE_FAILED": ("The PWM board did not take a pulse.",
                         f"Check its four wires. {DOCTOR}"),
    "PCA_READBACK": ("The PWM board lost its settings.",
                     f"Check its supply; end other programs that use it. {DOCTOR}"),
    "GUARD_TRIPPED": ("The program that serves this page did not respond, and its guard stopped "
                      "the "
                      "car.", f"Close other programs on the car's computer. {ARM}"),
    "GUARD_SILENT": ("The guard process does not answer.", REOPEN),
    "SUSPENDED": ("The car's computer was asleep.", f"Let it never sleep. {ARM}"),
    "CUT_OFF": ("The hardware cut-off does not pass the pulses on.",
                f"Check the Nano and its wires. {DOCTOR}"),
    "MOVES_AT_NEUTRAL": ("The wheels sped up at neutral, so motor and steering get no pulse.",
                         f"{WAIT_FOR_REST} If it was not pushed, its neutral is wrong. {DOCTOR}"),
    "AGAINST_THROTTLE": ("The car sped up against its throttle.",
                         "The leads of the motor are swapped, or the IMU is turned by 180 degrees. "
                         f"{DOCTOR}"),
    "RC_LOST": ("The signal of the RC transmitter was lost.",
                f"Check its battery and its range. {ARM}"),
    "RC_OVERRIDE": ("The driver of the RC transmitter took over.", ARM),
    "RUN_STOP": ("The car was stopped.", ARM),
}

REFUSAL_WORDS: dict[str, Words] = {
    "MCU_REBOOTED": TRIP_WORDS["MCU_REBOOTED"],
    "IMU_DOUBTED": ("The IMU's numbers are impossible, or the wheels contradict them.",
                    f"Check its plug and its mount. {DOCTOR}"),
    "MOVES_AT_NEUTRAL": TRIP_WORDS["MOVES_AT_NEUTRAL"],
    "ENCODER_MOVING": ("The wheels turn.",
                       f"{WAIT_FOR_REST} If they turn without end, at the car's computer: dart-hal "
                       "calibrate esc."),
    "NEUTRAL_TOO_SHORT": ("The motor controller needs 2 s of neutral first.", "Wait."),
    "PWM_CLOCK_UNCALIBRATED": (
        "The clock of the PWM board was not measured: neutral may be wrong by 100 us.",
        "Measure it, or start the page with --waive PWM_CLOCK_UNCALIBRATED."),
    "THROTTLE_NOT_NEUTRAL": ("A throttle is requested.", "Release the stick, then arm."),
    "COMMAND_INVALID": TRIP_WORDS["COMMAND_INVALID"],
    "RC_LOST": ("The RC transmitter has no signal, and its driver drove.",
                "Switch it on, or go closer."),
    "RAW_MODE_OPEN": ("A calibration runs.", "Wait until it has ended."),
    "GUARD_MISSING": ("No guard process runs.", REOPEN),
    "GUARD_SILENT": TRIP_WORDS["GUARD_SILENT"],
    "LATCHED": ("Three trips within a minute locked the car.",
                "Find the cause, then press Unlock."),
    "CALIBRATION_MISSING": ("This car has no calibration.",
                            "At its computer: dart-hal calibrate steering. Or start the page with "
                            "--waive CALIBRATION_MISSING."),
    "CALIBRATION_OTHER_BOARD": (
        "The calibration was measured with another Nano.",
        "Same car, new Nano: at its computer dart-hal calibrate accept-board."),
    "CUTOFF_REQUIRED": ("The files of the car require a hardware cut-off, and none is fitted.",
                        "Fit it, or change the files of the car."),
    "CUTOFF_UNTESTED": ("The test of the hardware cut-off is not over.", "Wait."),
    "CUTOFF_TEST_FAILED": ("The hardware cut-off did not cut in its test.",
                           f"Check its wires. {DOCTOR}"),
}


def trip_words(name: str, stop_reason: str) -> Words:
    """Return message and remedy of a trip; ``stop_reason``: of the STOP, if that was the cause."""
    if name == "RUN_STOP" and stop_reason:
        return as_sentence(stop_reason), TRIP_WORDS[name][1]
    text, remedy = TRIP_WORDS.get(name) or TRIPS.get(name, (name, DOCTOR))
    return as_sentence(text), as_sentence(remedy)


def refusal_words(name: str, stop_reason: str) -> Words:
    """Return message and remedy of a refusal; ``stop_reason``: of the STOP that holds now."""
    if name == "RUN_STOP":
        text = as_sentence(stop_reason or "the car is stopped")
        return text, "Wait until that is over, then arm."
    known = BY_NAME[name]
    text, remedy = REFUSAL_WORDS.get(name, (known.text, known.remedy))
    return as_sentence(text), as_sentence(remedy)


def as_sentence(text: str) -> str:
    """Return the text with a capital at its start and a full stop at its end."""
    return text if not text else text[0].upper() + text[1:] + ("" if text.endswith(".") else ".")
