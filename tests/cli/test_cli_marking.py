"""``sim --reveal --against``: measured values are marked by the truth of the simulated car."""

from __future__ import annotations

import msgspec
import pytest

from dart_hal.calibration.encoder import calibrate_encoder
from dart_hal.calibration.measured import write
from dart_hal.car import Car
from dart_hal.core.config import (
    Calibration,
    EffectEntry,
    Quantity,
    calibration_in,
    save_calibration,
    save_model,
)
from dart_hal.core.config.calibration import ImuCalibration, SteeringCalibration
from dart_hal.core.errors import UsageError
from dart_hal.core.url import Url
from dart_hal.devices.links.base import open_backend
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.file import model_of
from dart_lab.sim.marking import format_marks, mark_car
from dart_lab.sim.truth import reveal_url

SEED_7 = "sim://?nano=mock&seed=7"


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """Folder of cars in which the encoder of a hidden car was calibrated."""
    cars = tmp_path_factory.mktemp("cars")
    backend = open_backend(SEED_7)
    with Car.over(backend, cars=cars) as car:
        write(car.files, calibrate_encoder(car, backend.workshop))
    return cars


def marks(url, cars):
    return {f"{m.group}.{m.name.partition(',')[0]}": m
            for m in mark_car(Url.parse(url), [cars]).marks}


def falsify(cars, target, change):
    """Save the calibration of a folder of cars in another one, with changed quantities."""
    saved = calibration_in(cars / "sim-7", "sim-7")
    save_calibration(saved.with_quantities(change(saved)), target / "sim-7")
    return target


@pytest.mark.slow
def test_a_calibrated_car_is_inside(calibrated):
    found = marks(SEED_7, calibrated)
    assert set(found) == {"encoder.metres_per_edge", "encoder.ring"}
    assert all(mark.inside for mark in found.values())
    assert found["encoder.metres_per_edge"].unit == "m"


@pytest.mark.slow
def test_a_falsified_calibration_is_outside(calibrated, tmp_path):
    """Negative control: one number is wrong, the other one is still inside."""
    def move(saved):
        q = saved.encoder.metres_per_edge
        return {"encoder.metres_per_edge": msgspec.structs.replace(q, value=q.value + 4.0 * q.std)}

    found = marks(SEED_7, falsify(calibrated, tmp_path, move))
    assert not found["encoder.metres_per_edge"].inside
    assert found["encoder.ring"].inside


@pytest.mark.slow
def test_one_wrong_interval_of_a_ring_is_outside(calibrated, tmp_path):
    def move(saved):
        ring = saved.encoder.ring
        values = list(ring.value)
        values[3] += 1e-3
        values[9] -= 1e-3
        return {"encoder.ring": msgspec.structs.replace(ring, value=tuple(values))}

    ring = marks(SEED_7, falsify(calibrated, tmp_path, move))["encoder.ring"]
    assert not ring.inside
    assert "interval 4" in ring.name or "interval 10" in ring.name


@pytest.mark.slow
def test_the_sheet_has_one_line_for_each_quantity_and_a_count(verb, calibrated, tmp_path):
    done = verb("sim", "--reveal", "--url", SEED_7, "--against", calibrated)
    lines = done.out.splitlines()
    assert lines[0] == "encoder"
    assert lines[1].split()[0] == "metres_per_edge"
    assert lines[1].endswith("inside")
    assert " m " in lines[1]
    assert lines[-1].startswith("sim-7: 2 of 2 truths inside")
    answer = verb("sim", "--reveal", "--url", SEED_7, "--against", calibrated, "--json").json
    assert (answer["car"], answer["inside"], answer["count"]) == ("sim-7", 2, 2)
    assert answer["marks"][0]["low"] < answer["marks"][0]["true"] < answer["marks"][0]["high"]


def test_effects_are_marked_by_name_and_size(tmp_path):
    url = "sim://?nano=mock&effect=steering_lag:0.12,motor_gain:-0.1"
    model = msgspec.structs.replace(model_of(PAPER), effects=(
        EffectEntry("steering_lag", {"k": Quantity(0.118, 0.002)}),
        EffectEntry("quadratic_drag", {"k": Quantity(0.1, 0.02)})))
    save_model(model, tmp_path / "sim-0" / "model.toml")
    found = marks(url, tmp_path)
    assert found["effect.steering_lag.k"].inside
    assert not found["effect.motor_gain.k"].inside      # not found
    assert not found["effect.quadratic_drag.k"].inside  # not there
    text = "\n".join(format_marks(mark_car(Url.parse(url), [tmp_path])))
    assert "not found" in text
    assert "not there" in text
    assert "1 of 3 truths" in text


