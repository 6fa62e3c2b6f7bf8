"""Every effect gives what its equation gives, on every engine that carries it."""

from __future__ import annotations

from itertools import groupby

import numpy as np
import pytest

from dart_hal.vehicle.effects import catalogue
from dart_hal.vehicle.native.build import cache_folder, compiler
from tests.vehicle.effects.law_engines import (
    channels_of,
    check_effect,
    evaluate_forces_compiled,
    evaluate_forces_of_casadi,
    evaluate_forces_of_symbols,
    evaluate_forces_together,
    evaluate_parameters_in_lanes,
    evaluate_parameters_of_symbols,
    evaluate_series_in_lanes,
    expected_forces,
    expected_parameters,
    find_failures,
    force_effects,
    laws_of,
)
from tests.vehicle.effects.laws import FORCE_LAWS

each_effect = pytest.mark.parametrize("effect", catalogue().values(), ids=catalogue())
each_force = pytest.mark.parametrize("effect", force_effects(), ids=lambda effect: effect.name)


def test_every_hook_of_every_effect_has_a_law():
    for effect in catalogue().values():
        assert bool(laws_of(effect.name, "force")) == (effect.force is not None), effect.name
        assert bool(laws_of(effect.name, "vehicle")) == (effect.vehicle is not None), effect.name
        assert channels_of(effect.name) == set(effect.signals), effect.name


@each_effect
def test_effect_satisfies_its_equation(effect):
    """Over floats, arrays with a value for each car, symbols, whole series and single steps."""
    failures = check_effect(effect)
    for _, same in groupby(laws_of(effect.name, "force"), key=lambda law: law.car):
        laws = list(same)
        for law, together in zip(laws, evaluate_forces_together(effect, laws), strict=True):
            expected = expected_forces(law)
            failures += find_failures(expected, together, "arrays")
            failures += find_failures(expected, evaluate_forces_of_symbols(effect, law), "symbols")
    for law in laws_of(effect.name, "signals"):
        series, change = evaluate_series_in_lanes(effect, law)
        failures += find_failures(law, series, "arrays")
        assert change == 0.0, "the car at the null does not change"
    for law in laws_of(effect.name, "vehicle"):
        expected = expected_parameters(law)
        failures += find_failures(expected, evaluate_parameters_in_lanes(effect, law), "arrays")
        failures += find_failures(expected, evaluate_parameters_of_symbols(effect, law), "symbols")
    assert failures == []


@each_force
def test_casadi_satisfies_the_equation_and_can_differentiate_it(effect):
    casadi = pytest.importorskip("casadi")
    failures = []
    for law in laws_of(effect.name, "force"):
        got, slope = evaluate_forces_of_casadi(effect, law, casadi)
        failures += find_failures(expected_forces(law), got, "casadi")
        assert np.isfinite(slope).all(), "an optimiser needs the slope, at rest as well"
    assert failures == []


@pytest.mark.skipif(not compiler(), reason="no C compiler")
@pytest.mark.parametrize("car", sorted({law.car for law in FORCE_LAWS}))
def test_the_compiled_kernel_satisfies_the_equations(car):
    laws = [law for law in FORCE_LAWS if law.car == car]
    failures = []
    for law, got in zip(laws, evaluate_forces_compiled(force_effects(), laws, cache_folder()),
                        strict=True):
        failures += find_failures(expected_forces(law), got, "compiled")
    assert failures == []
