"""What trips an armed car, in words: for whoever goes on commanding one that was disarmed."""

from __future__ import annotations

from collections.abc import Iterable

from dart_hal.core.errors import Disarmed

TRIPS: dict[str, tuple[str, str]] = {
    "COMMAND_EXPIRED": ("no new command came while the last one was valid",
                        "make the loop faster (car.timing), or drive(valid_for=0.5)"),
    "COMMAND_INVALID": ("a command was no number, or the wrong one",
                        "check the controller's output before drive()"),
    "TIME_BACKWARD": ("the computer's clock went back", "report it with the recording"),
    "LINK_STALE": ("no frame came from the Nano", "check its cable and power; dart-hal doctor"),
    "MCU_REBOOTED": ("the Nano booted again", "check its power; dart-hal doctor"),
    "PCA_WRITE_FAILED": ("the PCA9685 did not take a pulse", "check the I2C bus; dart-hal doctor"),
    "PCA_READBACK": ("the PCA9685 did not hold what was written",
                     "check its supply, end other programs on the bus; dart-hal doctor"),
    "GUARD_TRIPPED": ("the guard process had written neutral: this program stood still",
                      "close other programs; do not stop the process while it drives"),
    "GUARD_SILENT": ("the guard process does not answer", "close other programs; open it again"),
    "SUSPENDED": ("the computer was suspended while the car was armed",
                  "let it never sleep: host/setup/setup.sh masks sleep; or sudo systemctl mask "
                  "sleep.target suspend.target hibernate.target hybrid-sleep.target"),
    "CUT_OFF": ("the hardware cut-off does not pass the pulses on",
                "check the Nano and its wiring; dart-hal doctor"),
    "MOVES_AT_NEUTRAL": ("the wheels turned faster while the throttle was neutral; servo and ESC "
                         "get no pulse since then",
                         "was it pushed, or does it roll? else check [throttle] neutral_us, [pwm] "
                         "oscillator_hz and the channels in the car's files"),
    "RUN_STOP": ("the run-stop was pressed", "arm when the way is free"),
}
"""Cause: what happened, and what to do. CAR_MOVES ends RAW alone."""


def disarmed(causes: Iterable[str], stop_reason: str = "") -> Disarmed:
    """The error that says by what an armed car was disarmed; stop_reason: of a RUN_STOP."""
    names = tuple(causes)
    known = [TRIPS[name] for name in names if name in TRIPS]
    texts = {name: text for name, (text, _) in TRIPS.items()}
    if stop_reason:
        texts["RUN_STOP"] = stop_reason
    found = "\n".join(f"{name}: {texts[name]}" if name in texts else name for name in names)
    cure = "\n".join([*(remedy for _, remedy in known), "then car.arm() again"])
    return Disarmed("the car was disarmed by a trip and the program goes on commanding it",
                    causes=names, found=found, remedy=cure)
