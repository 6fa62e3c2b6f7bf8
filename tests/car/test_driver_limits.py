"""The driver's figures: how long, how much, how many, each from both sides."""

from __future__ import annotations

from contextlib import suppress
from itertools import pairwise

import pytest

from dart_hal.car import Car
from dart_hal.car.driver import Driver
from dart_hal.control.speed import SpeedLaw
from dart_hal.core.errors import NotArmed
from dart_hal.devices.links.base import open_backend
from dart_hal.vehicle.load import vehicle_of
from dart_hal.wire.codec import DOWN
from dart_hal.wire.decoder import FrameDecoder
from dart_lab.sim.motion import MeanMotion
from dart_lab.sim.truth import world_of
from tests.common import MOCK_URL

pytestmark = pytest.mark.usefixtures("armed_esc")


class Lab:
    """An open simulated car whose wheels can be held and whose frames can be lost."""

    def __init__(self, tmp_path) -> None:
        self.backend = open_backend(MOCK_URL)
        self.car = Car.over(self.backend, cars=tmp_path)
        self.lose = 0
        self.car.on_bytes(self._hook)

    def _hook(self, direction: str, data: bytes, t: float) -> bytes:
        if direction == "rx" and self.lose:
            self.lose -= 1
            return b""
        return data

    def turn_by_hand(self, rate: float) -> None:
        nano = world_of(self.backend).nano
        type(nano).set_wheel(nano, rate)
        nano.set_wheel = lambda _: None

    def hold(self) -> None:
        """The whole car is held: it neither rolls nor measures any motion."""
        world_of(self.backend).motion.step = lambda *_: MeanMotion(0.0, 0.0, 0.0, 0.0, 0.0)

    def wait(self, seconds: float) -> None:
        for _ in self.car.states(duration=seconds):
            pass

    def facts(self):
        return self.car._engine.driver.facts(self.car._engine.now)


@pytest.fixture
def lab(tmp_path):
    made = Lab(tmp_path)
    yield made
    made.car.close()


def throttle_for(car: Car, speed: float) -> float:
    return SpeedLaw(vehicle_of(car.files.model)).feed_forward(speed)


@pytest.mark.slow
def test_a_throttle_that_must_move_the_car_and_no_edge_is_neutral_after_300_ms(lab):
    """An encoder that came off: 0.3 s after the five edges that it owes, neutral."""
    car = lab.car
    world = world_of(lab.backend)
    car.arm()
    lab.turn_by_hand(0.0)
    owed = None
    cut = None
    for state in car.states(duration=1.5):
        neutral = car.drive(throttle=throttle_for(car, 1.2)).throttle == 0.0
        if owed is None and world.distance >= 5 * car.files.metres_per_edge.value:
            owed = state.t
        if cut is None and owed is not None and neutral:
            cut = state.t
    assert cut - owed <= 0.3
    assert car.drive(throttle=0.5).throttle == 0.0
    car.stop()
    lab.wait(0.2)
    with pytest.raises(NotArmed) as refused:
        car.arm()
    assert "ENCODER_LOST" in refused.value.reasons
    lab.turn_by_hand(0.5)
    lab.wait(0.3)
    lab.turn_by_hand(0.0)
    lab.wait(1.5)
    car.arm()


def test_a_throttle_just_above_the_dead_band_is_accepted(lab):
    car = lab.car
    car.arm()
    lab.hold()
    for _ in car.states(duration=1.5):
        applied = car.drive(throttle=throttle_for(car, 0.8))
    assert applied.throttle > 0.05
    assert not lab.facts().encoder_lost


def test_wheels_that_turn_are_no_lost_encoder(lab):
    car = lab.car
    car.arm()
    for _ in car.states(duration=1.5):
        applied = car.drive(throttle=throttle_for(car, 1.2))
    assert applied.throttle >= throttle_for(car, 1.0)


@pytest.mark.slow
def test_frames_lost_in_the_last_five_seconds_refuse(lab):
    """15 of 500 are 3 %; they count for 5 s and no longer."""
    lab.wait(5.5)
    for _ in range(15):
        lab.lose = 1
        lab.wait(0.06)
    lab.wait(3.0)
    assert lab.facts().frame_loss == pytest.approx(0.03, abs=0.002)
    with pytest.raises(NotArmed) as refused:
        lab.car.arm()
    assert refused.value.reasons == ("FRAME_LOSS",)
    lab.wait(2.5)
    assert lab.facts().frame_loss == 0.0
    lab.car.arm()


def test_one_lost_frame_restarts_the_time_of_a_good_link(lab):
    lab.wait(1.0)
    assert lab.facts().link_good_for >= 0.9
    lab.lose = 1
    lab.wait(0.2)
    assert 0.1 < lab.facts().link_good_for < 0.25


def downward(car: Car) -> list[tuple[float, str, dict]]:
    """(time, message, values) of all that goes to the Nano from now on."""
    decoder = FrameDecoder(DOWN)
    sent = []

    def hook(direction: str, data: bytes, t: float) -> bytes:
        if direction == "tx":
            sent.extend((t, f.message.name, f.as_dict()) for f in decoder.feed(data))
        return data

    car.on_bytes(hook)
    return sent


