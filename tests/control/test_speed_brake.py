"""The brake of ``drive_speed``: pulled where it is needed, and never where it would reverse."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.car import Car
from dart_hal.control import drivetrain
from dart_hal.control.loop import SpeedLoop
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.esc import EscMode
from dart_lab.sim.truth import world_of

COUNT_THROTTLE = 0.011
"""Of throttle, one count of the PCA9685."""
URL = "sim://?seed={}&nano=mock{}"


def modes_of(reference, seconds=4.0, seed=3, more=""):
    """(t, true speed, throttle, mode of the ESC) under drive_speed(reference(t))."""
    backend = open_backend(URL.format(seed, more))
    rows = []
    with Car.over(backend) as car:
        world = world_of(backend)
        car.arm()
        start = None
        for state in car.states(duration=seconds):
            start = state.t if start is None else start
            t = state.t - start
            target = reference(t)
            applied = (car.drive_speed(steering=0.1, speed=target) if target is not None
                       else car.drive(steering=0.1))
            rows.append((t, world.truth().v_x, applied.throttle, world.esc.mode, applied.limited))
    return rows


def up_and_down(t):
    return 2.2 if t % 1.6 < 0.9 else 0.6


def backward(rows):
    return [row for row in rows if row[3] is EscMode.REVERSE or row[1] < -0.02]


@pytest.mark.slow
@pytest.mark.parametrize("more", ["", pytest.param("&effect=throttle_lag:0.084",
                                                   marks=pytest.mark.slow)])
def test_it_brakes_where_rolling_out_is_too_slow_and_never_reverses(more):
    rows = modes_of(up_and_down, more=more)
    assert any(row[3] is EscMode.BRAKING for row in rows)
    assert not backward(rows)
    slowed = [v for t, v, *_ in rows if 1.5 < t < 1.6]
    assert max(slowed) < 0.9        # rolling out from 2.2 m/s takes 1.1 s


@pytest.mark.slow
def test_without_the_brake_it_would_be_late(monkeypatch):
    """Control of the same: what the car does by itself."""
    monkeypatch.setattr(drivetrain, "MIN_BRAKING_SPEED", 99.0)
    rows = modes_of(up_and_down, seconds=1.6)
    assert max(v for t, v, *_ in rows if 1.5 < t < 1.6) > 1.2


def let_go_of_the_brake(t):
    """Braked, then 0.18 s of neutral by ``drive``: the ESC's next pull back is reverse."""
    return 2.2 if t < 0.9 else None if 1.1 < t < 1.28 else 0.4


@pytest.mark.slow
def test_after_a_rest_at_speed_the_car_is_pulled_forward_before_it_is_braked():
    rows = modes_of(let_go_of_the_brake, seconds=1.8)
    assert any(row[3] is EscMode.READY for row in rows if 1.2 < row[0] < 1.32)
    assert any(row[3] is EscMode.BRAKING for row in rows if row[0] > 1.4)
    assert not backward(rows)


@pytest.mark.slow
def test_control_braked_at_once_such_a_car_gets_reverse(monkeypatch):
    plain = SpeedLoop._record_throttle

    def careless(self, applied, dt):
        plain(self, applied, dt)
        self._pulled = True

    monkeypatch.setattr(SpeedLoop, "_record_throttle", careless)
    assert backward(modes_of(let_go_of_the_brake, seconds=1.8))


@pytest.mark.slow
def test_a_doubted_speed_is_neither_fed_back_nor_braked():
    rows = modes_of(up_and_down, seconds=3.0, more="&fail=enc:off@0.5s")
    doubted = [row for row in rows if "ENCODER_DOUBTED" in row[4]]
    assert len(doubted) > 50
    assert all(row[2] == 0.0 for row in doubted[3:])


@pytest.mark.slow
def test_more_than_there_is_is_reported():
    names = {name for row in modes_of(lambda t: 4.9, seconds=1.0) for name in row[4]}
    assert "RANGE" not in names    # a ramp of 3 m/s2 is within the motor's reach
    rows = modes_of(lambda t: 4.9, seconds=4.0)
    assert "RANGE" in rows[-1][4]  # 4.2 m/s is all it does
    assert np.max([row[2] for row in rows]) <= 1.0 + COUNT_THROTTLE
