"""A neutral that is none: the pulses end, by the wheel speed alone. Judged at the ESC's pin."""

from __future__ import annotations

import re
from dataclasses import dataclass

import pytest

from dart_hal.car import Car
from dart_hal.core.errors import Disarmed, NotArmed
from dart_hal.devices.actuation.neutral_watch import NeutralWatch
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.esc import Esc, EscMode
from dart_lab.sim.failures import parse_failure, schedule_failures
from dart_lab.sim.truth import world_of
from tests.common import WAIVED_GATES

CLOCK_EDIT = (r"oscillator_hz = \{[^}]*\}", "oscillator_hz = {{ value = {}, std = 1000 }}")
CHANGED_NEUTRAL = (r"neutral_us = 1500.0", "neutral_us = {0}\ndeliberate_neutral_us = {0}")
SWAPPED = ((r"(?<=\[steering\]\n)channel = 0", "channel = 1"),
           (r"(?<=\[throttle\]\n)channel = 1", "channel = 0"))
DRIVES_US = 60.0
"""us from the ESC's own neutral: beyond every dead band of the simulated cars."""


@dataclass
class Outcome:
    """driven [s]: from the first driving pulse at the ESC to the last; distance [m] until then.

    After it the ESC holds its throttle for as long as it takes to believe that the signal is lost.
    """

    driven: float
    distance: float
    whole: float
    speed: float
    mode: str
    causes: tuple[str, ...]
    ended: bool


class ReadyEsc(Esc):
    """An ESC that an earlier program has armed, and that obeys again after a loss of the signal."""

    def pulse(self, pulse):
        if self.mode is EscMode.UNARMED:
            self.mode = EscMode.READY
        super().pulse(pulse)


class NeutralBench:
    """A simulated car with edited files, its ESC armed by an earlier program or fresh."""

    def __init__(self, tmp_path, *edits, options="", armed=True, fail=""):
        backend = open_backend(f"sim://?nano=mock{options}")
        for pattern, text in edits:
            assert re.search(pattern, backend.car_toml), pattern
            backend.car_toml = re.sub(pattern, text, backend.car_toml)
        self.backend, self.world, self.pulses = backend, world_of(backend), []
        if armed:
            self.world.esc = ReadyEsc(self.world.car.esc)
        if fail:
            schedule_failures(self.world, [parse_failure(f"{fail}@0")])
        self.world.watchers.append(
            lambda channel, pulse: self.pulses.append(pulse) if channel == 1 else None)
        self.car = Car.over(backend, cars=tmp_path, raise_on_trip=False)

    def run(self, seconds, **command):
        for _ in self.car.states(duration=seconds):
            if command:
                self.car.drive(**command)
        return self

    def outcome(self) -> Outcome:
        neutral = self.world.car.esc.neutral_us
        driving = [(rise, fall) for rise, fall in self.pulses
                   if abs(1e6 * (fall - rise) - neutral) > DRIVES_US]
        truth = self.world.truth()
        driven = driving[-1][1] - driving[0][0] if driving else 0.0
        distance = abs(self.world.truth(driving[-1][1]).distance) if driving else 0.0
        ended = not driving or self.world.t - driving[-1][1] > 0.5
        return Outcome(driven, distance, abs(truth.distance), abs(truth.v_x), self.car.mode,
                       self.car.causes, ended)


def clock(hertz):
    return CLOCK_EDIT[0], CLOCK_EDIT[1].format(hertz)


def neutral(pulse_us):
    return CHANGED_NEUTRAL[0], CHANGED_NEUTRAL[1].format(pulse_us)


WRONG_SETTINGS = {
    "clock 8 % off": [(r"(?<=oscillator_hz = \{ value = )[\d.]+",
                       lambda found: str(0.92 * float(found[0])))],
    "neutral 1600": [neutral(1600)], "neutral 1900, deliberate": [neutral(1900)],
    "neutral 1100, deliberate": [neutral(1100)],
    "channels swapped, centre 1620": [*SWAPPED, (r"center_us = [\d.]+", "center_us = 1620.0")]}


