"""Wired cut-offs at the ESC pin: what a dead host leaves, with and without them."""

from __future__ import annotations

import contextlib

import pytest

from dart_hal.car import Car
from dart_hal.car.cutoff_test import CutoffTest
from dart_hal.core.errors import NotArmed, UsageError
from dart_hal.core.timing import PWM_FRAME
from dart_hal.devices.actuation.chain import WATCH_PULSE_US
from dart_hal.wire.codec import encode
from dart_hal.wire.messages import HEARTBEAT
from dart_lab.sim.cutoff import Multiplexer, make_wiring
from dart_lab.sim.pca9685 import Pca9685Model
from dart_lab.sim.truth import world_of

COUNT = 122 / 25e6


class Beating:
    """A car whose host sends heartbeats with each second frame while ``alive``."""

    def __init__(self, car):
        self.car, self.alive, self.mode, self.token, self.n = car, True, 0, 0, 0
        self.esc_pulses = []
        car.world.watchers.append(
            lambda channel, pulse: self.esc_pulses.append(pulse) if channel == 1 else None)

    def on_frame(self, frame):
        if frame.message.name == "HELLO":
            self.token = frame.as_dict()["boot_nonce"]
        if frame.message.name == "STATE" and self.alive:
            self.n += 1
            if self.n % 2 == 0:
                self.car.backend.link.write(
                    encode(HEARTBEAT, self.n, (1, 0, 0, self.token, self.mode, 0)))

    def run(self, seconds):
        self.car.run(seconds, self.on_frame)
        return self

    def drive(self):
        """Through neutral and arming to throttle 0.4."""
        self.car.pulses(1500, 1500)
        self.run(2.5)
        self.mode = 1
        self.run(1.0)
        self.car.pulses(1500, 1680)
        return self.run(2.0)

    def die(self):
        self.alive = False
        self.esc_pulses.clear()
        self.died = self.car.backend.clock.now()
        return self

    def widths(self, since=0.0):
        return {round((f - r) * 1e6, -1) for r, f in self.esc_pulses if r > self.died + since}


@pytest.mark.parametrize("cutoff", ["none", "oe", "mux"])
@pytest.mark.slow
def test_the_car_drives_with_every_cutoff(raw_car, cutoff):
    beating = Beating(raw_car(f"sim://?nano=mock&cutoff={cutoff}")).drive()
    assert beating.car.truth.v_x > 1.0
    assert round((beating.esc_pulses[-1][1] - beating.esc_pulses[-1][0]) * 1e6, -1) == 1680


@pytest.mark.slow
def test_without_a_cutoff_a_dead_host_keeps_its_throttle(raw_car):
    """The control: this is why the wires exist."""
    beating = Beating(raw_car("sim://?nano=mock&cutoff=none")).drive().die().run(1.0)
    assert beating.widths() == {1680}
    assert beating.car.truth.v_x > 2.0


@pytest.mark.slow
def test_multiplexer_leaves_a_valid_neutral_within_140_ms(raw_car):
    beating = Beating(raw_car("sim://?nano=mock&cutoff=mux")).drive().die().run(3.0)
    assert beating.widths(0.14) == {1500}
    assert beating.widths() == {1500, 1680}
    assert beating.car.truth.v_x < 0.3


@pytest.mark.slow
def test_output_enable_leaves_silence_within_140_ms(raw_car):
    beating = Beating(raw_car("sim://?nano=mock&cutoff=oe")).drive().die().run(2.0)
    assert beating.widths(0.14) == set()
    assert beating.car.world.esc.throttle == 0.0


def test_own_neutral_before_the_host_is_linked(raw_car):
    car = raw_car("sim://?nano=mock&cutoff=mux")
    beating = Beating(car).die()
    car.pulses(1500, 1900)
    beating.run(3.0)
    assert beating.widths() == {1500}
    assert car.truth.v_x == pytest.approx(0.0, abs=1e-6)


def test_silence_before_the_host_is_linked(raw_car):
    car = raw_car("sim://?nano=mock&cutoff=oe")
    beating = Beating(car).die()
    car.pulses(1500, 1900)
    beating.run(3.0)
    assert beating.widths() == set()


def test_an_undriven_gate_keeps_the_outputs_off():
    """A Nano in reset, without power or unplugged drives nothing."""
    pca = Pca9685Model()
    make_wiring("oe", pca)
    for data in (b"\x00\x31", b"\xfe\x79", b"\x00\x21", b"\xfa\x00\x00\x33\x01"):
        pca.write(data, [0.001] * len(data), 0.001)
    pca.output.advance(0.5)
    assert not pca.output.take(1)
    pca.set_oe(False, 0.5)
    pca.output.advance(1.0)
    assert pca.output.take(1)


