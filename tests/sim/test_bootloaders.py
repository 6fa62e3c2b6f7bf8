"""Between a reset of the Nano and its program: nothing, for as long as its bootloader waits."""

from __future__ import annotations

from itertools import pairwise

import pytest

from dart_hal.core.errors import UsageError
from dart_hal.devices.links.boot import STARTUP

NANOS = ["mock", pytest.param("avr", marks=pytest.mark.emulator)]
WAITS = [  # boot, cause, least and most silence on the line [s]
    ("none", "reset", 0.0, 0.03), ("none", "brownout", 0.0, 0.03),
    ("old", "reset", 1.32 + STARTUP, 1.37 + STARTUP),
    ("old", "brownout", 1.32 + STARTUP, 1.37 + STARTUP),
    ("optiboot", "reset", 1.0 + STARTUP, 1.03 + STARTUP),
    ("optiboot", "brownout", STARTUP, 0.03 + STARTUP),
    ("optiboot", "watchdog", STARTUP, 0.03 + STARTUP)]


def reset(raw_car, nano, boot, cause, more=""):
    car = raw_car(f"sim://?nano={nano}&boot={boot}{more}&fail=mcu:{cause}@2.003")
    return car.run(2.0)


@pytest.mark.parametrize("nano", NANOS)
@pytest.mark.parametrize(("boot", "cause", "least", "most"), WAITS)
@pytest.mark.slow_except("old*")
def test_the_line_is_silent_for_the_bootloaders_time(raw_car, nano, boot, cause, least, most):
    car = reset(raw_car, nano, boot, cause)
    before = car.stamps[-1]
    car.run(1.8)
    silence = max(b - a for a, b in pairwise([t for t in car.stamps if t >= before]))
    assert least < silence < most + 0.010  # a frame may have been due at the reset
    assert car.frames_named("HELLO")[-1].as_dict()["boot_count"] == 2


@pytest.mark.slow_except("mock")
@pytest.mark.parametrize("nano", NANOS)
def test_every_pin_is_released_meanwhile(raw_car, nano):
    car = reset(raw_car, nano, "optiboot", "reset", "&cutoff=mux")
    car.run(0.5)
    pins = car.world.nano.pins()
    assert (pins["D5"], pins["D6"], pins["D9"]) == (None, None, None)
    car.run(1.0)
    assert car.world.nano.pins()["D5"] == 0


@pytest.mark.slow
@pytest.mark.emulator
@pytest.mark.parametrize(("boot", "bootloader", "cause"), [("old", 1, 0x04), ("optiboot", 2, 0x02)])
def test_the_firmware_distinguishes_the_bootloaders(raw_car, boot, bootloader, cause):
    """Optiboot clears MCUSR: a brown-out then looks like any reset that keeps the RAM."""
    car = reset(raw_car, "avr", boot, "brownout").run(1.8)
    hello = car.frames_named("HELLO")[-1].as_dict()
    assert (hello["bootloader"], hello["reset_cause"]) == (bootloader, cause)


@pytest.mark.parametrize("nano", NANOS)
@pytest.mark.slow_except("mock")
def test_a_hardware_watchdog_under_the_old_bootloader_never_ends(raw_car, nano):
    """It leaves the watchdog on at 16 ms; Optiboot switches it off."""
    car = reset(raw_car, nano, "old", "watchdog")
    stamps_before = len(car.stamps)
    car.run(3.0)
    assert not [t for t in car.stamps[stamps_before:] if t > 2.02]


def test_a_bootloader_that_does_not_exist(raw_car):
    with pytest.raises(UsageError, match="boot"):
        raw_car("sim://?boot=grub")