@pytest.mark.parametrize("case", WRONG_SETTINGS)
@pytest.mark.parametrize("seed", [0, 3, 8])
@pytest.mark.slow_except("0-clock 8 % off", "8-channels swapped, centre 1620")
def test_a_disarmed_car_that_speeds_up_gets_no_pulse(tmp_path, case, seed):
    bench = NeutralBench(tmp_path, *WRONG_SETTINGS[case], options=f"&seed={seed}").run(4.0)
    out = bench.outcome()
    assert out.ended
    assert out.driven < 0.7            # of the slowest: at 1600 us it takes 0.4 s to roll 5 cm
    assert out.distance < 0.1
    assert out.speed < 0.01
    assert (out.mode, out.causes) == ("DISARMED", ("MOVES_AT_NEUTRAL",))
    assert "PULSES_OFF" in bench.car.stop().limited


@pytest.mark.slow
def test_27_mhz_is_within_the_accepted_range_and_trips(tmp_path):
    out = NeutralBench(tmp_path, clock(27e6)).run(3.0).outcome()
    assert (out.ended, out.causes) == (True, ("MOVES_AT_NEUTRAL",))
    assert out.driven < 0.3
    assert out.distance < 0.1


@pytest.mark.parametrize("case", ["clock 8 % off", "channels swapped, centre 1620"])
def test_control_without_the_layer_it_drives_on(tmp_path, monkeypatch, case):
    monkeypatch.setattr(NeutralWatch, "update", lambda *_: False)
    out = NeutralBench(tmp_path, *WRONG_SETTINGS[case]).run(4.0).outcome()
    assert not out.ended
    assert out.whole > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("options", ["&cutoff=oe", "&cutoff=mux", "&boot=old", "&rings=2"])
def test_with_cut_offs_and_bootloaders(tmp_path, options):
    """/OE opens for a disarmed car; the multiplexer's own neutral does not drive at all."""
    out = NeutralBench(tmp_path, clock(27e6), options=options).run(5.0).outcome()
    assert out.ended
    assert out.driven < 0.5
    assert out.distance < 0.1


@pytest.mark.slow
def test_swapped_leads_of_the_motor_drive_backward_and_trip(tmp_path):
    out = NeutralBench(tmp_path, neutral(1600), fail="esc:wrong").run(4.0).outcome()
    assert (out.ended, out.causes) == (True, ("MOVES_AT_NEUTRAL",))
    assert out.driven < 0.5
    assert out.distance < 0.1


@pytest.mark.slow
def test_a_fresh_esc_takes_no_wrong_neutral_and_the_car_does_not_move(tmp_path):
    """It waits for its own neutral. Nothing moves, so nothing trips."""
    out = NeutralBench(tmp_path, clock(27e6), armed=False).run(4.0).outcome()
    assert (out.whole < 1e-6, out.causes) == (True, ())


@pytest.mark.slow
def test_arming_again_is_tried_again_and_the_third_time_locks(tmp_path):
    bench = NeutralBench(tmp_path, clock(27e6)).run(3.0)
    for _ in range(2):
        with pytest.raises(NotArmed) as caught:
            bench.car.arm(waive=WAIVED_GATES)
        assert not {"ENCODER_MOVING", "MOVES_AT_NEUTRAL"}.isdisjoint(caught.value.reasons)
        bench.run(3.0)
    assert bench.car.mode == "LOCKED"
    with pytest.raises(NotArmed, match="LATCHED"):
        bench.car.arm(waive=WAIVED_GATES)
    assert bench.outcome().ended


