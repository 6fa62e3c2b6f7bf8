"""A step as one straight line: the same bits as the closures, for every vehicle and effect."""

from __future__ import annotations

import math
import struct
from dataclasses import replace
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.vehicle import PAPER, SCALAR, SETS
from dart_hal.vehicle.effects import extended, parse
from dart_hal.vehicle.straight import straight
from dart_lab.sim.hidden import hidden_car
from dart_lab.sim.motion import DYNAMIC, KINEMATIC, _dynamic, _kinematic

DT = 1e-3
CARS = {**{name: SETS[name] for name in SETS}, "hidden": hidden_car(3).vehicle,
        "effects": extended(PAPER, parse("road_slope_x:0.02,quadratic_drag:0.1,"
                                         "load_transfer:0.03,combined_slip:0.5"))}
NUMBERS = st.one_of(st.sampled_from([0.0, -0.0, 1e-300, -1e-9]), st.floats(-6.0, 6.0))


def bits(values):
    return [struct.pack("<d", v) for v in values]


@pytest.mark.parametrize(("make", "names"), [(_dynamic, DYNAMIC), (_kinematic, KINEMATIC)])
@pytest.mark.parametrize("name", sorted(CARS))
@pytest.mark.few("paper*", "upstream*", "effects*", "hidden-_dynamic*")
def test_every_bit_is_the_same(name, make, names):
    maker = partial(make, CARS[name], DT)
    line, closures = straight(maker, names), maker(SCALAR)
    assert "straight line" in line.__code__.co_filename

    @given(st.lists(NUMBERS, min_size=len(names), max_size=len(names)))
    def same(values):
        assert bits(line(*values)) == bits(closures(*values))

    same()


@pytest.mark.more
def test_a_drive_of_ten_thousand_steps_is_the_same():
    maker = partial(_dynamic, CARS["hidden"], DT)
    line, closures = straight(maker, DYNAMIC), maker(SCALAR)
    a = b = (0.0,) * 6
    for k in range(10_000):
        angle = 0.3 * math.sin(1e-3 * k)
        held = (2.5 if k < 7000 else 0.0, 0.9, 0.0 if k < 8000 else 3.0, math.cos(angle),
                math.sin(angle))
        a, b = line(*a, *held), closures(*b, *held)
    assert bits(a) == bits(b)
    assert abs(a[3]) < 10.0


def test_what_branches_stays_as_it_is():
    def make(xp):
        return lambda x: (x if x > 0.0 else -x,)

    line = straight(make, ("x",))
    assert "straight line" not in line.__code__.co_filename
    assert line(-2.0) == (2.0,)


def test_a_line_that_leaves_an_operation_out_is_seen():
    """Control: x + 0 is not x, to the bit."""
    def make(xp):
        return lambda x: (x + 0.0, xp.fmax(x, 0.0), xp.fmin(0.0, x))

    line = straight(make, ("x",))
    assert bits(line(-0.0)) == bits((0.0, -0.0, 0.0)) == bits(make(SCALAR)(-0.0))
    assert bits(line(-0.0))[:1] != bits((-0.0,))


def test_cars_of_one_form_share_their_code():
    first, second = (straight(partial(_dynamic, hidden_car(n).vehicle, DT), DYNAMIC)
                     for n in (1, 2))
    assert first.__code__.co_code == second.__code__.co_code
    assert first.__kwdefaults__ != second.__kwdefaults__


def test_numbers_that_are_not_finite_are_left_to_the_closures():
    stiff = replace(PAPER, tyres=replace(PAPER.tyres, rear_max=math.inf))
    maker = partial(_dynamic, stiff, DT)
    values = (0.0, 0.0, 0.0, 1.0, 0.1, 0.2, 1.0, 0.5, 0.0, 0.99, 0.1)
    assert bits(straight(maker, DYNAMIC)(*values)) == bits(maker(SCALAR)(*values))
