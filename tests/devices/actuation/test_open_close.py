"""Opening and closing on the register model: no pulse above neutral + 5 us."""

from __future__ import annotations

import subprocess
import sys
from itertools import pairwise

import pytest

from dart_hal.core.errors import BusError, PcaFault, PcaMissing
from dart_hal.devices.actuation.servokit import Shield, load_servokit
from tests.devices.actuation.pwm_world import World, car_files

NEUTRAL_US, SLACK_US, FRAME = 1500.0, 5.0, 0.02

STATES = {
    "power-on": lambda w: None,
    "stale 1649 us": lambda w: w.abandoned(),
    "stale, AI off": lambda w: w.abandoned(auto_increment=False),
    "asleep with RESTART pending": lambda w: w.abandoned(sleeping=True),
    "prescale 30": lambda w: w.abandoned(prescale=30),
    "prescale 255": lambda w: w.abandoned(prescale=255),
    "prescale 122": lambda w: w.abandoned(prescale=122),
    "after deinit()": lambda w: (w.abandoned(), w.write(0x00, 0x00)),
    "channels full on": lambda w: (w.abandoned(), w.write(0x0A, 0, 0x10, 0, 0)),
    "inverted outputs": lambda w: (w.abandoned(), w.write(0x01, 0x14)),
    "latch on ACK": lambda w: (w.abandoned(), w.write(0x01, 0x0C)),
    "a spare channel pulses": lambda w: (w.abandoned(), w.write(0x42, 0, 0, 0xFF, 0x01)),
}


def longest_esc_pulse_from(world: World, t: float) -> float:
    """Longest throttle pulse that begins after the frame under way at t [us]."""
    return max((length for rise, length in world.pulses(1) if rise > t + 1.1 * FRAME),
               default=0.0)


@pytest.mark.parametrize("update", ["next_frame", "now"])
@pytest.mark.parametrize("state", STATES)
def test_no_pulse_above_neutral_from_the_first_write_on(state: str, update: str) -> None:
    world = World(update=update)
    STATES[state](world)
    started = world.t
    actuator = world.actuator()
    actuator.open()
    world.run(actuator, 120)
    actuator.close()
    assert longest_esc_pulse_from(world, started) <= NEUTRAL_US + SLACK_US
    tail = world.pulses(1)[-100:]
    assert len(tail) == 100, "neutral pulses must come"
    assert all(abs(length - NEUTRAL_US) <= SLACK_US for _, length in tail)
    assert all(b[0] - a[0] < 1.001 * 0.019988 for a, b in pairwise(tail))


@pytest.mark.parametrize("state", ["stale 1649 us", "asleep with RESTART pending"])
def test_plain_servokit_brings_the_old_pulse_back(state: str) -> None:
    """The negative control: the sequence that upstream uses must fail the law above."""
    world = World()
    STATES[state](world)
    started = world.t
    shield = Shield(world.bus, 0x40, False, world.sleep)      # passes every write
    load_servokit()(channels=16, i2c=shield, address=0x40)
    world.t += 0.5
    assert longest_esc_pulse_from(world, started) > NEUTRAL_US + 100


def test_pulses_do_not_pause_when_the_prescale_is_right() -> None:
    world = World()
    world.abandoned()
    actuator = world.actuator()
    actuator.open()
    world.run(actuator, 10)
    rises = [rise for rise, _ in world.pulses(1)]
    assert max(b - a for a, b in pairwise(rises)) < 0.0201


@pytest.mark.parametrize("counts", [338, 2000])
@pytest.mark.parametrize("phase", [k / 20 for k in range(20)])
def test_no_pulse_is_cut_short_when_the_prescale_is_set(phase: float, counts: int) -> None:
    """ESCs can jump on a shortened pulse: the frame under way is waited for."""
    world = World()
    world.abandoned(prescale=122, pulse_counts=counts)
    world.t += phase * FRAME
    actuator = world.actuator()
    actuator.open()
    world.run(actuator, 5)
    stale, neutral = counts * 123 / 25, 307 * 122 / 25
    lengths = {round(length, 2) for _, length in world.pulses(1)}
    assert lengths == {round(stale, 2), round(neutral, 2)}


def test_mode_and_prescale_are_left_alone_when_they_are_right() -> None:
    world = World()
    world.abandoned()
    before = len(world.bus.log)
    world.actuator().open()
    written = [t.written for t in list(world.bus.log)[before:]]
    assert [w for w in written if len(w) == 2 and w[0] == 0xFE] == []
    assert [w for w in written if len(w) == 2 and w[0] == 0x00] == [bytes([0x00, 0x20])]


