"""The PCA9685 answers only its own address, from any state."""

from __future__ import annotations

import pytest

from dart_hal.core.errors import PcaFault
from dart_hal.devices.actuation import pca9685
from dart_hal.devices.actuation.guard import watch
from dart_hal.devices.actuation.standby import Throttle
from tests.devices.actuation.pwm_world import World, car_files

FOREIGN = bytes([0x0A, 0, 0, 0x9A, 0x01])
"""Data for another chip that would be 2001 us on the ESC: channel 1, 410 counts."""
ADDRESSES = range(0x08, 0x78)
OTHERS = bytes([0xA2, 0xC4, 0xE6, 0xD8])
"""Further addresses that another program has set."""
CLOCK_BIT = 0x40


def found(mode1: int, addresses: bytes = b"", mode2: int = 0x04) -> World:
    """A chip that another program has left at neutral pulses with these registers."""
    world = World()
    world.abandoned(pulse_counts=307)
    for register, value in enumerate(addresses, 0x02):
        world.write(register, value)
    world.write(0x01, mode2)
    world.write(0x00, mode1)
    return world


def talk_to_others(world: World) -> None:
    """Somebody writes to every other address of the bus."""
    for address in ADDRESSES:
        if address != 0x40:
            try:
                world.bus.writeto(address, FOREIGN)
            except OSError:
                continue
            world.t += 0.01


def longest(world: World, since: float) -> float:
    return max((length for rise, length in world.pulses(1) if rise > since), default=0.0)


def pulse_after_foreign_data(world: World) -> float:
    """Longest pulse [us] at the ESC after data for all other chips on the bus."""
    since = world.t
    talk_to_others(world)
    world.t += 0.1
    return longest(world, since)


SOME = (*range(0, 256, 9), 0xA1, 0x28, 0x24, 0x22, 0x3F)


@pytest.mark.parametrize(("addresses", "modes"), [
    (OTHERS, SOME), pytest.param(b"", range(256), marks=pytest.mark.slow),
    pytest.param(OTHERS, range(256), marks=pytest.mark.slow)], ids=["some", "all", "all, changed"])
def test_every_found_mode_is_opened_to_the_own_address_alone(addresses, modes):
    for mode1 in modes:
        if mode1 & CLOCK_BIT and mode1 & 0x10:
            continue                              # an external clock is refused, and stays
        world = found(mode1, addresses)
        world.actuator().open()
        assert world.chip.peek(0x00) == 0x20, f"found {mode1:#04x}"
        assert bytes(map(world.chip.peek, range(2, 6))) == pca9685.FURTHER_ADDRESSES
        assert world.bus.scan() == [0x40]
        assert pulse_after_foreign_data(world) < 1505.0


@pytest.mark.parametrize("mode1", [0xA1, 0x28, 0x24, 0x22, 0x2F])
def test_control_without_the_mask_foreign_data_reach_the_esc(monkeypatch, mode1):
    monkeypatch.setattr(pca9685, "ALIASES", 0)
    world = found(mode1)
    world.actuator().open()
    assert pulse_after_foreign_data(world) > 1900.0


@pytest.mark.parametrize("mode2", range(32))
def test_every_found_mode2_becomes_ours(mode2):
    world = found(0x20, mode2=mode2)
    world.actuator().open()
    assert world.chip.peek(0x01) == 0x04


@pytest.mark.parametrize(("register", "value"), [
    (0x00, 0x21), (0x00, 0xA1), (0x00, 0x28), (0x00, 0x24), (0x00, 0x22), (0x02, 0xA0),
    (0x03, 0xA0), (0x04, 0xA0), (0x05, 0xA0), (0x01, 0x14), (0x01, 0x05)])
def test_a_change_while_it_runs_is_found_within_a_second_and_put_right(register, value):
    world = World()
    actuator = world.actuator()
    actuator.open()
    world.run(actuator, 60)
    assert actuator.trips() == ()
    world.write(register, value)
    world.run(actuator, 52)
    assert actuator.trips() == ("PCA_READBACK",)
    assert world.chip.peek(0x00) == 0x20
    assert bytes(map(world.chip.peek, range(2, 6))) == pca9685.FURTHER_ADDRESSES
    assert world.chip.peek(0x01) == 0x04


def test_the_fault_names_the_registers():
    world = World()
    actuator = world.actuator()
    actuator.open()
    world.write(0x00, 0x29)
    with pytest.raises(PcaFault, match="lost its settings") as caught:
        actuator.pca.check()
    assert "MODE1 0x29" in caught.value.found
    assert "MODE1 0x20" in caught.value.expected


@pytest.mark.parametrize("mode1", [0xA1, 0x2F, 0x01, 0x1F])
def test_standby_and_stop_end_the_further_addresses_too(mode1):
    world = found(mode1, OTHERS)
    throttle = Throttle(car_files(), world.bus, world.sleep)
    throttle.rest()
    assert world.chip.peek(0x00) & 0x0F == 0
    assert world.chip.peek(0x00) & 0x10 == mode1 & 0x10, "it is not woken"
    throttle.switch_off()
    assert pulse_after_foreign_data(world) == 0.0


def test_the_guard_ends_them_too():
    """Another program has switched all-call on while the driver drove."""
    import os

    world = found(0x21)
    beats, status = os.pipe(), os.pipe()
    os.close(beats[1])

    def clock() -> float:
        world.t += 0.01
        return world.t

    watch(world.bus, 0x40, 1, 307, beats=beats[0], status=status[1], clock=clock)
    for fd in (beats[0], *status):
        os.close(fd)
    assert world.chip.peek(0x00) == 0x20
    assert pulse_after_foreign_data(world) == 0.0
