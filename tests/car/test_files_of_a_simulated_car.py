"""Files of a simulated car: as of a real one, those named, else ./cars, else the home folder."""

from __future__ import annotations

import pytest

from dart_hal.car import Car
from dart_hal.core.config import Calibration, Quantity, calibration_in, load_car, save_calibration
from dart_hal.devices.links.base import open_backend
from dart_hal.recording.run import RunReader
from tests.common import MOCK_3_URL

pytestmark = pytest.mark.usefixtures("armed_esc")


@pytest.fixture
def home(tmp_path, monkeypatch):
    """A home folder with a measured sim-3."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    folder = tmp_path / "dart-hal" / "cars" / "sim-3"
    folder.mkdir(parents=True)
    save_calibration(Calibration(car="sim-3").with_quantities(
        {"encoder.metres_per_edge": Quantity(0.02, 1e-4)}), folder)
    return folder


def driven(**options) -> list[tuple[float, float]]:
    with Car.open(MOCK_3_URL, **options) as car:
        car.arm()
        motion = []
        for state in car.states(duration=1.0):
            car.drive(throttle=0.3)
            motion.append((state.t, state.speed))
    return motion


@pytest.mark.slow
def test_calibration_in_the_home_folder_is_used(home, tmp_path, monkeypatch):
    with_it = driven()
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "empty"))
    assert driven() != with_it


@pytest.mark.slow
def test_calibration_in_the_folder_cars_is_used(home, tmp_path, monkeypatch):
    with_it = driven()
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "empty"))
    (tmp_path / "cars").symlink_to(home.parent)
    monkeypatch.chdir(tmp_path)
    assert driven() == with_it


def test_notice_names_a_folder_that_was_not_named(home):
    with Car.open(MOCK_3_URL) as car:
        (notice,) = (text for text in car.notices if "is used" in text)
    assert str(home) in notice
    with Car.open(MOCK_3_URL, cars=home.parent) as car:
        assert car.files.metres_per_edge.value == 0.02
        assert not car.notices


def test_named_folder_without_the_car_is_an_uncalibrated_car(home, tmp_path, monkeypatch):
    with Car.open(MOCK_3_URL, cars=tmp_path / "other") as car:
        assert car.files.calibration is None
        assert car.files.folder == tmp_path / "other" / "sim-3"
    monkeypatch.setenv("DART_CARS", str(tmp_path / "another"))
    with Car.open(MOCK_3_URL) as car:
        assert car.files.calibration is None


def test_what_is_used_is_recorded(home, tmp_path):
    for number, (cars, names) in enumerate(((tmp_path / "other", {"car.toml"}),
                                            (None, {"car.toml", "calibration.toml"}))):
        path = tmp_path / f"{number}.mcap"
        with Car.open(MOCK_3_URL, record=path, cars=cars):
            pass
        assert set(RunReader(path).files) == names


def test_what_is_written_there_keeps_what_was_measured_before(home):
    """A second calibration of the car adds to the first."""
    assert calibration_in(home, "sim-3").encoder.metres_per_edge.value == 0.02
    assert calibration_in(home.parent / "sim-9", "sim-9") == Calibration(car="sim-9")


def test_a_car_behind_a_port_has_its_files_wherever_they_are(home):
    """sim --pty is a real car to the program that opens the port."""
    backend = open_backend(MOCK_3_URL)
    backend.close()
    (home / "car.toml").write_text(backend.car_toml, encoding="utf-8")
    assert load_car("sim-3").metres_per_edge.value == 0.02