@pytest.mark.slow
def test_a_pushed_car_is_armed_again_at_once(tmp_path):
    """A hand that pushes it is harmless, and cleared by arm()."""
    bench = NeutralBench(tmp_path).run(1.0)
    bench.backend.workshop.push()
    bench.run(2.5)
    assert bench.car.causes == ("MOVES_AT_NEUTRAL",)
    bench.car.arm(waive=WAIVED_GATES)
    bench.run(1.0, throttle=0.3)
    assert (bench.car.mode, bench.outcome().speed > 0.5) == ("ARMED", True)


@pytest.mark.slow
def test_raw_begins_with_neutral_again(tmp_path):
    bench = NeutralBench(tmp_path).run(1.0)
    bench.backend.workshop.push()
    bench.run(2.5)
    with bench.car.raw():
        for _ in bench.car.states(duration=0.3):
            bench.car.pulses(steering_us=1500.0, throttle_us=1650.0)
        assert bench.car.mode == "RAW"


@pytest.mark.parametrize("throttle", [0.15, 0.5, 1.0])
@pytest.mark.parametrize("seed", [0, 4])
@pytest.mark.slow
def test_coasting_after_driving_does_not_trip(tmp_path, throttle, seed):
    bench = NeutralBench(tmp_path, options=f"&seed={seed}", armed=False).run(2.2)
    bench.car.arm(waive=WAIVED_GATES)
    bench.run(1.5, throttle=throttle)
    bench.run(3.0, throttle=0.0)
    assert (bench.car.mode, bench.car.causes) == ("ARMED", ())
    bench.run(1.0, throttle=throttle)
    bench.car.stop()
    bench.run(3.0)
    assert (bench.car.mode, bench.car.causes) == ("DISARMED", ())


@pytest.mark.slow
def test_an_armed_car_at_throttle_0_whose_steering_drives_it_is_disarmed(tmp_path):
    """Channels swapped, and a centre that is neutral by chance."""
    bench = NeutralBench(tmp_path, *SWAPPED, (r"center_us = [\d.]+", "center_us = 1500.0")).run(2.5)
    bench.car.arm(waive=WAIVED_GATES)
    bench.run(1.5, steering=0.3, throttle=0.0)
    out = bench.outcome()
    assert (out.ended, out.causes) == (True, ("MOVES_AT_NEUTRAL",))
    assert out.driven < 0.3
    assert out.distance < 0.1
    bench.car.raise_on_trip = True
    with pytest.raises(Disarmed, match="MOVES_AT_NEUTRAL"):
        bench.car.drive(throttle=0.1)


def test_a_program_that_closes_leaves_no_pulse(tmp_path):
    """A wrong neutral is not detected after it."""
    bench = NeutralBench(tmp_path, clock(27e6), armed=False).run(1.0)
    bench.car.close()
    leds = bytearray(8)
    bench.backend.bus.writeto_then_readfrom(0x40, b"\x06", leds)
    assert leds[3] & 0x10
    assert leds[7] & 0x10


@pytest.mark.parametrize("options", ["&boot=old", "&boot=none"])
def test_until_the_nano_speaks_there_is_no_pulse(tmp_path, options):
    """A bootloader takes 1.3 s, in which a wrong neutral would go unnoticed."""
    bench = NeutralBench(tmp_path, clock(27e6), options=options)
    assert bench.pulses == []
    assert bench.car.mode == "DISARMED"


@pytest.mark.slow
def test_a_nano_that_falls_silent_ends_the_pulses_after_half_a_second(tmp_path):
    bench = NeutralBench(tmp_path, armed=False).run(1.0)
    link = bench.backend.link
    silent = bench.world.t
    for line in (link._up, link._down):
        line.faults = type(line.faults)(silence=[(silent, silent + 2.0)])
    with pytest.raises(Exception, match="no frame"):
        bench.run(3.0)
    for _ in range(40):
        bench.backend.clock.sleep(0.05)
        bench.car._engine._write(bench.world.t)
    last = bench.pulses[-1][1]
    assert 0.45 < last - silent < 0.62
    bench.run(1.0)
    assert bench.world.t - bench.pulses[-1][1] < 0.05, "and they come back with the States"
