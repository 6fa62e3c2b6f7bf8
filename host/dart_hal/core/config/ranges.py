"""Valid ranges of the two numbers that define the neutral pulse.

Every layer that stops the car by a neutral pulse computes it from the neutral [us] and the
oscillator [Hz] of the car's files. One wrong digit in either of them would make each of these
layers drive the car. A value outside of these ranges is therefore an error when it is read.
"""

from __future__ import annotations

from dart_hal.core.config.parse import require
from dart_hal.core.config.quantity import Quantity

# Hz. The data sheet gives 25 MHz; boards between 23 and 27 MHz were reported.
OSCILLATOR_HZ = (22e6, 28e6)
# Relative standard error of a measured oscillator: 7.5 us of a pulse of 1500 us.
MAX_CLOCK_STD = 0.005
# us. ESCs are built for 1500 us; trimming moves that by some 10 us.
NEUTRAL_US = (1400.0, 1600.0)
# us by which a measured neutral may differ from the one that car.toml marks as deliberate: the dead
# band of an ESC is about 25 us to either side.
DELIBERATE_WITHIN_US = 30.0


def check_oscillator(clock: Quantity | None, origin: str) -> None:
    """Raise ConfigError unless the oscillator is in range and its standard error small enough."""
    if clock is None:
        return
    low, high = OSCILLATOR_HZ
    require(low <= clock.value <= high, origin, "pwm.oscillator_hz.value", f"{clock.value:.0f} Hz",
            f"{low / 1e6:g} to {high / 1e6:g} MHz (nominal 25 MHz)",
            "measure it again (hardware/README.md, section PWM clock), or remove the key")
    require(clock.std <= MAX_CLOCK_STD * clock.value, origin, "pwm.oscillator_hz.std",
            f"{clock.std:.0f} Hz, {clock.std / clock.value:.1%} of the value",
            f"at most {MAX_CLOCK_STD:.1%} of the value",
            "measure it again (hardware/README.md, section PWM clock), or remove the key")


def check_neutral(pulse_us: float, deliberate_us: float | None, origin: str, key: str) -> None:
    """Raise ConfigError unless the neutral is usual, or the one that car.toml marks."""
    low, high = NEUTRAL_US
    usual = low <= pulse_us <= high
    marked = deliberate_us is not None and abs(pulse_us - deliberate_us) <= DELIBERATE_WITHIN_US
    expected = f"{low:.0f} to {high:.0f} us"
    if deliberate_us is not None:
        expected += f", or within {DELIBERATE_WITHIN_US:.0f} us of [throttle] " \
                    f"deliberate_neutral_us = {deliberate_us:g} in car.toml"
    require(usual or marked, origin, key, f"{pulse_us:g} us", expected,
            f"correct {key}; if the ESC really rests there: [throttle] deliberate_neutral_us = "
            f"{pulse_us:g} in car.toml")
