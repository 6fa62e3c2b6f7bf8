"""Wired cut-offs at the ESC pin: what a dead host leaves, with and without them."""

from __future__ import annotations

import pytest

from dart_hal.core.errors import UsageError
from dart_hal.wire.codec import encode
from dart_hal.wire.messages import HEARTBEAT
from dart_lab.sim.cutoff import Multiplexer, make_wiring
from dart_lab.sim.pca9685 import Pca9685Model

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


def test_unknown_cutoff_is_refused():
    with pytest.raises(UsageError):
        make_wiring("scissors", Pca9685Model())
