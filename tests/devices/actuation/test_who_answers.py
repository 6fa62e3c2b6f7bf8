"""The device at 0x40 is identified before any write; other programs that write are found."""

from __future__ import annotations

import random

import pytest

from dart_hal.core.errors import CATALOGUE, NotPca, PcaFault
from dart_hal.devices.actuation.standby import Throttle
from tests.devices.actuation.pwm_world import World, car_files
from tests.power_monitor import PowerMonitor

MONITORS = {
    "INA3221": None,
    "INA219": {0: 0x399F, 1: 0x0012, 2: 0x9D62, 3: 0x0021, 4: 0x0010, 5: 0x1000},
    "INA219 at rest": {0: 0x399F, 2: 0x0002},
    "INA226": {0: 0x4127, 1: 0x0FFE, 2: 0x2570, 5: 0x0800, 6: 0, 7: 0, 0xFE: 0x5449, 0xFF: 0x2260},
    "all zero": {},
    "all ones": dict.fromkeys(range(256), 0xFFFF),
    "one number": dict.fromkeys(range(256), 0x1010),
    "even bytes": {k: 0x0206 * k & 0x1E1E for k in range(256)},
}


@pytest.mark.parametrize("kind", MONITORS)
def test_a_power_monitor_is_refused_and_gets_no_write(kind: str) -> None:
    world = World()
    monitor = PowerMonitor(registers=MONITORS[kind])
    world.bus.devices = [monitor]
    with pytest.raises(NotPca, match=r"0x40 .* is no PCA9685") as caught:
        world.actuator().open()
    assert monitor.stored == []
    assert all(len(t.written) <= 1 for t in world.bus.log), "a pointer, and nothing behind it"
    assert "nothing was written" in caught.value.found
    assert "i2c=7 on an Orin Nano" in caught.value.remedy
    assert caught.value.code in CATALOGUE
    if kind in ("INA3221", "INA226"):
        assert "power monitor of Texas Instruments" in caught.value.found


def test_without_the_look_the_monitor_is_written_to(monkeypatch: pytest.MonkeyPatch) -> None:
    """The negative control: what the look keeps away."""
    world = World()
    monitor = PowerMonitor(registers=MONITORS["INA219"])
    world.bus.devices = [monitor]
    actuator = world.actuator()
    monkeypatch.setattr(actuator.pca, "_recognise", lambda *_: None)
    with pytest.raises(PcaFault):
        actuator.open()
    assert monitor.stored


def test_stop_and_standby_leave_a_monitor_alone() -> None:
    world = World()
    monitor = PowerMonitor()
    world.bus.devices = [monitor]
    throttle = Throttle(car_files(), world.bus, world.sleep)
    with pytest.raises(NotPca):
        throttle.rest()
    assert monitor.stored == []


@pytest.mark.parametrize("seed", range(40))
def test_a_pca9685_is_recognised_in_any_state_of_a_dead_program(seed: int) -> None:
    """Random writes to every register, other sub-addresses included; only its number stays."""
    world = World()
    draw = random.Random(seed)
    for _ in range(draw.randrange(30)):
        register = draw.choice([0, 1, 2, 3, 4, 5, *range(6, 0x46), 0xFA, 0xFB, 0xFC, 0xFD, 0xFE])
        value = draw.randrange(256) & (0x3F if register == 0 else 0xFF)    # no external clock
        world.write(register, value)
    actuator = world.actuator()
    actuator.open()
    world.run(actuator, 30)
    assert [round(length) for _, length in world.pulses(1)[-20:]] == [1498] * 20


def drive(world: World):
    actuator = world.actuator()
    actuator.open()
    world.run(actuator, 60)
    assert actuator.trips() == ()
    return actuator


@pytest.mark.parametrize(("register", "counts"), [(0x0A, 338), (0x06, 300), (0x0A, 0x1000)])
def test_a_second_writer_is_found_within_a_second(register: int, counts: int) -> None:
    """It writes as often as we do; our own write each frame would hide it from a later look."""
    world = World()
    actuator = drive(world)
    begin, found = world.t, None
    while found is None and world.t < begin + 2.0:
        world.bus.writeto(0x40, bytes([register, 0, 0, counts & 0xFF, counts >> 8]))
        world.run(actuator, 1)
        found = world.t if "PCA_READBACK" in actuator.trips() else None
    assert found is not None
    assert found - begin <= 1.1
    world.run(actuator, 3)
    assert actuator.fault is None, "it is brought up again, at neutral"
    assert round(world.pulses(1)[-1][1]) == 1498


def test_the_second_writer_is_named() -> None:
    world = World()
    actuator = drive(world)
    world.bus.writeto(0x40, bytes([0x0A, 0, 0, 338 & 0xFF, 338 >> 8]))
    with pytest.raises(PcaFault, match="another program writes") as caught:
        actuator.pca.check()
    assert "channel 1" in caught.value.found
    assert "1649 us" in caught.value.found
    assert "1498 us" in caught.value.expected
    assert "fuser" in caught.value.remedy


def test_a_read_back_without_the_pulses_does_not_see_it() -> None:
    """The negative control, also while the registers contain the neutral of the guard."""
    world = World()
    actuator = drive(world)
    world.bus.writeto(0x40, bytes([0x0A, 0, 0, 338 & 0xFF, 338 >> 8]))
    actuator.pca.check(pulses=False)


def test_no_throttle_is_written_after_another_writer_was_found() -> None:
    """The frame that finds it was planned with throttle on; that plan must not be written."""
    from dart_hal.devices.actuation import LIVE_DEMAND

    world = World()
    actuator = drive(world)
    actuator.demand = lambda: LIVE_DEMAND
    while True:
        world.bus.writeto(0x40, bytes([0x06, 0, 0, 0x2C, 0x01]))
        actuator.command(0.0, 0.4, 0.2, "user", world.t)
        before = len(world.bus.log)
        actuator.frame(world.t)
        if "PCA_READBACK" in actuator.trips():
            break
        world.t += 0.02
    written = [t.written for t in list(world.bus.log)[before:] if t.written[:1] in (b"\6", b"\n")]
    throttles = {data[-1] << 8 | data[-2] for data in written if len(data) in (5, 9)}
    assert throttles <= {307, 0x1000}
