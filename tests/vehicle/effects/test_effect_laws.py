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

EVERY = pytest.mark.parametrize("of", catalogue().values(), ids=catalogue())
FORCES = pytest.mark.parametrize("of", force_effects(), ids=lambda of: of.name)


def test_every_hook_of_every_effect_has_a_law():
    for of in catalogue().values():
        assert bool(laws_of(of.name, "force")) == (of.force is not None), of.name
        assert bool(laws_of(of.name, "vehicle")) == (of.vehicle is not None), of.name
        assert channels_of(of.name) == set(of.signals), of.name


@EVERY
def test_effect_satisfies_its_equation(of):
    """Over floats, arrays with a value for each car, symbols, whole series and single steps."""
    failures = check_effect(of)
    for _, same in groupby(laws_of(of.name, "force"), key=lambda law: law.car):
        laws = list(same)
        for law, together in zip(laws, evaluate_forces_together(of, laws), strict=True):
            wanted = expected_forces(law)
            failures += find_failures(wanted, together, "arrays")
            failures += find_failures(wanted, evaluate_forces_of_symbols(of, law), "symbols")
    for law in laws_of(of.name, "signals"):
        series, change = evaluate_series_in_lanes(of, law)
        failures += find_failures(law, series, "arrays")
        assert change == 0.0, "the car at the null does not change"
    for law in laws_of(of.name, "vehicle"):
        wanted = expected_parameters(law)
        failures += find_failures(wanted, evaluate_parameters_in_lanes(of, law), "arrays")
        failures += find_failures(wanted, evaluate_parameters_of_symbols(of, law), "symbols")
    assert failures == []


@FORCES
def test_casadi_satisfies_the_equation_and_can_differentiate_it(of):
    casadi = pytest.importorskip("casadi")
    failures = []
    for law in laws_of(of.name, "force"):
        got, slope = evaluate_forces_of_casadi(of, law, casadi)
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
