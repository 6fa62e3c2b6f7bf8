"""The procedure on a bench car: truth inside its intervals, and a reason when it fails."""

from __future__ import annotations

import json

import numpy as np
import pytest

from dart_hal.calibration.steering import calibrate_steering, plan
from dart_hal.core.config import Quantity, load_car, save_calibration
from dart_hal.core.errors import CalibrationFailed
from dart_hal.devices.actuation.quantiser import count_us, prescale_for

pytestmark = pytest.mark.usefixtures("armed_esc")
SLEW = Quantity(3800.0, 50.0)

@pytest.mark.slow
def test_finds_map_and_backlash_of_hidden_cars(drawn):
    inside, rms, backlash, reach = [], [], [], []
    for seed in range(20):
        car = drawn(seed)
        result = calibrate_steering(car, dry_run=True)
        error = result.angle - car.true_angle(result.command)
        inside += list(np.abs(error) < 1.645 * result.angle_std)
        rms.append(np.degrees(np.sqrt(np.mean(error**2))))
        backlash.append((result.backlash.value - car.backlash) / result.backlash.std)
        reach.append(car.max_distance)
    assert 0.80 <= np.mean(inside) <= 0.98
    assert max(rms) <= 0.4
    assert np.mean(np.abs(backlash) < 1.645) >= 0.8
    assert np.mean(np.array(reach) < plan(car.files).radius) >= 0.9


@pytest.mark.slow
def test_time_speed_and_pulses_keep_to_the_plan(bench, files):
    car = bench()
    route = plan(files)
    calibrate_steering(car, dry_run=True)
    assert car.t <= min(route.time + 5.0, 120.0)
    assert car.max_speed <= 1.15 * route.speed
    ticks = np.array(car.pulses_sent) / count_us(prescale_for(50.0), 25e6)
    assert ticks == pytest.approx(np.round(ticks), abs=1e-6)


@pytest.mark.slow
def test_slip_is_removed(bench):
    slipping = calibrate_steering(bench(kappa=0.08), dry_run=True)
    error = slipping.angle - bench().true_angle(slipping.command)
    assert np.degrees(np.abs(error)).max() < 0.1
    at_speed = np.arctan(np.tan(slipping.angle) / (1.0 + 0.08 * 0.55**2))
    assert np.degrees(np.abs(at_speed - slipping.angle)).max() > 0.35  # what slip would have cost
    assert slipping.extra["understeer"]["value"] == pytest.approx(0.08, abs=0.015)


@pytest.mark.slow
def test_dry_run_writes_nothing(bench, files):
    result = calibrate_steering(bench(), dry_run=True)
    assert result.written is None
    assert not (files.folder / "calibration.toml").exists()


@pytest.mark.slow
def test_written_file_is_read_back_and_the_old_one_kept(bench, files, car_toml):
    files.folder.mkdir(parents=True, exist_ok=True)
    (files.folder / "car.toml").write_text(car_toml)
    first = calibrate_steering(bench())
    known = load_car(files.config.name, [files.folder.parent]).calibration
    save_calibration(known.with_quantities({"steering.slew_us_s": SLEW}), files.folder)
    second = calibrate_steering(bench(backlash=0.03, seed=1))
    again = load_car(files.config.name, [files.folder.parent]).calibration
    table = again.steering.map
    assert table.angle_rad == pytest.approx(second.angle, abs=1e-6)
    assert table.std_rad == pytest.approx(second.angle_std, abs=1e-6)
    assert again.steering.backlash.value == pytest.approx(0.03, abs=0.003)
    assert again.steering.slew_us_s == SLEW  # another procedure's
    assert again.provenance["when"].tzinfo is not None
    assert first.written == second.written == str(files.folder / "calibration.toml")
    assert len(list((files.folder / "history").iterdir())) == 2


@pytest.mark.slow
def test_json_is_the_contract(bench):
    data = json.loads(json.dumps(calibrate_steering(bench(), dry_run=True).to_json(),
                                 allow_nan=False))
    assert data["map"]["command"][0] == -1.0
    assert data["map"]["command"][-1] == 1.0
    assert len(data["map"]["pulse_us"]) == len(data["map"]["angle_rad"]) >= 9
    assert data["backlash_rad"]["value"] == pytest.approx(0.015, abs=0.002)


@pytest.mark.slow
def test_progress_rises_and_is_the_only_output(bench, capsys):
    calls = []
    calibrate_steering(bench(), dry_run=True, progress=lambda f, text: calls.append((f, text)))
    shares = [f for f, _ in calls]
    assert shares == sorted(shares)
    assert 0.0 <= shares[0] < shares[-1] <= 1.0
    assert all(text for _, text in calls)
    assert capsys.readouterr() == ("", "")


def test_nothing_moves_without_consent(bench):
    car = bench()
    questions = []

    def refuse(question: str) -> bool:
        questions.append(question)
        return False

    with pytest.raises(CalibrationFailed, match="not agreed") as caught:
        calibrate_steering(car, ask=refuse)
    assert "--yes" in caught.value.remedy
    assert "clear the floor" not in str(caught.value)
    assert car.t == 0.0
    assert "m/s" in questions[0]
    assert "floor" in questions[0]


@pytest.mark.slow
def test_notes_hold_what_raw_mode_did_not_ask_for(bench):
    clock = "PWM clock of this car was never measured"
    known = calibrate_steering(bench(), dry_run=True)
    assert not any("waived" in note for note in known.notes)
    unknown = calibrate_steering(bench(refused=("PWM_CLOCK_UNCALIBRATED", "LINK_NOT_GOOD_500MS")),
                                 dry_run=True)
    assert sum("waived" in note for note in unknown.notes) == 1
    assert any(clock in note and "PWM_CLOCK_UNCALIBRATED" in note for note in unknown.notes)


@pytest.mark.slow
def test_ctrl_c_stops_the_car(bench, files):
    car = bench(interrupt_at=15.0)
    with pytest.raises(KeyboardInterrupt):
        calibrate_steering(car)
    assert car.stops == 1
    assert car.applied.throttle_us == 1500.0
    assert not (files.folder / "calibration.toml").exists()


@pytest.mark.parametrize(("fault", "words"), [
    ({"encoder": "dead"}, ("encoder does not count",)),
    ({"esc": "off"}, ("does not move", "ESC")),
    ({"ground": False}, ("does not turn", "off the ground")),
    ({"gyro_sign": -1.0}, ("to the right gives a yaw rate to the left", "upside down")),
    ({"imu": False}, ("no yaw rate at standstill", "IMU")),
    ({"gyro_bias": 0.3}, ("gyro turns while the car is at rest",)),
    ({"push": 1.9}, ("rolls at a neutral throttle",)),
])
def test_faults_are_named(bench, fault, words):
    car = bench(**fault)
    with pytest.raises(CalibrationFailed) as caught:
        calibrate_steering(car)
    for word in words:
        assert word in str(caught.value)
    assert car.stops == 1
    assert car.t < 20.0
