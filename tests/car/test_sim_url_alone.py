"""A sim:// URL is the same car on every computer: no file counts that nobody named."""

from __future__ import annotations

import pytest

from dart_hal.car import Car
from dart_hal.config import Calibration, Quantity, calibration_in, load_car, save_calibration
from dart_hal.links.base import open_backend
from dart_hal.recording.run import RunReader

URL = "sim://?seed=3&nano=mock"


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
    with Car.open(URL, **options) as car:
        car.arm()
        seen = []
        for state in car.states(duration=1.0):
            car.drive(throttle=0.3)
            seen.append((state.t, state.speed))
    return seen


def test_a_calibration_in_the_home_folder_changes_nothing(home, tmp_path, monkeypatch):
    with_it = driven()
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "empty"))
    assert driven() == with_it


def test_nor_does_one_beside_the_program(home, tmp_path, monkeypatch):
    there = driven()
    (tmp_path / "cars").symlink_to(home.parent)
    monkeypatch.chdir(tmp_path)
    assert driven() == there


def test_it_is_said_once_that_it_is_not_used(home):
    with Car.open(URL) as car:
        (notice,) = (text for text in car.notices if "not used" in text)
    assert str(home) in notice


def test_a_named_folder_counts(home):
    assert driven(cars=home.parent) != driven()
    with Car.open(URL, cars=home.parent) as car:
        assert car.files.metres_per_edge.value == 0.02
        assert not car.notices


def test_what_is_not_used_is_not_recorded(home, tmp_path):
    for options, names in (({}, {"car.toml"}),
                           ({"cars": home.parent}, {"car.toml", "calibration.toml"})):
        path = tmp_path / f"{len(names)}.mcap"
        with Car.open(URL, record=path, **options):
            pass
        assert set(RunReader(path).files) == names


def test_what_is_written_there_keeps_what_was_measured_before(home):
    """A second calibration of the car adds to the first, though the car did not use it."""
    assert calibration_in(home, "sim-3").encoder.metres_per_edge.value == 0.02
    assert calibration_in(home.parent / "sim-9", "sim-9") == Calibration(car="sim-9")


def test_a_car_behind_a_port_has_its_files_wherever_they_are(home):
    """sim --pty is a real car to the program that opens the port."""
    backend = open_backend(URL)
    backend.close()
    (home / "car.toml").write_text(backend.car_toml, encoding="utf-8")
    assert load_car("sim-3").metres_per_edge.value == 0.02
