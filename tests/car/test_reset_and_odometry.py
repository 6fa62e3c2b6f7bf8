"""A Nano that resets while the wheel turns: ticks and pose go on where they were."""

from __future__ import annotations

from itertools import pairwise
from math import hypot

import pytest

from dart_hal.car import Car
from dart_hal.core.errors import LinkLost
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.truth import world_of

NANO_KINDS = [("mock", "none"), ("mock", "old"), ("mock", "optiboot"),
              pytest.param("avr", "optiboot", marks=pytest.mark.emulator),
              pytest.param("avr", "old", marks=[pytest.mark.emulator, pytest.mark.long])]


def drive_through_a_reset(nano: str, boot: str, cars):
    """States of a car at 1 m/s whose Nano resets after a second, and the true path meanwhile."""
    backend = open_backend(f"sim://?nano={nano}&boot={boot}")
    world = world_of(backend)
    with Car.over(backend, cars=cars, raise_on_trip=False) as car:
        car.arm()
        states = []
        for state in car.states(duration=1.5):
            car.drive_speed(steering=0.0, speed=1.0)
            states.append(state)
        before = len(states)
        at = world.t
        world.nano.reset("brownout")                    # after a watchdog's, ATmegaBOOT never ends
        for _ in range(5):
            try:
                for state in car.states(duration=0.5):
                    car.drive_speed(steering=0.0, speed=1.0)
                    states.append(state)
            except LinkLost:                            # the boot loader is silent for 1.3 s
                continue
        assert len(states) > before + 50
        edge = car.files.metres_per_edge.value
        assert car.mode != "ARMED"
        return states[:before], states[before:], edge, world.truth(at).v_x


@pytest.mark.parametrize(("nano", "boot"), NANO_KINDS)
@pytest.mark.slow
def test_no_jump_of_more_than_one_edge(nano, boot, tmp_path):
    before, after, edge, speed = drive_through_a_reset(nano, boot, tmp_path)
    assert speed > 0.7, "the wheel turns at the reset"
    last = before[-1]
    first = next(s for s in after if s.t - before[-1].t > 0.015)
    assert abs(first.ticks - last.ticks) <= 1 + round(0.02 * speed / edge)
    jump = hypot(first.pose.x - last.pose.x, first.pose.y - last.pose.y)
    assert jump <= edge + 0.02 * speed
    for a, b in pairwise([*before, *after]):
        assert b.ticks >= a.ticks, "never back to the count of a new boot"
        moved = hypot(b.pose.x - a.pose.x, b.pose.y - a.pose.y)
        assert moved <= edge + 0.03 * max(abs(a.speed), abs(b.speed), 0.1)
