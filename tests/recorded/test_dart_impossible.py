"""Values that no car can have: refused by file, column, value and likely unit."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.core.errors import RecordingError
from dart_hal.recording.dart import read, read_all

DEGREES = 180.0 / np.pi


def expect_refusal(path, *words: str) -> None:
    with pytest.raises(RecordingError) as caught:
        read(path)
    for word in (path.name, *words):
        assert word in str(caught.value)
    assert caught.value.found
    assert caught.value.expected
    assert caught.value.remedy


@pytest.mark.parametrize(("column", "value", "unit"), [
    ("vel encoder", 15.1, "mm/s"), ("vel encoder", -15.1, "mm/s"), ("vel encoder", 1e300, "mm/s"),
    ("W (IMU)", -35.1, "deg/s"), ("acc x (IMU)", 200.1, "mg"), ("acc y (IMU)", -1e300, "mg"),
    ("throttle", 1.0011, "per cent"), ("steering", -1.0011, "per cent"),
    ("elapsed time sensors", 1e300, "ms"), ("vicon time", 1e300, "ms"),
    ("vicon x", 1000.1, "mm"), ("vicon y", -1e300, "mm")])
def test_one_impossible_cell_is_enough(write, table_b, column, value, unit):
    table = table_b()
    table[column][300] = value
    expect_refusal(write(table), repr(column), f"{abs(value):.4g}", unit)


@pytest.mark.parametrize(("column", "value", "words"), [
    ("elapsed time sensors", 1.0e6, "a step of 999897 s"),
    ("vicon time", 1.9e9, "a step of 1.746e+08 s"),
    ("vicon yaw", 60.0, "a jump of 58.505 rad")])
def test_one_impossible_step_is_enough(write, table_b, column, value, words):
    table = table_b()
    table[column][300] = value
    expect_refusal(write(table), repr(column), words)


@pytest.mark.parametrize(("column", "value"), [
    ("vel encoder", 14.9), ("W (IMU)", -34.9), ("acc x (IMU)", 199.0), ("acc y (IMU)", -199.0),
    ("throttle", -1.0), ("steering", 1.0), ("vicon x", 990.0), ("vicon y", -990.0)])
def test_one_odd_but_possible_cell_is_read(write, table_b, column, value):
    table = table_b()
    table[column][300] = value
    assert len(read(write(table)).messages) >= 60


def test_every_thirteenth_speed_is_damaged(write, table_a):
    table = table_a()
    table["vel encoder"][::13] = 1e300
    expect_refusal(write(table), "'vel encoder'", "1e+300", "5 of 60 row(s)", "at most 15 m/s")


@pytest.mark.parametrize(("column", "factor", "unit"), [
    ("vel encoder", 1000.0, "mm/s"), ("vel encoder", 100.0, "cm/s"),
    ("W (IMU)", DEGREES, "deg/s"), ("elapsed time sensors", 1000.0, "ms"),
    ("elapsed time sensors", 1e6, "us"), ("elapsed time sensors", 1 / 3600, "hours")])
def test_another_unit_in_schema_a(write, table_a, column, factor, unit):
    table = table_a()
    table[column] *= factor
    expect_refusal(write(table), repr(column), f"{unit}")


def test_yaw_rate_in_degrees_below_the_limit_is_found_against_the_wheels(write, table_a):
    table = table_a()
    table["W (IMU)"][:] = 0.5 * DEGREES
    assert table["W (IMU)"].max() < 35.0
    expect_refusal(write(table), "'W (IMU)'", "deg/s?", "28.6479", "0.06 m")


def test_spinning_on_the_spot_for_a_while_is_no_unit(write, table_a):
    """A drift turns tighter than the steering could, but not in every fifth row."""
    table = table_a()
    table["W (IMU)"][:10] = 15.0
    assert read(write(table)).messages.yaw_rate[0] == 15.0


def test_a_car_at_rest_that_is_turned_by_hand_is_no_unit(write, table_a):
    table = table_a()
    table["vel encoder"][:] = 0.0
    table["W (IMU)"][:] = 5.0
    assert read(write(table)).encoder == "zero"


@pytest.mark.parametrize(("columns", "factor", "unit"), [
    (("vicon x", "vicon y"), 1000.0, "mm"), (("vicon time",), 1000.0, "ms"),
    (("vicon yaw",), DEGREES, "degrees")])
def test_another_unit_in_the_mocap(write, table_b, columns, factor, unit):
    table = table_b(n=1600)
    table["vicon x"] *= 0.4  # 400 mm: only the speed shows it
    table["vicon y"] *= 0.4
    for column in columns:
        table[column] *= factor
    expect_refusal(write(table), repr(columns[0]), unit)


def test_in_a_folder_it_is_skipped_and_listed(write, table_a, tmp_path):
    write(table_a(), "good.csv")
    table = table_a()
    table["vel encoder"] *= 1000.0
    write(table, "millimetres.csv")
    recordings, skipped = read_all([tmp_path])
    assert [r.path.name for r in recordings] == ["good.csv"]
    ((file, reason),) = skipped
    assert file.endswith("millimetres.csv")
    assert "'vel encoder'" in reason
    assert "mm/s" in reason