def test_spare_channels_are_switched_off() -> None:
    world = World()
    STATES["a spare channel pulses"](world)
    actuator = world.actuator()
    actuator.open()
    world.pulses(15)
    before = len(world.pulses(15))
    world.run(actuator, 20)
    assert len(world.pulses(15)) == before


def test_opening_writes_each_channel_and_a_repeat_is_written_again() -> None:
    world = World()
    world.abandoned()
    actuator = world.actuator()
    actuator.open()
    before = len(world.bus.log)
    world.run(actuator, 3)
    led = [t.written for t in list(world.bus.log)[before:] if len(t.written) == 9]
    assert len(led) == 3
    assert len(set(led)) == 1


def test_the_pulse_is_true_to_the_measured_oscillator() -> None:
    for hertz in (24.06e6, 25e6, 26.08e6, 27e6):
        world = World(oscillator_hz=hertz)
        actuator = world.actuator(car_files(hertz))
        actuator.open()
        world.run(actuator, 5)
        _, length = world.pulses(1)[-1]
        assert length == pytest.approx(actuator.applied.throttle_us, abs=1e-3)
        assert abs(length - NEUTRAL_US) <= SLACK_US


def test_an_unmeasured_oscillator_moves_neutral_as_reported_from_the_field() -> None:
    """24.06, 26.08, 27.0 MHz: +58.5, -62.0, -111 us. This is why arm() requires it."""
    moved = []
    for hertz in (24.06e6, 26.08e6, 27e6):
        world = World(oscillator_hz=hertz)
        actuator = world.actuator(car_files(None))
        actuator.open()
        world.run(actuator, 5)
        moved.append(world.pulses(1)[-1][1] - 1498.16)
    assert moved == pytest.approx([58.5, -62.0, -111.0], abs=0.6)


def test_a_missing_chip_is_named_with_what_answers_instead() -> None:
    world = World()
    world.bus.devices = []
    with pytest.raises(PcaMissing, match="no PCA9685 at 0x40") as caught:
        world.actuator().open()
    assert caught.value.found == "no device at all"
    world.bus.devices = [type(world.chip)(address=a) for a in (0x28, 0x29, 0x41)]
    with pytest.raises(PcaMissing) as caught:
        world.actuator().open()
    assert "0x28 (BNO055?), 0x29 (BNO055?)" in caught.value.found
    assert "0x41" in caught.value.found
    assert "0x70 (PCA9685 all-call at its default)" in caught.value.found


@pytest.mark.parametrize("nacks", [1, 2])
def test_a_single_missing_acknowledge_is_retried(nacks: int) -> None:
    world = World()
    world.bus.nack = nacks
    actuator = world.actuator()
    actuator.open()
    assert actuator.pca.retries == nacks


def test_a_stuck_line_is_a_bus_error_that_explains_itself() -> None:
    world = World()
    world.bus.stuck = "sda"
    with pytest.raises(BusError, match="did not become free") as caught:
        world.actuator().open()
    assert "stays low" in caught.value.likely


def test_an_external_clock_is_refused() -> None:
    world = World()
    world.write(0x00, 0x51)
    with pytest.raises(PcaFault, match="external clock"):
        world.actuator().open()


def test_channels_that_are_not_neighbours_are_driven_too() -> None:
    import msgspec

    files = car_files()
    throttle = msgspec.structs.replace(files.config.throttle, channel=5)
    config = msgspec.structs.replace(files.config, throttle=throttle)
    world = World()
    actuator = world.actuator(type(files)(config, files.calibration, None, files.folder, "x"))
    actuator.open()
    world.run(actuator, 5)
    assert world.pulses(5)[-1][1] == pytest.approx(1498.16, abs=0.01)
    assert world.pulses(1) == []


def test_importing_opens_nothing_and_loads_neither_servokit_nor_scipy() -> None:
    code = ("import sys, dart_hal, dart_hal.core.config, dart_hal.devices.actuation\n"
            "heavy = {'adafruit_servokit', 'board', 'busio', 'scipy', 'smbus2', 'matplotlib'}\n"
            "print(sorted(heavy & set(sys.modules)))")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True,
                          check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.slow
def test_a_host_without_board_still_gets_servokit() -> None:
    code = ("import sys, types\n"
            "class Refuse:\n"
            "    def find_spec(self, name, path=None, target=None):\n"
            "        if name == 'board':\n"
            "            raise NotImplementedError('unknown host')\n"
            "sys.meta_path.insert(0, Refuse())\n"
            "from dart_hal.devices.actuation.servokit import load_servokit\n"
            "print(load_servokit().__name__, 'board' in sys.modules)")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True,
                          check=True)
    assert done.stdout.strip() == "ServoKit False"