def test_one_heartbeat_and_one_pwm_frame_for_every_second_state(lab):
    lab.wait(0.1)
    sent = downward(lab.car)
    lab.wait(2.0)
    beats = [t for t, name, _ in sent if name == "HEARTBEAT"]
    assert len(beats) == pytest.approx(100, abs=2)
    steps = [b - a for a, b in pairwise(beats)]
    assert min(steps) > 0.018
    assert max(steps) < 0.022


def test_pulses_and_heartbeat_go_on_without_states(lab):
    """1.5 PWM frames at most: the Nano trips after three beats that are missing."""
    sent = downward(lab.car)
    lab.wait(0.5)
    lab.lose = 8
    lab.wait(0.5)
    beats = [t for t, name, _ in sent if name == "HEARTBEAT"]
    assert max(b - a for a, b in pairwise(beats)) < 0.035


def test_a_loop_that_does_not_answer_holds_the_pulses_up_for_4_ms(lab):
    """On a real link; here in steps of the virtual one, taken for real."""
    lab.wait(0.1)
    sent = downward(lab.car)
    arrived = []
    lab.car.on_state(lambda state: arrived.append(lab.backend.clock.now()))
    lab.backend.virtual = False
    while len(arrived) < 40:
        lab.car._engine.step(0.1)
    lab.backend.virtual = True
    beats = [t for t, name, _ in sent if name == "HEARTBEAT"]
    late = [t - max(a for a in arrived if a <= t) for t in beats]
    assert len(late) >= 19
    assert late == pytest.approx([0.004] * len(late), abs=1e-4)


@pytest.mark.slow
def test_pings_are_many_at_first_and_then_two_a_second(tmp_path):
    with Car.open(MOCK_URL, cars=tmp_path) as car:
        sent = downward(car)
        for _ in car.states(duration=8.0):
            pass
    pings = [t for t, name, _ in sent if name == "TIME_PING"]
    early = [t for t in pings if t < pings[0] + 2.5]
    late = [t for t in pings if t > pings[0] + 3.5]
    assert 20 <= len(early) <= 26
    assert 7 <= len(late) <= 10
    assert max(b - a for a, b in pairwise(late)) < 0.55


def test_the_last_message_to_the_nano_is_a_heartbeat_with_stop(lab):
    sent = downward(lab.car)
    lab.car.arm()
    for _ in lab.car.states(duration=0.3):
        lab.car.drive(throttle=0.2)
    driven = len(sent)
    lab.car.close()
    assert len(sent) > driven
    _, name, values = sent[-1]
    assert name == "HEARTBEAT"
    assert values["mode"] != next(v["mode"] for _, n, v in reversed(sent[:driven])
                                  if n == "HEARTBEAT")
    assert values["throttle"] == 0  # no pulse


def test_a_heartbeat_has_the_direction_of_driving(lab):
    """1 forward, 2 backward, 0 neither: flags of the newest beat after each command."""
    lab.car.arm()
    sent = downward(lab.car)
    flags = []
    for throttle in (0.3, 0.0, -0.3):
        for _ in lab.car.states(duration=0.2):
            lab.car.drive(throttle=throttle)
        flags.append([values["flags"] for _, name, values in sent if name == "HEARTBEAT"][-1])
    assert flags == [1, 0, 2]


def applied_behind_a_cut(tmp_path) -> list[tuple[bool, float]]:
    """(pulses pass, throttle applied) of each State; after 50 of them no beat arrives."""
    backend = open_backend(MOCK_URL + "&cutoff=mux")
    states: list[tuple[bool, float]] = []
    with Car.over(backend, cars=tmp_path, raise_on_trip=False) as car:
        muted = False
        car.on_bytes(lambda way, data, t: b"" if muted and way == "tx" else data)
        car.arm()
        car.on_state(lambda state: states.append(
            ("OUTPUT_LIVE" in state.health.flags, state.applied.throttle)))
        with suppress(NotArmed):
            for _ in car.states(duration=1.0):
                car.drive(throttle=0.3)
                muted = len(states) >= 50
    return states


def cut_off(states: list[tuple[bool, float]]) -> set[float]:
    assert states[49] == (True, pytest.approx(0.3, abs=0.01))
    return {throttle for live, throttle in states[50:] if not live}


@pytest.mark.slow
def test_what_the_nano_cuts_off_is_not_applied(tmp_path):
    """From the frame that reports it the State has no throttle."""
    assert cut_off(applied_behind_a_cut(tmp_path)) == {0.0}


@pytest.mark.slow
def test_without_the_look_at_the_cut_off_it_would_be_applied(tmp_path, monkeypatch):
    """Negative control."""
    monkeypatch.setattr(Driver, "apply_cutoff", lambda self, applied: applied)
    assert max(cut_off(applied_behind_a_cut(tmp_path))) > 0.2
