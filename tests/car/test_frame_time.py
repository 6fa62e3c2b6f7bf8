"""When the pulses of a PWM frame are written, and what a loop that is too late reports.

The car is simulated in virtual time; the engine treats it as a real one, which has a user's loop
that may answer a State.
"""

from __future__ import annotations

from contextlib import nullcontext
from unittest.mock import Mock, patch

import pytest

from dart_hal.car import Car
from dart_hal.car.engine import MAX_LOOP_ANSWER_TIME, Engine
from dart_hal.core.errors import LinkLost
from dart_hal.devices.links.base import open_backend
from dart_hal.wire.messages import PARAM_GET
from tests.common import MOCK_1_URL


@pytest.fixture
def car():
    backend = open_backend(MOCK_1_URL)
    with Car.over(backend) as opened:
        wait(opened, 0.1)
        backend.virtual = False
        try:
            yield opened
        finally:
            backend.virtual = True


def wait(car: Car, seconds: float) -> None:
    for _ in car.states(duration=seconds):
        pass


@pytest.mark.parametrize("wakes", [True, False])
def test_unanswered_state_is_followed_by_its_pulses_after_the_grace_time(car, wakes):
    """Control: a read that does not end for the pulses lets them wait for the next State."""
    engine = car._engine
    patience = Engine._read_timeout if wakes else lambda engine, timeout: timeout
    reads: list[float] = []
    states: list[float] = []
    writes: list[float] = []
    frame = engine.driver.frame

    def note(now):
        writes.append(now)
        return frame(now)

    def note_read(engine, timeout):
        reads.append(patience(engine, timeout))
        assert len(reads) < 1000, "reads that do not wait"
        return reads[-1]

    with (patch.object(Engine, "_read_timeout", note_read),
          patch.object(engine.driver, "frame", note)):
        car.on_state(lambda state: states.append(engine.now))
        wait(car, 0.1)
    delays = [write - max(t for t in states if t <= write) for write in writes if write > states[0]]
    assert len(delays) >= 4
    answered = [delay == pytest.approx(MAX_LOOP_ANSWER_TIME, abs=1e-4) for delay in delays]
    assert all(answered) == wakes, delays


@pytest.mark.parametrize(("delay", "cautioned"), [(0.025, True), (0.015, False)])
def test_frames_later_than_one_pwm_frame_bring_a_caution(car, delay, cautioned):
    """p99 of the last 500 frames, once a second: a hundredth of them may be late."""
    engine = car._engine
    engine._frames = 1000
    for k in range(500):
        engine._due = True
        engine._due_since = 10.0
        engine._note_latency(10.0 + MAX_LOOP_ANSWER_TIME + (0.1 if k % 125 == 0 else delay))
    assert engine.driver.observer.loop_latency == pytest.approx(delay)
    names = [caution.name for caution in engine.driver.cautions(engine.now)]
    assert ("LOOP_LATE" in names) == cautioned


@pytest.mark.parametrize("held", [True, False])
def test_a_frame_that_was_due_before_the_link_was_lost_is_not_answered(car, held):
    """Else ``drive`` would raise or not by when the port vanished; the control shows that."""
    engine = car._engine
    engine._due = True
    if held:
        engine.hold_neutral()
    link = engine.backend.link
    engine.transmitter.set_link(Mock(write=Mock(side_effect=LinkLost("no port"))))
    with nullcontext() if held else pytest.raises(LinkLost):
        assert car.drive(throttle=0.3).throttle == 0.0
    engine.transmitter.set_link(link)


def test_unanswered_questions_to_the_nano_are_ten_a_second(car):
    """The Nano does not answer; the question is not repeated with each frame."""
    engine = car._engine
    questions: list[float] = []
    send = engine.transmitter.send

    def drop_questions(message, values, now):
        if message is PARAM_GET:
            questions.append(now)
        else:
            send(message, values, now)

    with patch.object(engine.transmitter, "send", drop_questions):
        car.on_state(lambda state: engine.receiver.params.clear())    # also an earlier answer
        wait(car, 1.0)
    assert len(questions) == pytest.approx(10, abs=2)
