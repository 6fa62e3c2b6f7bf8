"""What the ESC gets of an operator's commands, in virtual time: old ones, silence, held ones."""

from __future__ import annotations

import pytest

from dart_hal.car import Car
from dart_hal.errors import NotArmed
from dart_hal.foxglove import operate
from dart_hal.foxglove.operate import COMMAND, TWIST, Operator
from dart_hal.foxglove.protocol import Malformed
from dart_hal.links.base import open_backend
from dart_hal.recording.run import RunReader
from dart_hal.sim.truth import world_of

NEUTRAL = 0.250
"""s from the last command, as old as it is, to the end of the last driving pulse."""
NEAR_US = 5.0
AGE = 0.03
"""s that the newest ping is old when a command comes."""


class Operated:
    """An emulated car that somebody operates; ``drive(seconds, old)``: 20 commands a second."""

    def __init__(self, record=None, topic=COMMAND):
        backend = open_backend("sim://?nano=mock&seed=1")
        self.pulses, self.refused = [], []
        world_of(backend).watchers.append(
            lambda channel, pulse: self.pulses.append(pulse) if channel == 1 else None)
        self.car = Car.over(backend, raise_on_trip=False, record=record)
        self.operator = Operator(self.car, 0.175, clock=self.now)
        self.operator.advertise("me", 1, topic)

    def now(self):
        return self.car.now

    def each(self, old=AGE):
        value = {"steering": 0.1, "throttle": 0.25, "linear": {"x": 1.0}, "angular": {"z": 0.5}}
        try:
            self.operator.publish("me", 1, value, self.now() - old)
        except Malformed as why:
            self.refused.append(str(why))

    def drive(self, seconds, old=AGE, states=None):
        """old None: nobody publishes. As the server does, silence is looked for each 20 ms."""
        for n, _ in enumerate(states or self.car.states(duration=seconds)):
            if n % 2 == 0:
                self.operator.silent()
            if n % 5 == 0 and old is not None:
                self.each(old)

    def driving(self, since):
        return [fall - since for rise, fall in self.pulses
                if fall > since and abs((fall - rise) * 1e6 - 1500.0) > NEAR_US]

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.car.close()


def after_silence(old=AGE):
    """s from the last command that came to the last driving pulse."""
    with Operated() as at:
        at.car.arm()
        at.drive(0.5, old)
        at.each(old)
        last = at.now()
        assert at.driving(last - 0.1), "it drove until then"
        at.drive(1.0, None)
        assert at.car.mode == "DISARMED", "it is armed again by hand"
        assert at.operator.over == "silent"
        return max(at.driving(last))


def test_silence_is_neutral_at_the_pin_and_disarms():
    assert 0.05 < after_silence() <= NEUTRAL - AGE


def test_the_age_of_a_command_is_taken_off():
    assert after_silence(old=0.12) <= NEUTRAL - 0.12


def test_control_an_age_that_is_forgotten_is_seen_at_the_pin(monkeypatch):
    publish = Operator.publish
    monkeypatch.setattr(Operator, "publish", lambda self, who, channel, value, heard:
                        publish(self, who, channel, value, self._clock()))
    assert after_silence(old=0.12) > NEUTRAL - 0.12


def test_control_a_longer_hold_is_seen_at_the_pin(monkeypatch):
    monkeypatch.setattr(operate, "HOLD", 0.4)
    assert after_silence() > NEUTRAL


@pytest.mark.parametrize("topic", [COMMAND, TWIST])
def test_it_is_armed_by_hand_and_not_while_a_stick_is_held(topic):
    with Operated(topic=topic) as at:
        at.car.arm()
        at.drive(0.3)
        at.drive(0.7, None)
        silent = at.now()
        at.drive(0.5)
        assert any("not armed" in text for text in at.refused)
        with pytest.raises(NotArmed, match="THROTTLE_NOT_NEUTRAL"):
            at.drive(0.0, states=at.car.arming())
        at.drive(0.5)
        assert at.driving(silent) == []
        at.drive(0.3, None)
        at.car.arm()
        at.drive(0.5)
        assert at.driving(silent), "who had let go of it drives"


def test_its_commands_are_recorded_by_their_source(tmp_path):
    with Operated(tmp_path / "run.mcap") as at:
        at.car.arm()
        at.drive(0.3)
    assert {c.source for c in RunReader(tmp_path / "run.mcap").commands()} == {"foxglove"}