def test_a_switch_inside_a_pulse_cuts_it():
    pca = Pca9685Model()
    mux = make_wiring("mux", pca)
    assert isinstance(mux, Multiplexer)
    mux.apply_pin_edges([(0.010, "D9", 1), (0.0105, "D5", 1), (0.0115, "D9", 0)])
    assert mux.esc_pulses(1, 0.1) == [(0.010, 0.0105)]


def is_whole(pulse):
    """Whether a pulse is neutral or that of the throttle of ``Beating.drive``."""
    return any(abs(1e6 * (pulse[1] - pulse[0]) - width) < 15.0 for width in (1500, 1680))


def find_cut_pulses(raw_car, nano, seed, watched):
    """Return the cut pulses at the ESC of a car with /OE whose host dies at any time of a frame."""
    beating = Beating(raw_car(f"sim://?nano={nano}&cutoff=oe&seed={seed}"))
    if watched:
        beating.car.spare_pulse(WATCH_PULSE_US)
    beating.drive().run(0.0023 * seed)
    beating.die().run(0.5)
    assert not [p for p in beating.esc_pulses if p[1] > beating.died + 0.145]
    return [p for p in beating.esc_pulses if not is_whole(p)]


@pytest.mark.parametrize(("nano", "seeds"), [("mock", 40), ("avr", 12)])
@pytest.mark.slow
def test_output_enable_cuts_no_pulse_when_beats_cease(raw_car, nano, seeds):
    """An ESC takes the rest of a pulse for a command, and holds it when no other follows."""
    assert not [seed for seed in range(seeds) if find_cut_pulses(raw_car, nano, seed, True)]


@pytest.mark.parametrize("nano", ["mock", "avr"])
@pytest.mark.slow
def test_output_enable_cuts_pulses_without_the_wire_to_d8(raw_car, nano):
    """The control: the wire is why no pulse is cut."""
    assert any(find_cut_pulses(raw_car, nano, seed, False) for seed in range(60))


def arm_often(nano, seed, wired):
    """Return the pulses at the ESC of a car with /OE that is armed eight times, before its end."""
    pulses = []
    with Car.open(f"sim://?seed={seed}&nano={nano}&cutoff=oe") as car:
        world = world_of(car._engine.backend)
        if not wired:
            world._capture_edges = list
        world.watchers.append(lambda channel, p: pulses.append(p) if channel == 1 else None)
        for _ in range(8):
            with contextlib.suppress(NotArmed):  # a cut pulse has moved the car
                for _ in car.arming():
                    pass
            car.stop()
            for _ in car.states(duration=0.3):
                pass
        assert len(pulses) > 100
        return list(pulses)


@pytest.mark.parametrize("wired", [True, False], ids=["D8 wired", "D8 open"])
@pytest.mark.parametrize(("nano", "seed"), [("mock", 2), ("mock", 6), ("mock", 10), ("avr", 6)])
@pytest.mark.slow
def test_arming_cuts_no_pulse(nano, seed, wired):
    """The self-test of the cut-off switches the outputs off and on at every arm()."""
    assert not [p for p in arm_often(nano, seed, wired) if not is_whole(p)]


@pytest.mark.parametrize("nano", ["mock", "avr"])
@pytest.mark.parametrize("silent", [True, False])
@pytest.mark.slow
def test_state_and_pin_agree_while_oe_is_tested(monkeypatch, nano, silent):
    """No pulse begins while States have PULSES_OFF; neutral pulses before and after."""
    if not silent:
        monkeypatch.setattr(CutoffTest, "silent", False)
    pulses = []
    off = []
    with Car.open(f"sim://?seed=2&nano={nano}&cutoff=oe") as car:
        world = world_of(car._engine.backend)
        world.watchers.append(lambda channel, p: pulses.append(p) if channel == 1 else None)
        for _ in car.states(duration=1.0):
            pass
        for state in car.arming():
            if "PULSES_OFF" in state.applied.limited:
                off.append(world.t)
    assert bool(off) == silent, "control: neutral is written meanwhile"
    if silent:
        rises = [rise for rise, _ in pulses]
        assert off[-1] - off[0] > 0.5
        # The PCA9685 takes new pulses over at its next frame.
        assert not [t for t in rises if off[0] + 2 * PWM_FRAME < t < off[-1]]
        assert [t for t in rises if t < off[0]]
        assert [t for t in rises if t > off[-1]]


@pytest.mark.slow
def test_without_silence_and_wire_arming_cuts_pulses(monkeypatch):
    """The control."""
    monkeypatch.setattr(CutoffTest, "silent", False)
    assert [p for p in arm_often("mock", 6, wired=False) if not is_whole(p)]


def test_unknown_cutoff_is_refused():
    with pytest.raises(UsageError):
        make_wiring("scissors", Pca9685Model())
