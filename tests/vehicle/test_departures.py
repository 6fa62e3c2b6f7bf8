"""Forces that act a little differently than they are written, over the whole catalogue."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from dart_hal.vehicle import PAPER, make_dynamic
from dart_hal.vehicle.channels import transform_signal
from dart_hal.vehicle.departures import DEPARTURES, with_departures
from dart_hal.vehicle.effect import ActiveEffect, Now
from dart_hal.vehicle.effects import catalogue

FORCE_EFFECTS = sorted(name for name, effect in catalogue().items() if effect.force is not None)
AS_WRITTEN = (0.0,) * len(DEPARTURES)
T = 0.01 * np.arange(50)


def both(name, departures=AS_WRITTEN):
    """The paper's car with a force of the catalogue, as it is written and with departures."""
    effect = catalogue()[name]
    sizes = tuple(p.sizes[1] for p in effect.parameters)
    return (replace(PAPER, effects=(ActiveEffect(effect, sizes),)),
            replace(PAPER, effects=(ActiveEffect(with_departures(effect), (*sizes, *departures)),)))


@pytest.mark.parametrize("name", FORCE_EFFECTS)
def test_what_it_does_to_signals_stays_as_written(name):
    """A slope is measured by the accelerometer, at any wheels where it is taken to act."""
    now = Now(T, 1.0 + T, 0.1 * T, 0.5 * T, T, 0.3 * T, 0.2 * T, 0.1 * T)
    signal = (0.3 * T, 0.2 * T)
    for channel in catalogue()[name].signals:
        written, other = (transform_signal(p, channel, signal, now, 0.01)
                          for p in both(name, (0.3,) * 6))
        assert not np.array_equal(written[0], signal[0])
        assert np.array_equal(written, other)


@pytest.mark.parametrize("name", FORCE_EFFECTS)
def test_without_a_departure_the_force_is_as_written(name):
    state = (0.3, 1.4, 0.2, 0.9, 0.5, -0.2, 0.0, math.cos(0.1), math.sin(0.1))
    plain = np.array(make_dynamic(PAPER)(*state))
    written, other = (np.array(make_dynamic(p)(*state)) for p in both(name))
    assert np.allclose(written, other, rtol=0.0, atol=1e-15)
    moved = np.array(make_dynamic(both(name, (0.3,) * 6)[1])(*state))
    assert not np.array_equal(written, plain)
    assert not np.allclose(moved, written, rtol=0.0, atol=1e-9)
