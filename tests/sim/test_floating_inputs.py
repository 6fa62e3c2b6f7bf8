"""Cut-offs whose Nano drives nothing: unplugged, in a bootloader; and wirings that fail then."""

from __future__ import annotations

import pytest

from dart_hal.wire.codec import encode
from dart_hal.wire.messages import HEARTBEAT
from dart_lab.sim.cutoff import INPUT_FILTER, EscInput, make_wiring
from dart_lab.sim.levels import divider_voltage, logic_level
from dart_lab.sim.mock_capture import MockCapture
from dart_lab.sim.pca9685 import Pca9685Model

AT = 5.5
"""s; the car is at throttle."""
LIMIT = 0.040
"""s from the fault to the last pulse above neutral."""
NEUTRAL = 1505e-6
"""s, neutral and its 5 us."""


class Driver:
    """Neutral, beats, full ahead: and goes on beating and writing in any case."""

    def __init__(self, car):
        self.car, self.token, self.n, self.pulses = car, 0, 0, []
        car.world.watchers.append(
            lambda channel, pulse: self.pulses.append(pulse) if channel == 1 else None)
        car.pulses(1500, 1500)
        self.run(3.5)
        car.pulses(1500, 1700)
        self.run(AT - 3.5)

    def on_frame(self, frame):
        if frame.message.name == "HELLO":
            self.token = frame.as_dict()["boot_nonce"]
        if frame.message.name == "STATE":
            self.n += 1
            mode = int(self.car.backend.clock.now() > 2.8)
            self.car.backend.link.write(encode(HEARTBEAT, self.n, (1, 0, 0, self.token, mode, 0)))

    def run(self, seconds):
        self.car.run(seconds, self.on_frame)
        return self

    def throttle(self, begin, end):
        return [p for p in self.pulses if begin < p[1] < end and p[1] - p[0] > NEUTRAL]


def live_after(raw_car, options, fault, seconds):
    """Pulses above neutral from the limit on until the Nano could be back."""
    driver = Driver(raw_car(f"sim://?{options}&fail={fault}@{AT}"))
    assert len(driver.throttle(AT - 0.5, AT)) > 15
    driver.run(seconds)
    return driver.throttle(AT + LIMIT, AT + seconds)


GOOD = [("mock", "mux"), ("mock", "oe"), ("mock", "mux-no-ground"),
        pytest.param("avr", "mux", marks=pytest.mark.emulator),
        pytest.param("avr", "oe", marks=pytest.mark.emulator)]