def test_fitted_mountings_of_a_diagnosis_are_not_marked(tmp_path):
    """A diagnosis writes the mounting of the IMU as effects, but lists its causes by name."""
    model = msgspec.structs.replace(model_of(PAPER), provenance={"causes": ["quadratic_drag"]},
                                    effects=(
        EffectEntry("imu_yaw", {"k": Quantity(0.05, 0.001)}),
        EffectEntry("quadratic_drag", {"k": Quantity(0.1, 0.02)})))
    save_model(model, tmp_path / "sim-0" / "model.toml")
    found = marks("sim://?nano=mock", tmp_path)
    assert set(found) == {"effect.quadratic_drag.k"}


def test_what_an_effect_changes_is_not_marked(tmp_path):
    saved = Calibration(car="sim-0", imu=ImuCalibration(gyro_bias=Quantity(0.0, 1e-4)),
                        steering=SteeringCalibration(backlash=Quantity(0.0, 1e-4)))
    save_calibration(saved, tmp_path / "sim-0")
    sheet = mark_car(Url.parse("sim://?effect=steering_backlash:0.1"), [tmp_path])
    assert [mark.name for mark in sheet.marks] == ["gyro_bias"]
    assert sheet.unmarked == ("steering.backlash",)


def test_a_car_without_measurements_is_refused(tmp_path):
    with pytest.raises(UsageError, match="nothing was measured on sim-7"):
        mark_car(Url.parse(SEED_7), [tmp_path])


def test_marking_needs_reveal(verb, tmp_path):
    refused = verb("sim", "--pty", "--against", tmp_path, "--json").error
    assert "--reveal" in refused["what"] + str(refused["found"]) + refused["try"]


def write_model(cars, car="sim-7", **sections):
    """Save a model with these quantities as the model of a car."""
    model = model_of(PAPER)
    for section, entries in sections.items():
        model = msgspec.structs.replace(
            model, **{section: {**getattr(model, section), **entries}})
    save_model(model, cars / car / "model.toml")


def test_parameters_of_a_model_are_marked_as_a_fit_sees_them(tmp_path):
    """Throttle is the pulse of car.toml, and a command waits for a PWM frame."""
    truth = reveal_url(Url.parse(SEED_7))
    motor = {name: entry["value"] for name, entry in truth["vehicle"]["motor"].items()}
    scale = 450.0 / truth["sensors"]["throttle.saturation_us"]
    offset = (1500.0 - truth["sensors"]["throttle.neutral_us"]) / 450.0
    delay = truth["vehicle"]["delay"]["steering_s"]["value"] + 0.0119
    write_model(tmp_path,
                motor={"d": Quantity(motor["d"] * scale, 1e-3), "e": Quantity(motor["e"], 1e-3),
                       "g": Quantity(motor["g"] / scale + offset, 1e-4)},
                delay={"steering_s": Quantity(delay, 1e-3), "steering_lag_s": Quantity(0.03, 0.1)})
    found = marks(SEED_7, tmp_path)
    # A parameter without a standard error was not measured; a lag has no true counterpart.
    assert set(found) == {"model.motor.d", "model.motor.e", "model.motor.g",
                          "model.delay.steering_s"}
    assert found["model.motor.d"].inside
    assert found["model.motor.g"].inside
    assert found["model.delay.steering_s"].inside
    assert not found["model.motor.e"].inside  # negative control: without the scale
    assert found["model.motor.d"].unit == "N"


def test_parameters_that_an_effect_changes_are_not_marked(tmp_path):
    steering = {"s0": Quantity(0.0, 1.0)}
    motor = {"d": Quantity(20.0, 1.0)}
    write_model(tmp_path, "sim-0", motor=motor, steering=steering)

    def list_marked(effect):
        sheet = mark_car(Url.parse(f"sim://?nano=mock{effect}"), [tmp_path])
        return {mark.name for mark in sheet.marks if mark.group == "model"}, set(sheet.unmarked)

    assert list_marked("") == ({"motor.d", "steering.s0"}, set())
    assert list_marked("&effect=battery_fade:-0.3") == ({"steering.s0"}, {"model.motor.d"})
    assert list_marked("&effect=steering_backlash:0.1") == ({"motor.d"}, {"model.steering.s0"})
    assert list_marked("&effect=motor_gain:-0.1") == ({"steering.s0"}, {"model.motor.d"})
    assert list_marked("&effect=lateral_pull:0.05") == (
        set(), {"model.motor.d", "model.steering.s0"})


@pytest.mark.long
def test_a_fit_of_a_hidden_car_is_inside(verb):
    url = "sim://?nano=mock&physics=kinematic&tick=10&seed=7"
    verb("experiment", "motor", "--url", url, "--space", "12x3", "--yes", "--cars", "cars",
         "--out-model", "cars/sim-7/model.toml")
    found = [m for m in mark_car(Url.parse(url), ["cars"]).marks if m.group == "model"]
    assert {mark.name for mark in found} == {"body.mass", "motor.d", "motor.e", "motor.g"}
    for mark in found:  # three standard errors: one in 400 by chance
        half = 3.0 / 1.645 * (mark.high - mark.measured)
        assert abs(mark.true - mark.measured) < half, mark
