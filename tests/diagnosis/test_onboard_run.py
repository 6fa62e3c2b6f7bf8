"""Our own runs, which never have motion capture: driven in the simulator, read from MCAP."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.car.runs import read_run
from dart_hal.core.config.model import parse_model
from dart_hal.core.config.write import dump
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.load import find_model, vehicle_of
from dart_lab.diagnosis.inputs import check_inputs
from dart_lab.diagnosis.run import diagnose
from dart_lab.diagnosis.write import extended_model
from dart_lab.identification.battery import find_mean_voltage
from dart_lab.identification.evidence.noise import estimate_noise
from dart_lab.identification.evidence.onboard import OnboardEvidence
from dart_lab.identification.evidence.onboard_drive import count_windows, prepare_stretches
from dart_lab.sim.battery import NOMINAL_VOLTAGE
from dart_lab.sim.hidden import NOMINAL_VEHICLE
from dart_lab.sim.servo import HORN_RAD_PER_US, ServoParams
from studies.diagnosis import any_car

RUN_SECONDS = 40.0
SERVO = ServoParams()
ANGLE_UNIT = SERVO.span_us * HORN_RAD_PER_US / SERVO.rate  # s for a command of 1
HALF_FRAME = 0.01  # s; the mean wait for a PWM frame of 50 Hz
EXACT = apply(replace(NOMINAL_VEHICLE, delay=replace(NOMINAL_VEHICLE.delay,
                                                     steering_s=HALF_FRAME)),
              "steering_rate_limit", k=ANGLE_UNIT)
"""The simulated car of no seed, by the equations of the models."""


def drive(path, effect, options="", seconds=RUN_SECONDS):
    url = "sim://?nano=mock" + (f"&effect={effect}" if effect else "") + options
    any_car.drive(url, path, seconds, np.random.default_rng(5), held=2.5)
    return read_run(path)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return drive(tmp_path_factory.mktemp("runs") / "plain.mcap", "")


def evidence(recording):
    return OnboardEvidence(prepare_stretches(recording), EXACT.body.l_r)


@pytest.mark.slow
def test_the_model_of_the_simulated_car_predicts_its_run(run):
    of_run = evidence(run)
    windows, _, rest = count_windows(of_run.drives)
    assert windows > 30
    assert rest > 20
    r = of_run.residuals(EXACT)
    encoder, gyro = (np.sqrt(np.mean(r.motion[:, k::2]**2)) for k in (0, 1))
    assert encoder < 0.006
    assert gyro < 0.04
    still = np.concatenate([d.at_rest for d in of_run.drives])
    assert np.abs(r.sensors[still, 1]).mean() < 2e-3
    wrong = of_run.residuals(apply(EXACT, "motor_gain", k=-0.03))
    assert np.sqrt(np.mean(wrong.motion[:, 0::2]**2)) > 2.0 * encoder
    late = of_run.residuals(apply(EXACT, "steering_delay", k=0.02))
    assert np.sqrt(np.mean(late.motion[:, 1::2]**2)) > 1.5 * gyro


@pytest.mark.slow
def test_every_residual_of_a_run_has_a_size(run):
    of_run = evidence(run)
    noise = estimate_noise(of_run.residuals(EXACT), of_run.blocks())
    assert np.isfinite(noise.motion).all()
    assert (noise.sensors > 1e-5).all()
    assert (noise.weight > 0.0).all()


@pytest.mark.parametrize("effect", [
    "", pytest.param("motor_gain:-0.08", marks=pytest.mark.long)])
@pytest.mark.slow
def test_a_run_is_diagnosed(run, tmp_path, effect):
    recording = drive(tmp_path / "hidden.mcap", effect) if effect else run
    file, _ = find_model("paper")
    sides = check_inputs([recording], [], EXACT)
    only = ("motor_gain", "rolling_resistance", "gyro_scale", "encoder_scale")
    found = diagnose(file, EXACT, sides.train, sides.test, refit=False, only=only)
    assert [c.effect for c in found.causes] == [effect.split(":")[0]] * bool(effect)


@pytest.fixture(scope="module")
def drives_of_two_packs(tmp_path_factory):
    """Two runs that begin at 8.3 and 7.1 V: the force of the motor is proportional to the voltage.

    Each pack sags by 0.3 V with the current and as it empties.
    """
    folder = tmp_path_factory.mktemp("packs")
    return [drive(folder / f"{charge}.mcap", "battery_fade:-0.1",
                  f"&battery=charge={charge},capacity=1,resistance=0.05", 45.0)
            for charge in (1.0, 0.3)]


def find_fade(recordings, p):
    """Return (diagnosis, size of each cause by its name)."""
    sides = check_inputs(recordings, [], p)
    found = diagnose(find_model("paper")[0], p, sides.train, sides.test, refit=False,
                     only=("battery_fade", "motor_gain", "rolling_resistance"))
    return found, {c.effect: c.parameters["k"] for c in found.causes}


@pytest.mark.parametrize("motor_voltage", [
    NOMINAL_VOLTAGE, pytest.param(None, marks=pytest.mark.long)])
@pytest.mark.slow
def test_one_fade_explains_packs_of_different_charge(drives_of_two_packs, motor_voltage):
    found, causes = find_fade(drives_of_two_packs, replace(EXACT, motor_voltage=motor_voltage))
    assert list(causes) == ["battery_fade"]
    assert abs(causes["battery_fade"].value + 0.1) < 2.0 * causes["battery_fade"].std < 0.03
    # A model without a reference gets the mean of its recordings.
    assert found.extended.motor_voltage == (motor_voltage
                                            or find_mean_voltage(drives_of_two_packs))
    assert f"less voltage than {found.extended.motor_voltage:g} V" in found.notes[-1]
    written = extended_model(found, find_model("paper")[0], drives_of_two_packs)
    assert vehicle_of(parse_model(dump(written), "model.toml")).motor_voltage == (
        found.extended.motor_voltage)


def relate_to_first_voltage(recording):
    """Return the recording as if its pack had begun at the voltage of the motor."""
    b = recording.battery
    return replace(recording, battery=replace(
        b, voltage=b.voltage * NOMINAL_VOLTAGE / np.median(b.voltage[:4])))


@pytest.mark.parametrize("without_level", [
    relate_to_first_voltage,
    pytest.param(lambda recording: replace(recording, battery=None), marks=pytest.mark.long)])
@pytest.mark.slow
def test_control_without_the_level_of_the_voltage_the_fade_is_missed(drives_of_two_packs,
                                                                     without_level):
    _, causes = find_fade([without_level(r) for r in drives_of_two_packs],
                          replace(EXACT, motor_voltage=NOMINAL_VOLTAGE))
    k = causes.get("battery_fade")
    assert k is None or abs(k.value + 0.1) > 2.0 * k.std