@pytest.mark.parametrize(("nano", "cutoff"), GOOD)
@pytest.mark.slow
def test_unplugging_the_nano_stops_the_car(raw_car, nano, cutoff):
    assert not live_after(raw_car, f"nano={nano}&cutoff={cutoff}", "power:nano", 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("cutoff", ["mux-floating", "oe-weak", "none"])
def test_controls_of_unplugging(raw_car, cutoff):
    """Without pull-down and ground, with a pull-up that is too weak, without a cut-off."""
    assert live_after(raw_car, f"nano=mock&cutoff={cutoff}", "power:nano", 1.0)


@pytest.mark.parametrize(("nano", "cutoff"), GOOD)
@pytest.mark.parametrize("boot", ["old", "optiboot"])
@pytest.mark.slow
def test_a_bootloader_passes_nothing(raw_car, nano, cutoff, boot):
    options = f"nano={nano}&cutoff={cutoff}&boot={boot}"
    assert not live_after(raw_car, options, "mcu:reset", 0.9)


@pytest.mark.slow
@pytest.mark.parametrize("cutoff", ["mux-floating", "mux-grounded", "oe-weak"])
def test_controls_of_a_bootloader(raw_car, cutoff):
    """A powered Nano clamps nothing: here the ground wire alone does not help."""
    assert live_after(raw_car, f"nano=mock&cutoff={cutoff}&boot=optiboot", "mcu:reset", 0.9)


@pytest.mark.slow
def test_a_ground_wire_holds_the_pins_of_a_dead_nano(raw_car):
    assert not live_after(raw_car, "nano=mock&cutoff=mux-grounded", "power:nano", 1.0)


def test_users_are_offered_the_good_ones(raw_car):
    with pytest.raises(Exception, match="cutoff") as caught:
        raw_car("sim://?cutoff=axe")
    assert "floating" not in str(caught.value.expected)


# --- levels


@pytest.mark.parametrize(("up", "down", "level"), [
    (1e3, None, True), (1e3, 10e3, True), (10e3, None, True), (10e3, 10e3, None)])
def test_two_pulls_meet(up, down, level):
    """10 k against a board's own 10 k: 1.65 V, neither low nor high."""
    assert logic_level(divider_voltage(3.3, up, down)) is level


# Absolute maximum of the current into an input clamp of 74HC and 74HCT parts [A].
CLAMP_MAX = 0.020


def clamp_current(volt, series):
    """Current [A] from a pin of the ATmega328P over ``series`` ohm into a chip at 0 V.

    The clamp diode takes 0.6 V, the pin has 25 ohm (0.5 V at 20 mA).
    """
    return max(0.0, volt - 0.6) / (series + 25.0)


def test_series_resistors_keep_a_chip_without_supply_alive():
    assert clamp_current(5.0, 1e3) < CLAMP_MAX / 4
    assert clamp_current(5.0, 4.7e3) < 1e-3
    assert clamp_current(5.0, 0.0) > CLAMP_MAX  # the control: without them
    assert logic_level(5.0 * 10e3 / (10e3 + 1e3)) is True  # and the levels still hold


# --- gaps and stubs


def pulses(*levels):
    esc = EscInput()
    for t, high in levels:
        esc.set_level(t, high)
    return esc.take(1.0)


def test_a_gap_that_the_input_does_not_see_joins():
    joined = pulses((0.0, True), (1.5e-3, False), (1.5e-3 + 3.3e-6, True), (2.9e-3, False))
    assert joined == [(0.0, 2.9e-3)]


def test_a_real_gap_separates_and_a_real_stub_stays():
    t = 1.5e-3 + 2 * INPUT_FILTER
    found = pulses((0.0, True), (1.5e-3, False), (t, True), (t + 91e-6, False))
    assert found == [(0.0, 1.5e-3), (t, t + 91e-6)]


def test_a_spike_is_no_pulse():
    assert pulses((0.0, True), (1e-6, False), (0.1, True), (0.1015, False)) == [(0.1, 0.1015)]


def test_the_switch_of_the_select_inside_a_board_pulse_joins():
    """D9 falls, 3.3 us later the select takes a board pulse that is under way."""
    pca = Pca9685Model()
    for data in (b"\x00\x31", b"\xfe\x79", b"\x00\x21", b"\x0a\x00\x00\x33\x01"):
        pca.write(data, [0.001] * len(data), 0.001)
    pca.output.advance(0.1)
    mux = make_wiring("mux", pca)
    rise, fall = pca.output.take(1)[-1]
    own_fall = rise + 0.5e-3
    pca.output._done[1] = [(rise, fall)]
    mux.apply_pin_edges(
        [(own_fall - 1.5e-3, "D9", 1), (own_fall, "D9", 0), (own_fall + 3.3e-6, "D5", 1)])
    assert mux.esc_pulses(1, 0.2) == [(own_fall - 1.5e-3, fall)]


# --- the capture wire behind the cut-off


@pytest.mark.slow
@pytest.mark.parametrize(("cutoff", "linked"), [("none", True), ("oe", True), ("mux", False)])
def test_the_spare_channel_reaches_d8_as_the_esc_gets_its_pulse(raw_car, cutoff, linked,
                                                                monkeypatch):
    car = raw_car(f"sim://?nano=mock&cutoff={cutoff}")
    edges = []
    edge = MockCapture.edge
    monkeypatch.setattr(MockCapture, "edge", lambda self, on, ck: (
        edges.append((car.world.t, on)), edge(self, on, ck)))
    for data in (b"\x42\x00\x00\x33\x01",):
        car.backend.bus.writeto(0x40, data)
    driver = Driver(car)

    def rises(begin, end):
        return sum(begin < t < end and on for t, on in edges)

    per_second = 50
    assert (rises(0.1, 0.5) > 0) is (cutoff == "none")  # IDLE
    assert (rises(1.5, 2.7) > per_second) is linked     # LINKED
    assert rises(3.0, 5.0) == pytest.approx(2 * per_second, abs=2)  # LIVE
    car.world.power_nano(False)
    driver.run(0.5)
    assert (rises(AT + 0.01, AT + 0.5) > 0) is (cutoff == "none")
