"""Values that are numbers, positive, and impossible: a wrong unit, mostly."""

from __future__ import annotations

from pathlib import Path

import pytest

from dart_hal.core.config import (
    Calibration,
    Quantity,
    calibration_in,
    dump,
    load_car,
    parse_calibration,
    parse_car,
    parse_config,
    save_calibration,
)
from dart_hal.core.config.folders import parse_run_car
from dart_hal.core.errors import ConfigError

CAR = (Path(__file__).parents[3] / "cars" / "dart-01" / "car.toml").read_text(encoding="utf-8")
MAP_RANGES = ('schema = "dart-hal/calibration/1"\ncar = "x"\n[steering]\n'
              "map = {{ pulse_us = [{a}, 1500, {b}], angle_rad = [-{c}, 0.0, {c}],"
              " std_rad = [0.01, 0.01, 0.01] }}\n")


def test_a_plausible_map_is_taken():
    assert parse_calibration(MAP_RANGES.format(a=1100, b=1900, c=0.35), "here").steering.map


@pytest.mark.parametrize(("a", "b", "c", "key"), [
    (1100, 1900, 21.0, "angle_rad"), (1100, 18750, 0.35, "pulse_us"),
    (11, 1900, 0.35, "pulse_us")])
def test_degrees_and_tenths_are_refused(a, b, c, key):
    with pytest.raises(ConfigError, match=key):
        parse_calibration(MAP_RANGES.format(a=a, b=b, c=c), "here")


@pytest.mark.parametrize(("old", "new", "key"), [
    ("edges_per_rev = 20", "edges_per_rev = 0", "edges_per_rev"),
    ("value = 0.0020646", "value = 2.0646", "metres_per_edge")])
def test_rings_that_cannot_be_are_refused(old, new, key):
    assert old in CAR
    with pytest.raises(ConfigError, match=key):
        parse_config(CAR.replace(old, new), "here")


def with_neutral(us: float, deliberate: float | None = None) -> str:
    mark = "" if deliberate is None else f"\ndeliberate_neutral_us = {deliberate}"
    return CAR.replace("neutral_us = 1500 ", f"neutral_us = {us}{mark} ")


def format_measured(table: str, key: str, value: float, std: float) -> str:
    return f'car = "dart-01"\n[{table}]\n{key} = {{ value = {value}, std = {std} }}\n'


@pytest.mark.parametrize("us", [1000, 1050, 1399, 1601, 1900, 2000])
def test_an_unusual_neutral_is_refused_in_both_files(us):
    with pytest.raises(ConfigError, match="neutral_us") as caught:
        parse_config(with_neutral(us), "car.toml")
    assert (str(us) in caught.value.found, caught.value.expected) == (True, "1400 to 1600 us")
    assert "deliberate_neutral_us" in caught.value.remedy
    with pytest.raises(ConfigError, match="neutral_us"):
        parse_calibration(format_measured("throttle", "neutral_us", us, 1.0), "here")


@pytest.mark.parametrize("us", [1400, 1500, 1600])
def test_a_usual_neutral_is_accepted_in_both_files(us):
    assert parse_config(with_neutral(us), "car.toml").throttle.neutral_us == us
    assert parse_calibration(format_measured("throttle", "neutral_us", us, 1.0), "here")


def test_a_deliberate_neutral_is_accepted_near_its_mark_alone():
    assert parse_config(with_neutral(1650, 1650), "car.toml").throttle.neutral_us == 1650
    text = format_measured("throttle", "neutral_us", 1655, 1.0)
    assert parse_calibration(text, "here", deliberate_us=1650.0)
    for us in (1690, 1900):  # the mark is no licence for another number
        with pytest.raises(ConfigError, match="deliberate_neutral_us"):
            parse_calibration(format_measured("throttle", "neutral_us", us, 1.0), "here",
                              deliberate_us=1650.0)
    with pytest.raises(ConfigError, match="deliberate_neutral_us"):
        parse_config(with_neutral(1500, 3000), "car.toml")


@pytest.mark.parametrize(("hertz", "std", "key"), [
    (15.1e6, 1e3, "value"), (21.9e6, 1e3, "value"), (28.1e6, 1e3, "value"),
    (34.9e6, 1e3, "value"), (25e6, 5e6, "std"), (25e6, 0.006 * 25e6, "std")])
def test_an_oscillator_that_no_board_has_is_refused_in_both_files(hertz, std, key):
    with pytest.raises(ConfigError, match=f"oscillator_hz.{key}"):
        parse_calibration(format_measured("pwm", "oscillator_hz", hertz, std), "here")
    line = f"oscillator_hz = {{ value = {hertz}, std = {std} }}"
    with pytest.raises(ConfigError, match=f"oscillator_hz.{key}"):
        parse_config(CAR.replace("clock_channel = 15", f"clock_channel = 15\n{line}"), "car.toml")


@pytest.mark.parametrize("hertz", [22e6, 24.06e6, 27e6, 28e6])
def test_an_oscillator_that_boards_have_is_accepted(hertz):
    assert parse_calibration(format_measured("pwm", "oscillator_hz", hertz, 0.005 * hertz), "here")


def test_no_file_of_a_car_can_bring_an_unusual_neutral_to_the_pins(tmp_path):
    """Loading, reading to write again, and writing: each refuses it, and writes nothing."""
    folder = tmp_path / "dart-01"
    folder.mkdir()
    (folder / "car.toml").write_text(CAR, encoding="utf-8")
    wrong = Calibration(car="dart-01").with_quantities(
        {"throttle.neutral_us": Quantity(1900.0, 1.0)})
    with pytest.raises(ConfigError, match="neutral_us"):
        save_calibration(wrong, folder)
    assert not (folder / "calibration.toml").exists()
    (folder / "calibration.toml").write_text(dump(wrong), encoding="utf-8")
    for read in (lambda: load_car("dart-01", [tmp_path]),
                 lambda: calibration_in(folder, "dart-01"),
                 lambda: parse_car(CAR, "sim", [tmp_path])):
        with pytest.raises(ConfigError, match="neutral_us"):
            read()
    (folder / "car.toml").write_text(with_neutral(1500, 1900), encoding="utf-8")
    assert load_car("dart-01", [tmp_path]).neutral_us == 1900.0
    save_calibration(wrong, folder)


def test_a_recording_of_a_car_with_an_unusual_neutral_can_be_read(tmp_path):
    text = dump(Calibration(car="dart-01").with_quantities(
        {"throttle.neutral_us": Quantity(1900.0, 1.0)}))
    files = parse_run_car(with_neutral(1700), "run.mcap", {"calibration.toml": text})
    assert files.neutral_us == 1900.0
