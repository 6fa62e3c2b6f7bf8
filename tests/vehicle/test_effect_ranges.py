"""Every effect of the catalogue knows which sizes no car has."""

from __future__ import annotations

import pytest

from dart_hal.vehicle.effects import catalogue

PARAMETERS = [(e.name, q) for e in catalogue().values() for q in e.parameters if q.alone]
IDS = [f"{name}.{q.name}" for name, q in PARAMETERS]


@pytest.mark.parametrize(("name", "parameter"), PARAMETERS, ids=IDS)
def test_size_on_a_bound_is_impossible_and_all_hidden_sizes_are_possible(name, parameter):
    q = parameter
    width = q.high - q.low
    for end, inwards in ((q.low, 1.0), (q.high, -1.0)):
        if end == q.null:  # no size at all
            continue
        for value in (end, end + inwards * 5e-4 * width):
            assert "on the end of the interval" in q.impossible(value), name
    low, high = q.physical_range
    assert q.low <= low <= q.null <= high <= q.high
    hidden = [q.null + sign * size for size in q.sizes for sign in (1.0, -1.0)]
    possible = [k for k in hidden if low <= k <= high]
    assert len(possible) >= len(q.sizes)
    assert [q.impossible(k) for k in possible] == [""] * len(possible), name


@pytest.mark.parametrize(("name", "parameter"), PARAMETERS, ids=IDS)
def test_size_outside_the_physical_range_is_impossible(name, parameter):
    low, high = parameter.physical_range
    for end, bound in ((low, parameter.low), (high, parameter.high)):
        if end != bound:
            assert "outside its physical range" in parameter.impossible(0.5 * (end + bound)), name


def test_share_of_an_axle_is_at_most_all_of_it():
    share, = catalogue()["encoder_axle"].parameters
    assert share.physical_range == (0.0, 1.0)
    assert "on the end" in share.impossible(1.5)
    assert "physical range 0 to 1 share" in share.impossible(1.3)
    assert share.impossible(0.5) == ""


def test_phase_has_no_end():
    phase = next(q for q in catalogue()["encoder_ring"].parameters if q.name == "phase")
    assert phase.impossible(phase.high) == ""
