"""Typical sizes of effects scale with the car: the same angles and accelerations at any size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.core.errors import ConfigError
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effect import Forces
from dart_hal.vehicle.effects import activate, apply, catalogue, effect_for
from dart_hal.vehicle.flat import bounds, stack, with_values
from dart_hal.vehicle.namespace import SCALAR
from dart_hal.vehicle.scale import REFERENCE_SCALE, Scale, find_scale
from tests.diagnosis.scaled_drive import CAR_SIZES, Size

# Powers of two, so that the rounded scale is the exact one: about 1:43 and 1:1.
SIMILAR = [Size(PAPER.body.wheelbase / 4.0, PAPER.body.mass / 32.0),
           Size(PAPER.body.wheelbase * 16.0, PAPER.body.mass * 512.0)]
# Forces fade out towards standstill over a speed that is the same for all cars.
TOLERANCE = 0.04


def forces(size):
    """Forces of a fast turn with drive, of a car of that size."""
    speed = size.length / size.time
    f = size.force
    return Forces(0.3, 1.6 * speed, -0.1 * speed, 1.2 / size.time, np.cos(0.25), np.sin(0.25),
                  0.08, 0.05, 0.6 * f, 0.6 * f, 2.0 * f, 1.8 * f, 0.0, 0.0, 0.0)


def unscale(changed, size):
    """What a hook has returned, as the car of the paper has it."""
    units = dict.fromkeys(("f_xf", "f_xr", "f_yf", "f_yr", "f_x", "f_y"), size.force)
    units["m_z"] = size.force * size.length
    return [getattr(changed, name) / unit for name, unit in units.items()]


@pytest.mark.parametrize("size", SIMILAR, ids=["small", "large"])
@pytest.mark.parametrize("name", [n for n, e in catalogue().items() if e.force is not None])
def test_the_force_of_a_medium_size_is_similar(name, size):
    found = []
    for one in (Size(PAPER.body.wheelbase, PAPER.body.mass), size):
        p = one.scale(PAPER)
        effect = effect_for(p, name)
        hook = effect.force(p, SCALAR, *(q.null + q.sizes[1] for q in effect.parameters))
        found.append(unscale(hook(forces(one)), one))
    base = unscale(forces(size), size)
    change = np.subtract(found[0], base)
    assert np.abs(change).max() > 0.0
    assert found[1] == pytest.approx(found[0], abs=TOLERANCE * np.abs(change).max())


@pytest.mark.parametrize("effect", catalogue().values(), ids=lambda e: e.name)
def test_sizes_of_1_10_are_those_of_the_catalogue(effect):
    p = replace(PAPER, body=replace(PAPER.body, mass=1.3))
    assert effect_for(p, effect.name) is effect


def test_times_of_electronics_do_not_scale_and_lengths_do():
    large = CAR_SIZES["1:1"].scale(PAPER)
    for name, factor in (("steering_delay", 1.0), ("gyro_bias", 1.0), ("road_slope_x", 1.0),
                         ("encoder_slip", 1.0), ("steering_trim", 1.0),
                         ("imu_lever_arm", 16.0), ("rolling_resistance", 512.0)):
        expected = factor * np.array(catalogue()[name].parameters[0].sizes)
        assert effect_for(large, name).parameters[0].sizes == pytest.approx(expected), name


def test_bounds_are_those_of_the_car():
    large = CAR_SIZES["1:1"].scale(PAPER)
    heavy = apply(large, "rolling_resistance", k=300.0)
    assert bounds(heavy, "rolling_resistance.k") == (-512.0, 5.0 * 512.0)
    assert with_values(heavy, {"rolling_resistance.k": 400.0}).effects[0].values == (400.0,)
    with pytest.raises(ConfigError, match="out of range"):
        apply(PAPER, "rolling_resistance", k=300.0)
    with pytest.raises(ConfigError, match="out of range"):
        activate(catalogue()["rolling_resistance"], {"k": 300.0})


def test_scales_are_rounded_to_powers_of_two():
    assert find_scale(PAPER.body) == REFERENCE_SCALE
    assert find_scale(CAR_SIZES["1:43"].scale(PAPER).body) == Scale(0.25, 2.0**-5)
    assert find_scale(CAR_SIZES["1:1"].scale(PAPER).body) == Scale(16.0, 512.0)
    twice = Size(2.0 * PAPER.body.wheelbase, 2.0 * PAPER.body.mass).scale(PAPER)
    batch = stack([twice, twice, replace(twice, body=CAR_SIZES["1:1"].scale(PAPER).body)])
    assert find_scale(batch.body) == Scale(2.0, 2.0)


@pytest.mark.parametrize(("unit", "factor"), [
    ("N", 64.0), ("m", 4.0), ("s", 2.0), ("rad/s", 0.5), ("N s2/m2", 16.0), ("N m s", 512.0),
    ("1/N", 1.0 / 64.0), ("m/s2", 1.0), ("s2/m", 1.0), ("kg m2", 1024.0), ("-", 1.0)])
def test_factor_of_a_unit(unit, factor):
    assert Scale(length=4.0, force=64.0).factor(unit) == pytest.approx(factor)
