"""Standard errors include the models that the data do not order."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.flat import value
from dart_lab.diagnosis.alternatives import (
    MAX_ALTERNATIVES,
    Exchange,
    include_alternatives,
    list_exchanges,
)
from dart_lab.diagnosis.final_fit import FinalFit
from dart_lab.diagnosis.policy import USUAL
from dart_lab.diagnosis.search.forward import ForwardSearch
from dart_lab.diagnosis.search.selection import Settings, label_point_rows
from dart_lab.identification.evidence.space import MessageTiming
from dart_lab.identification.objective import covariance
from tests.diagnosis.searched import drive, evidence

FREE_PARAMETERS = ("tyres.front_D", "tyres.rear_cornering_stiffness")


def test_models_that_move_the_car_similarly_are_listed_nearest_first():
    found = list_exchanges({"steering_lag": ("steering_delay", "gyro_latency")}, ["yaw_damping"],
                           ["grip", "gyro_scale"])
    assert found == (Exchange("steering_lag", "steering_delay"), Exchange("yaw_damping"),
                     Exchange(added="grip"))
    many = list_exchanges({}, [], ["grip", "front_grip", "mass", "yaw_inertia", "motor_gain",
                                   "quadratic_drag", "rolling_resistance"])
    assert len(many) == MAX_ALTERNATIVES


@pytest.fixture(scope="module")
def fitted_search():
    """(search, evidence, fit) of a car with yaw damping."""
    of_drive = evidence(drive(("yaw_damping", 0.02), seconds=40.0))
    search = ForwardSearch(of_drive, PAPER, Settings(free=FREE_PARAMETERS))
    vehicle = apply(PAPER, "yaw_damping", k=0.01)
    point, _ = search._fit_and_measure_noise(search.make_space(vehicle),
                                             MessageTiming(of_drive.message_age))
    sampling = covariance(point, label_point_rows(of_drive, point).block)
    stds = point.space.standard_errors(point.x, sampling)
    return search, of_drive, FinalFit(point.vehicle, point.timing, point, sampling, stds)


@pytest.mark.slow
def test_error_holds_the_number_of_the_other_model(fitted_search):
    search, of_drive, final = fitted_search
    wide = include_alternatives(final, (Exchange("yaw_damping"),), search, of_drive, USUAL.scan)
    other, _ = search._fit_and_measure_noise(search.make_space(PAPER),
                                             MessageTiming(of_drive.message_age))
    for name in FREE_PARAMETERS:
        away = abs(value(other.vehicle, name) - value(final.vehicle, name))
        expected = np.hypot(final.stds[name], away / np.sqrt(2.0))
        assert wide.stds[name] == pytest.approx(expected, rel=0.2)
    assert wide.stds["yaw_damping.k"] == pytest.approx(final.stds["yaw_damping.k"])
    assert max(wide.stds[n] / final.stds[n]
               for n in FREE_PARAMETERS) > 1.5, "else nothing is tested"
    assert wide.vehicle is final.vehicle


@pytest.mark.slow
def test_model_with_another_effect_is_fitted(fitted_search):
    search, of_drive, final = fitted_search
    wide = include_alternatives(final, (Exchange("yaw_damping", "front_grip"),), search, of_drive,
                                USUAL.scan)
    assert wide.stds["tyres.rear_cornering_stiffness"] > final.stds[
        "tyres.rear_cornering_stiffness"]


@pytest.mark.slow
def test_without_other_models_errors_are_those_of_the_fit(fitted_search):
    search, of_drive, final = fitted_search
    assert include_alternatives(final, (), search, of_drive, USUAL.scan) is final
    missing = (Exchange("grip", "mass"), Exchange(added="yaw_damping"))
    assert include_alternatives(final, missing, search, of_drive, USUAL.scan) is final
