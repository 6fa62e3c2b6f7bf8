"""The code overview names functions that exist, in the order in which a drive calls them."""

from __future__ import annotations

import re

import pytest
from handbook import ROOT
from walks import (
    DOTTED_NAME,
    FIRMWARE_LINE,
    MAX_STEPS,
    OVERVIEW_PAGE,
    find_object,
    first_calls,
    section,
    steps,
)

from dart_hal.car import Car
from tests.common import WAIVED_GATES

COMMAND = "From a command to the ESC pin"
EDGE_WALK = "From an encoder edge to a State"


def test_every_name_exists():
    names = DOTTED_NAME.findall(OVERVIEW_PAGE.read_text(encoding="utf-8"))
    assert len(names) > 25
    for name in names:
        find_object(name)


def missing_in_firmware(text: str) -> list[str]:
    """Functions of the firmware that a text names and their files do not define."""
    return [f"{file}: {name}" for file, name in FIRMWARE_LINE.findall(text)
            if not re.search(rf"^[\w ].*\b{name}\(", (ROOT / file).read_text(encoding="utf-8"),
                             re.MULTILINE)]


def test_every_function_of_the_firmware_exists():
    text = section(EDGE_WALK)
    assert len(FIRMWARE_LINE.findall(text)) == 3
    assert missing_in_firmware(text) == []
    assert missing_in_firmware(text.replace("send_state", "send_all")), "the negative control"


@pytest.mark.parametrize("heading", [COMMAND, EDGE_WALK])
def test_a_walk_is_short(heading):
    assert 5 <= len(steps(heading)) <= MAX_STEPS


@pytest.fixture
def car(armed_esc):
    with Car.open("sim://?nano=mock") as opened:
        opened.arm(waive=WAIVED_GATES)
        yield opened


def drive(car, seconds: float, throttle: float) -> None:
    for _ in car.states(duration=seconds):
        car.drive(throttle=throttle)


def test_a_command_takes_this_walk(car):
    drive(car, 0.1, 0.0)
    loop = car.states()
    while not car._engine._due:  # a PWM frame belongs to every second STATE
        next(loop)

    def work():
        for _ in range(4):
            car.drive(steering=0.1, throttle=0.3)
            next(loop)

    assert first_calls(steps(COMMAND), work) == steps(COMMAND)


def test_an_edge_takes_this_walk(car):
    drive(car, 0.5, 0.4)
    found = []

    def work():
        found.append(next(car.states()))

    assert first_calls(steps(EDGE_WALK), work) == steps(EDGE_WALK)
    assert found[0].speed > 0.2, "the wheels turn, so there are edges"


def test_a_step_that_is_not_taken_is_detected(car):
    """The negative control: without edges the walk is another one."""
    def work():
        next(car.states())

    assert first_calls(steps(EDGE_WALK), work) != steps(EDGE_WALK)
