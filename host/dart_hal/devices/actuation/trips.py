"""Messages for the trips of an armed car: raised when commands follow after it was disarmed."""

from __future__ import annotations

from collections.abc import Iterable

from dart_hal.core.errors import Disarmed

# By cause: what happened, and what to do. CAR_MOVES is missing: it only ends RAW.
TRIPS: dict[str, tuple[str, str]] = {
    "COMMAND_EXPIRED": ("no new command came while the last one was valid",
                        "make the loop faster (car.timing), or drive(valid_for=0.5)"),
    "COMMAND_INVALID": ("a command was not a finite number, or otherwise invalid",
                        "check the controller's output before drive()"),
    "TIME_BACKWARD": ("the computer's clock went back", "report it with the recording"),
    "LINK_STALE": ("no frame came from the Nano", "check its cable and power; dart-hal doctor"),
    "MCU_REBOOTED": ("the Nano booted again", "check its power; dart-hal doctor"),
    "PCA_WRITE_FAILED": ("a write to the PCA9685 failed", "check the I2C bus; dart-hal doctor"),
    "PCA_READBACK": ("the registers of the PCA9685 differ from what was written",
                     "check its supply, end other programs on the bus; dart-hal doctor"),
    "GUARD_TRIPPED": ("the guard process had written neutral: this program did not run for 0.1 s",
                      "close other programs; do not stop the process while it drives"),
    "GUARD_SILENT": ("the guard process does not answer", "close other programs; open it again"),
    "SUSPENDED": ("the computer was suspended while the car was armed",
                  "let it never sleep: host/setup/setup.sh masks sleep; or sudo systemctl mask "
                  "sleep.target suspend.target hibernate.target hybrid-sleep.target"),
    "CUT_OFF": ("the hardware cut-off does not pass the pulses on",
                "check the Nano and its wiring; dart-hal doctor"),
    "MOVES_AT_NEUTRAL": ("the wheels turned faster while the throttle was neutral; servo and ESC "
                         "get no pulse since then",
                         "was it pushed, or does it roll? else check the marks of the encoder "
                         "ring, [throttle] neutral_us, [pwm] oscillator_hz and the channels in "
                         "the car's files"),
    "AGAINST_THROTTLE": ("the car sped up against its throttle",
                         "push the car forward by hand: accel_x must be positive, else mount_yaw = "
                         "3.1416 under [imu] in car.toml. If it is, the motor's leads are swapped"),
    "RC_LOST": ("the signal of the RC transmitter was lost while its driver drove",
                "check its battery, its range and the wires of the receiver"),
    "RC_OVERRIDE": ("the driver of the RC transmitter took over during a calibration",
                    "leave its sticks and its switch alone"),
    "RUN_STOP": ("the run-stop was pressed", "arm when the way is free"),
}


def describe_trips(causes: Iterable[str], stop_reason: str = "") -> str:
    """Return a line per cause of a trip, with what happened; stop_reason: text of a RUN_STOP."""
    texts = {name: text for name, (text, _) in TRIPS.items()}
    if stop_reason:
        texts["RUN_STOP"] = stop_reason
    return "\n".join(f"{name}: {texts[name]}" if name in texts else name for name in causes)


def list_remedies(causes: Iterable[str]) -> list[str]:
    """Return what to do about each cause of a trip."""
    return [TRIPS[name][1] for name in causes if name in TRIPS]


def disarmed_error(causes: Iterable[str], stop_reason: str = "") -> Disarmed:
    """Return the error for a command after a trip; stop_reason: text of a RUN_STOP."""
    names = tuple(causes)
    return Disarmed("the car was disarmed by a trip and the program goes on commanding it",
                    causes=names, found=describe_trips(names, stop_reason),
                    remedy="\n".join([*list_remedies(names), "then car.arm() again"]))
