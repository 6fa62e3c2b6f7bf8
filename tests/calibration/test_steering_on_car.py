"""The procedure through the whole Car, against the hidden truth of simulated cars."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from dart_hal.calibration.from_recordings import steering_from
from dart_hal.calibration.steering import calibrate_steering
from dart_hal.car import Car
from dart_hal.core.errors import RecordingError
from dart_hal.core.process.jobs import cores, each
from dart_lab.sim.truth import reveal


def measured(seed: int, tmp_path, **options):
    with Car.open(f"sim://?seed={seed}&nano=mock", cars=tmp_path) as car:
        result = calibrate_steering(car, dry_run=True, **options)
        mode = car.mode
    truth = reveal(seed)
    angle = np.interp(result.command, truth["steering"]["command"],
                      truth["steering"]["angle_rad"])
    return result, angle, truth["sensors"]["steering.backlash"], mode


@pytest.mark.slow
def test_nominal_car_has_the_papers_map(tmp_path):
    result, angle, _, mode = measured(0, tmp_path)
    assert np.degrees(np.abs(result.angle - angle)).max() < 0.12
    assert result.backlash.value < 0.001
    assert mode == "DISARMED"


@pytest.mark.parametrize("seeds", [
    pytest.param(range(1, 4), id="3 cars", marks=pytest.mark.slow),
    pytest.param(range(1, 21), id="20 cars", marks=pytest.mark.long),
    pytest.param(range(21, 41), id="20 other cars", marks=pytest.mark.long),
])
def test_hidden_cars(tmp_path, seeds):
    inside, backlash = [], []
    jobs = cores() if len(seeds) >= 20 else 1
    for result, angle, loop, _ in each(partial(measured, tmp_path=tmp_path), seeds, jobs):
        error = result.angle - angle
        assert np.degrees(np.sqrt(np.mean(error**2))) <= 0.4
        inside += list(np.abs(error) < 1.645 * result.angle_std)
        backlash.append(abs(result.backlash.value - loop) / result.backlash.std)
    assert np.mean(inside) >= 0.6  # errors of one car move together
    assert np.max(backlash) < 4.0
    if len(seeds) >= 20:
        assert np.mean(inside) >= 0.8
        assert 0.75 <= np.mean(np.array(backlash) < 1.645) <= 1.0
        assert np.mean(inside) <= 0.98


def test_papers_map_instead_of_a_measurement_would_be_off():
    """Negative control: what the cars would steer without their calibration."""
    nominal, *cars = (np.array(reveal(seed)["steering"]["angle_rad"]) for seed in range(21))
    rms = [np.degrees(np.sqrt(np.mean((car - nominal) ** 2))) for car in cars]
    assert np.mean(np.array(rms) > 0.4) > 0.8


@pytest.mark.long
def test_second_run_uses_the_file_that_the_first_one_wrote(tmp_path):
    url = "sim://?seed=3&nano=mock"
    with Car.open(url, cars=tmp_path) as car:
        first = calibrate_steering(car)
    with Car.open(url, cars=tmp_path) as car:
        table = car.files.calibration.steering.map
        assert table.angle_rad == pytest.approx(first.angle, abs=1e-6)
        second = calibrate_steering(car, dry_run=True)
    assert second.angle == pytest.approx(first.angle, abs=2e-3)


@pytest.mark.slow
def test_interrupt_stops_the_car(tmp_path):
    with Car.open("sim://?seed=1&nano=mock", cars=tmp_path) as car:
        def interrupt(share: float, text: str) -> None:
            if share > 0.3:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            calibrate_steering(car, progress=interrupt)
        assert car.mode == "DISARMED"
        rolling = [s.speed for s in car.states(duration=1.5)]
        assert rolling[0] > 0.2
        assert rolling[-1] < 0.05
    assert not list(tmp_path.rglob("calibration.toml"))


@pytest.mark.long
def test_run_of_the_procedure_gives_the_same_map_as_a_recording(tmp_path):
    """Driven, recorded, replayed: the slip and the turning points are not removed there."""
    run = tmp_path / "run.mcap"
    with Car.open("sim://?seed=4&nano=mock", cars=tmp_path, record=run) as car:
        driven = calibrate_steering(car, dry_run=True)
    read = steering_from([run])
    assert read.source == (str(run),)
    at = np.interp(read.command, driven.command, driven.angle)
    assert np.degrees(np.sqrt(np.mean((read.angle - at) ** 2))) < 0.6
    assert any("slow" in note for note in read.notes)
    assert read.car == "sim-4"
    inside = np.abs(read.command) < 1.0
    pulse = np.interp(read.command, driven.command, driven.pulse_us)
    assert read.pulse_us[inside] == pytest.approx(pulse[inside], abs=0.01)
    assert read.written is None
    assert "nothing written" in read.unwritten
    assert read.unwritten in read.to_json()["notes"]


def test_file_that_is_no_run_is_refused(tmp_path):
    bad = tmp_path / "bad.mcap"
    bad.write_bytes(b"not an mcap file")
    with pytest.raises(RecordingError, match=r"bad\.mcap"):
        steering_from([bad])
    with pytest.raises(RecordingError, match="no usable"):
        steering_from([tmp_path])
