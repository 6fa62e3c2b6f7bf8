"""The receiver takes all that passes the CRC: no exception, no number that is none."""

from __future__ import annotations

import math
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.car import Car
from dart_hal.car.hooks import Hooks
from dart_hal.car.receive import MAX_QUEUED_MESSAGES, Receiver
from dart_hal.car.telemetry import Telemetry
from dart_hal.car.transmit import Transmitter
from dart_hal.wire.codec import UP, encode
from dart_hal.wire.messages import HELLO, PARAM_STATUS, PARAM_VALUE, STATE
from tests.wire import wire_samples as samples

BYTE_TIME = 20e-6
OK = PARAM_STATUS["OK"]
STATE_FIELDS = [f.name for f in STATE.fields]


class Deaf:
    """A link without a listener."""

    def write(self, data):
        """Nobody."""


@pytest.fixture(scope="module")
def car_files():
    """Files of a car, and what its PCA9685 carries at rest."""
    with Car.open("sim://?nano=mock") as car:
        for state in car.states(duration=0.05):
            applied = state.applied
        return car.files, applied


def receiver(files):
    telemetry = Telemetry(files, BYTE_TIME)
    return Receiver(telemetry, Transmitter(Deaf(), Hooks(), 1, BYTE_TIME))


class Liar:
    """A Nano whose frames are well formed: time and edges that can be, all else anything."""

    def __init__(self, seed):
        self.rng = Random(seed)
        self.seq = 0
        self.ticks = 0
        self.edges = 0

    def frame(self):
        rng = self.rng
        self.seq = self.seq + 1 + (rng.random() < 0.05) * rng.randrange(256) & 0xFF
        if rng.random() < 0.3:
            message = rng.choice(UP)
            return encode(message, self.seq, samples.random_values(message, rng))
        self.ticks += rng.choice((20_000, 20_000, 1, 40_000, rng.randrange(1 << 27)))
        self.edges += rng.choice((0, 0, 1, 2))
        values = dict(zip(STATE_FIELDS, self._values(), strict=True))
        values |= {"t_ck": self.ticks & 0xFFFFFFFF, "enc_count": self.edges & 0xFFFFFFFF}
        if rng.random() < 0.7:
            values["gyro"] = tuple(rng.randrange(-31_000, 31_000) for _ in range(3))
        return encode(STATE, self.seq, values)

    def _values(self):
        flat = samples.random_values(STATE, self.rng)
        at = 0
        for f in STATE.fields:
            yield flat[at] if f.count == 1 else tuple(flat[at:at + f.count])
            at += f.count


def numbers(value):
    """Every float in a State, however deep."""
    if isinstance(value, float):
        yield value
    elif isinstance(value, tuple):
        for part in value:
            yield from numbers(part)
    elif hasattr(value, "__dataclass_fields__"):
        for name in value.__dataclass_fields__:
            yield from numbers(getattr(value, name))


def lied_to(car_files, seed, frames):
    """The States of a receiver that is fed by a liar."""
    files, applied = car_files
    ear = receiver(files)
    liar = Liar(seed)
    t = 0.0
    states = []
    for _ in range(frames):
        t += liar.rng.choice((0.0, 0.01, 0.01, 3.0))
        states += ear.feed(liar.frame(), t, applied)
        assert len(ear.inbox) <= MAX_QUEUED_MESSAGES
        assert len(ear.captures) <= 4
    assert [s.seq for s in states] == sorted({s.seq for s in states})
    return states


def law(states):
    for state in states:
        assert not any(math.isnan(x) for x in numbers(state)), state


@given(st.integers(0, 2**64))
def test_no_frames_break_the_receiver(car_files, seed):
    law(lied_to(car_files, seed, 80))


def test_a_liar_is_believed_often_enough_to_mean_something(car_files):
    """The control: many of its frames do become States."""
    assert len(lied_to(car_files, 1, 600)) > 150


@pytest.mark.long
def test_a_million_lies(car_files):
    for seed in range(1000):
        law(lied_to(car_files, seed, 1000))


answers = st.lists(st.tuples(st.integers(0, 0xFFFF), st.integers(0, 255),
                             st.integers(0, 0xFFFF_FFFF)), max_size=100)


@given(answers)
def test_only_an_answer_of_ok_is_a_parameter_and_the_last_counts(car_files, answers):
    files, applied = car_files
    ear = receiver(files)
    for k, (ident, status, value) in enumerate(answers):
        ear.feed(encode(PARAM_VALUE, k & 0xFF, {"id": ident, "status": status, "req_seq": 0,
                                                "value": value}), 0.0, applied)
    assert ear.params == {ident: value for ident, status, value in answers if status == OK}
    assert len(ear.inbox) == min(len(answers), MAX_QUEUED_MESSAGES)


def test_parameters_are_those_of_this_boot(car_files):
    files, applied = car_files
    ear = receiver(files)
    hello = samples.random_values(HELLO, Random(3))
    ear.feed(encode(HELLO, 0, hello), 0.0, applied)
    ear.feed(encode(PARAM_VALUE, 1, {"id": 10, "status": OK, "req_seq": 0, "value": 110}),
             0.0, applied)
    ear.feed(encode(HELLO, 2, hello), 0.1, applied)
    assert ear.params == {10: 110}, "the same boot sends hello again"
    at = next(k for k, f in enumerate(_flat(HELLO)) if f == "boot_count")
    other = [*hello[:at], hello[at] ^ 1, *hello[at + 1:]]
    ear.feed(encode(HELLO, 3, other), 0.2, applied)
    assert ear.params == {}


def _flat(message):
    return [f.name for f in message.fields for _ in range(f.count)]
