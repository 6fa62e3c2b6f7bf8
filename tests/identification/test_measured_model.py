"""Identification and diagnosis of a car begin at its calibration."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime, timedelta, timezone

import msgspec
import numpy as np
import pytest

from dart_hal.car import Car
from dart_hal.core.config import (
    Calibration,
    EffectEntry,
    Quantity,
    plain,
    save_calibration,
    save_model,
)
from dart_hal.core.config.calibration import (
    LatencyCalibration,
    SteeringCalibration,
    SteeringTable,
    ThrottleCalibration,
)
from dart_hal.core.errors import UsageError
from dart_hal.vehicle import PAPER, make_steering
from dart_hal.vehicle.load import find_model, vehicle_of
from dart_hal.vehicle.parameters import Steering
from dart_lab.identification.measured import default_model, measured_model, named_model

WHEN = datetime(2026, 11, 1, tzinfo=timezone.utc)
TRUE = Steering(k_left=1.5, a_left_rad=0.33, s0=-0.03, a_right_rad=0.39, k_right=1.8)
STD = 0.0008  # rad


def calibration(car, direction=1, when=WHEN, std=STD, steering=TRUE):
    """All that a model has a place for, without an error of measurement."""
    pulse = np.linspace(1125.0, 1875.0, 13)
    angle = make_steering(steering, np)(direction * (pulse - 1500.0) / 375.0)
    return Calibration(
        car=car, provenance={"when": when},
        steering=SteeringCalibration(
            map=SteeringTable(pulse_us=tuple(pulse.tolist()), angle_rad=tuple(angle.tolist()),
                              std_rad=(std,) * 13),
            backlash=Quantity(0.02, 0.0004), slew_us_s=Quantity(3750.0, 75.0)),
        throttle=ThrottleCalibration(deadband_forward_us=Quantity(67.5, 0.1)),
        latency=LatencyCalibration(
            command_to_pulse=Quantity(0.012, 0.0006), pulse_to_yaw=Quantity(0.006, 0.0008),
            pulse_to_yaw_lag=Quantity(0.0, 0.005), pulse_to_wheel=Quantity(-0.001, 0.001),
            pulse_to_wheel_lag=Quantity(0.02, 0.004)))


@pytest.fixture
def recorded(tmp_path):
    """run(seed, calibration) -> path of a moment of a car that was calibrated like this, or not."""
    def run(seed, car_file=None):
        cars = tmp_path / f"cars-{len(list(tmp_path.iterdir()))}"
        if car_file is not None:
            save_calibration(car_file, cars / car_file.car)
        path = cars.with_suffix(".mcap")
        with Car.open(f"sim://?nano=mock&seed={seed}", cars=cars, record=path) as car:
            for _ in car.states(duration=0.05):
                pass
        return path

    return run


def test_what_was_measured_is_in_the_model_with_its_error(recorded, tmp_path):
    model, p = named_model("measured", [recorded(7, calibration("sim-7"))])
    assert model.name == "sim-7"
    for key, true in (("k_left", 1.5), ("a_left_rad", 0.33), ("s0", -0.03), ("a_right_rad", 0.39),
                      ("k_right", 1.8)):
        assert getattr(p.steering, key) == pytest.approx(true, abs=2e-3)
        assert 0.0 < model.steering[key].std < 0.05 * max(abs(true), 0.1)
    assert plain(model.delay["steering_s"]) == pytest.approx(0.018)
    assert model.delay["steering_s"].std == pytest.approx(0.001)
    assert model.delay["throttle_s"].value == pytest.approx(0.011)
    assert model.delay["throttle_lag_s"] == Quantity(0.02, 0.004, "calibration")
    assert model.delay["steering_lag_s"] == Quantity(0.0, 0.005, "calibration"), "none is known too"
    assert model.motor["g"].value == pytest.approx(-0.15)
    assert model.motor["g"].std > 0.1 / 450.0, "what dithering holds is known no better"
    assert plain(model.motor["d"]) == model.motor["d"] == PAPER.motor.d, "it was not measured"
    assert model.effects == (
        EffectEntry("steering_backlash", {"k": Quantity(0.02, 0.0004, "calibration")}),
        EffectEntry("steering_rate_limit", {"k": Quantity(0.1, 0.002, "calibration")}))
    save_model(model, tmp_path / "model.toml")
    assert find_model(tmp_path / "model.toml")[1] == p


@pytest.mark.slow
def test_errors_of_the_map_go_into_those_of_its_form(recorded):
    car_file = calibration("sim-7")
    with_twice = calibration("sim-7", std=2 * STD)
    once, twice = (named_model("measured", [recorded(7, c)])[0].steering for c in (car_file,
                                                                                   with_twice))
    assert twice["a_left_rad"].std == pytest.approx(2.0 * once["a_left_rad"].std, rel=0.05)
    zigzag = np.array(car_file.steering.map.angle_rad) + 0.003 * (-1.0) ** np.arange(13)
    zigzag_map = msgspec.structs.replace(car_file.steering.map, angle_rad=tuple(zigzag.tolist()))
    strange = msgspec.structs.replace(car_file, steering=msgspec.structs.replace(car_file.steering,
                                                                                 map=zigzag_map))
    assert named_model("measured", [recorded(7, strange)])[0].steering["a_left_rad"].std > (
        2.0 * once["a_left_rad"].std), "what the form cannot follow is an error of the form"


def test_a_servo_the_other_way_round_has_the_same_map(recorded):
    with Car.open("sim://?nano=mock") as car:
        files = car.files
    there, back = (replace(files, calibration=calibration("sim-0", direction), config=(
        msgspec.structs.replace(files.config, steering=msgspec.structs.replace(
            files.config.steering, direction=direction)))) for direction in (1, -1))
    for a, b in zip(*(measured_model(f).values("steering").values() for f in (there, back)),
                    strict=True):
        assert a == pytest.approx(b, abs=1e-9)


@pytest.mark.slow
def test_the_newest_of_several_calibrations_counts(recorded):
    other = replace(TRUE, a_left_rad=0.3)
    runs = [recorded(7, calibration("sim-7", when=WHEN + timedelta(days=1), steering=other)),
            recorded(7, calibration("sim-7")), recorded(7)]
    assert named_model("measured", runs)[1].steering.a_left_rad == pytest.approx(0.3, abs=2e-3)


def test_size_and_mass_are_those_of_the_car(recorded):
    with Car.open("sim://?nano=mock") as car:
        files = car.files
    heavy = msgspec.structs.replace(files.config.geometry, mass=2.0, yaw_inertia=None)
    p = vehicle_of(measured_model(replace(files, calibration=None, config=msgspec.structs.replace(
        files.config, geometry=heavy))))
    assert p.body.mass == 2.0
    assert p.body.yaw_inertia == pytest.approx(PAPER.body.yaw_inertia * 2.0 / PAPER.body.mass)
    assert (p.steering, p.effects) == (PAPER.steering, ()), "it was not measured"


@pytest.mark.slow
def test_without_a_calibration_there_is_nothing_to_start_from(recorded, tmp_path):
    csv = tmp_path / "a.csv"
    csv.write_text("")
    with pytest.raises(UsageError, match="no calibration of this car") as refused:
        named_model("measured", [recorded(7), csv])
    assert "1 run" in refused.value.found
    assert "calibrate all" in refused.value.remedy


def test_cars_are_measured_one_by_one(recorded):
    with pytest.raises(UsageError, match="several cars") as refused:
        named_model("measured", [recorded(7, calibration("sim-7")),
                                 recorded(8, calibration("sim-8"))])
    assert refused.value.found == "sim-7, sim-8"


def test_any_other_name_is_that_of_a_model():
    assert named_model("paper", [])[1] == PAPER
    with pytest.raises(UsageError, match="no model"):
        named_model("measurd", [])


@pytest.mark.slow
def test_the_model_of_a_calibrated_car_is_the_default(recorded, tmp_path):
    (csv := tmp_path / "a.csv").write_text("t\n")
    (broken := tmp_path / "b.mcap").write_bytes(b"no run")
    run = recorded(7, calibration("sim-7"))
    assert default_model([run, csv, broken, tmp_path / "missing.mcap"]) == "measured"
    assert default_model([recorded(7), csv]) == "paper"
    assert default_model([run, recorded(8, calibration("sim-8"))]) == "paper"
