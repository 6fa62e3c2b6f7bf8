"""CSV: exact round trip, cut-off rows, the ten columns."""

from __future__ import annotations

import csv

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.core.errors import RecordingError
from dart_hal.core.types import Applied
from dart_hal.recording.table import CSV_COLUMNS, DART_COLUMNS, CsvWriter, DartCsvWriter, read_csv

numbers = st.floats(allow_nan=False, allow_infinity=False)


@given(numbers, numbers, st.none() | numbers)
def test_round_trip_is_exact(tmp_path_factory, t, speed, yaw_rate):
    from dart_hal.core.types import Health, Pose, State

    state = State(t, 3, speed, 0.1, yaw_rate, None, -0.0, 7, Pose(1 / 3, -2.0, 0.1),
                  Applied(0.1, 0.2, 1500.5, 1499.9, ("RANGE", "OVERRIDDEN(safety)")),
                  Health(frozenset({"IMU_VALID"}), 0.0, 0.0, 0, 0, None, 0.0, "linear",
                         (0, 0, 0, 0)))
    path = tmp_path_factory.mktemp("csv") / "run.csv"
    with CsvWriter(path) as writer:
        writer.state(state)
    (row,) = read_csv(path)
    assert tuple(row) == CSV_COLUMNS
    assert (row["t"], row["speed"], row["yaw_rate"], row["accel_x"]) == (t, speed, yaw_rate, None)
    assert (row["x"], row["steering_us"], row["ticks"]) == (1 / 3, 1500.5, 7)
    assert row["limited"] == ("RANGE", "OVERRIDDEN(safety)")
    assert row["flags"] == ("IMU_VALID",)


def test_a_cut_off_row_is_dropped(tmp_path, state):
    path = tmp_path / "run.csv"
    with CsvWriter(path) as writer:
        for k in range(3):
            writer.state(state(k))
    whole = read_csv(path)
    data = path.read_bytes()
    for size in range(data.index(b"\n") + 1, len(data)):
        path.write_bytes(data[:size])
        rows = read_csv(path)
        assert rows == whole[:data[:size].count(b"\n") - 1]


@pytest.mark.parametrize("content", [b"", b"a,b\n1,2\n", b"\xff\xfe\x00",
                                     (",".join(CSV_COLUMNS) + "\nx\n").encode()])
def test_another_file_is_refused_by_name(tmp_path, content):
    path = tmp_path / "other.csv"
    path.write_bytes(content)
    with pytest.raises(RecordingError) as error:
        read_csv(path)
    assert str(path) in error.value.what


def test_the_ten_columns_of_the_dart_recordings(tmp_path, state):
    path = tmp_path / "run.dart.csv"
    with DartCsvWriter(path) as writer:
        writer.state(state(2, speed=-0.5))
        writer.state(state(3, applied=Applied(0.0, 0.0, 1500.0, 1500.0, ("NOT_ARMED",))))
    assert path.read_bytes().count(b"\r\n") == 3
    with path.open(newline="") as file:
        armed, disarmed = csv.DictReader(file)
    assert tuple(armed) == DART_COLUMNS
    assert float(armed["vel encoder"]) == 0.5
    assert float(armed["steering"]) == pytest.approx(0.1)
    assert (armed["safety_value"], disarmed["safety_value"]) == ("1.0", "0.0")


def test_the_reader_of_the_dart_recordings_takes_the_ten_columns(tmp_path, state):
    from dart_hal.recording.dart import reader as dart

    path = tmp_path / "run.dart.csv"
    with DartCsvWriter(path) as writer:
        for k in range(50):
            writer.state(state(k))
    messages = dart.read(path).messages
    assert len(messages) == 50
    assert messages.speed[7] == pytest.approx(1.0)
    assert messages.steering[7] == pytest.approx(0.1)


def test_a_state_without_a_sample_of_the_imu_holds_the_last_one(tmp_path, state):
    """0 rad/s in the middle of a bend would be no measurement."""
    path = tmp_path / "run.dart.csv"
    with DartCsvWriter(path) as writer:
        for k, rate in enumerate((None, 0.7, None, 0.9)):
            writer.state(state(k, yaw_rate=rate))
    with path.open(newline="") as file:
        assert [float(row["W (IMU)"]) for row in csv.DictReader(file)] == [0.0, 0.7, 0.7, 0.9]
