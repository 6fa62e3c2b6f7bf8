"""A run is replayed by the files that it was driven by, wherever and whenever that is."""

from __future__ import annotations

import pytest

from dart_hal.car import Car
from dart_hal.car.runs import read_run
from dart_hal.core.config import Calibration, Quantity, load_car, save_calibration
from dart_hal.recording.run import RunReader
from tests.common import MOCK_3_URL


def calibrate(folder, metres: float) -> None:
    save_calibration(Calibration(car="sim-3").with_quantities(
        {"encoder.metres_per_edge": Quantity(metres, 1e-5),
         "imu.gyro_scale": Quantity(1.01, 1e-4)}), folder)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """(path of a run, the speeds that the program saw, folder of cars)"""
    home = tmp_path_factory.mktemp("cars")
    (home / "sim-3").mkdir()
    calibrate(home / "sim-3", 0.02)
    path = home / "run.mcap"
    with Car.open(MOCK_3_URL, cars=home, record=path) as car:
        car.arm()
        motion = []
        for state in car.states(duration=1.5):
            car.drive(throttle=0.25, steering=0.1)
            motion.append((state.speed, state.yaw_rate))
        for state in car.states(duration=0.3):  # means of 0.1 s reach beyond the fastest moment
            car.drive(throttle=0.25, steering=0.1)
            motion.append((state.speed, state.yaw_rate))
    return path, motion, home


def replay_motion(path, **options) -> list[tuple[float, float]]:
    with Car.open(f"replay://{path}", **options) as car:
        return [(s.speed, s.yaw_rate) for s in car.states()]


def top(states: list[tuple[float, float]]) -> float:
    return max(speed for speed, _ in states if speed is not None)


@pytest.mark.slow
def test_the_states_are_those_of_the_run(run, tmp_path, monkeypatch):
    path, motion, _ = run
    monkeypatch.chdir(tmp_path)
    again = replay_motion(path)
    assert again[:len(motion)] == motion or again[-len(motion):] == motion
    assert top(motion) > 1.0  # by ten times the real travel per edge


@pytest.mark.slow
def test_a_calibration_of_today_counts_where_it_is_named_alone(run, tmp_path, monkeypatch):
    path, motion, _ = run
    (tmp_path / "sim-3").mkdir()
    calibrate(tmp_path / "sim-3", 0.002)
    monkeypatch.setenv("DART_CARS", str(tmp_path))
    assert top(replay_motion(path)) == top(motion)
    assert top(replay_motion(path, cars=tmp_path)) == pytest.approx(0.1 * top(motion), rel=1e-3)


@pytest.mark.slow
def test_identification_reads_the_run_by_its_files(run, tmp_path, monkeypatch):
    path, motion, _ = run
    monkeypatch.chdir(tmp_path)
    assert read_run(path).messages.speed.max() == pytest.approx(top(motion), rel=0.05)


@pytest.mark.slow
def test_a_run_of_a_replay_hands_them_on(run, tmp_path):
    path = run[0]
    with Car.open(f"replay://{path}", record=tmp_path / "again.mcap") as car:
        for _ in car.states():
            pass
    assert RunReader(tmp_path / "again.mcap").files.keys() == {"car.toml", "calibration.toml"}


@pytest.mark.slow
def test_a_run_of_a_replay_keeps_the_files_that_it_was_read_by(run, tmp_path):
    (tmp_path / "sim-3").mkdir()
    calibrate(tmp_path / "sim-3", 0.002)
    with Car.open(f"replay://{run[0]}", cars=tmp_path, record=tmp_path / "again.mcap") as car:
        for _ in car.states():
            pass
    assert "value = 0.002," in RunReader(tmp_path / "again.mcap").files["calibration.toml"]


@pytest.mark.slow
def test_a_car_without_files_has_those_of_its_run(run):
    with Car.open(f"replay://{run[0]}") as car:
        assert car.files.metres_per_edge.value == 0.02
    assert load_car("dart-01", ["cars"]).calibration is None


@pytest.mark.slow
def test_a_recorded_file_that_cannot_be_read_is_reported_and_left_out(run, monkeypatch):
    whole = RunReader.__init__

    def read_with_mass(self, *args, **kwargs):
        whole(self, *args, **kwargs)
        self.files = {**self.files, "model.toml": "[body]\nmass = 2.5\n"}

    monkeypatch.setattr(RunReader, "__init__", read_with_mass)
    with Car.open(f"replay://{run[0]}") as car:
        assert car.files.model is None
        assert car.files.metres_per_edge.value == 0.02
        assert any("model.toml in replay://" in notice for notice in car.notices)
