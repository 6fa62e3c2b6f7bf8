"""Bad files: a sentence that names the file, never a traceback, never a wrong number."""

from __future__ import annotations

import gzip

import numpy as np
import pytest

from dart_hal.core.errors import RecordingError
from dart_hal.recording.dart import grid, read, read_all
from dart_hal.recording.dart.reference import SEP_24


def read_refused(path, *words: str) -> RecordingError:
    with pytest.raises(RecordingError) as caught:
        read(path)
    text = str(caught.value)
    assert path.name in text
    assert caught.value.remedy
    for word in words:
        assert word in text
    return caught.value


@pytest.mark.parametrize("name", ["W (IMU)", "vel encoder", "steering", "elapsed time sensors",
                                  "safety_value"])
def test_missing_column_of_a(write, table_a, name):
    table = table_a()
    del table[name]
    read_refused(write(table), repr(name), "schema A")


@pytest.mark.parametrize("name", ["vicon yaw", "vicon time", "vel encoder"])
def test_missing_column_of_b_is_not_read_as_another_schema(write, table_b, name):
    table = table_b()
    del table[name]
    read_refused(write(table), repr(name), "schema B")


def test_other_column_order_gives_the_same_recording(write, table_b):
    table = table_b()
    rng = np.random.default_rng(5)
    names = list(table)
    shuffled = {n: table[n] for n in rng.permutation(names)}
    a = read(write(table))
    b = read(write(shuffled, "shuffled.csv"))
    assert a.messages.speed == pytest.approx(b.messages.speed)
    assert np.array_equal(a.mocap.yaw, b.mocap.yaw)


def test_columns_that_are_never_used_may_be_absent_or_extra(write, table_a):
    table = table_a()
    del table["current"], table["voltage"]
    table["battery"] = np.ones(60)
    assert len(read(write(table)).messages) == 60


def test_words_in_a_column_that_is_never_used_cost_nothing(write, table_b):
    path = write(table_b())
    head, *rows = path.read_text().splitlines()
    lines = [f"lap {i % 3},{row}" for i, row in enumerate(rows)]
    path.write_text("\n".join([f"remark,{head}", *lines]))
    plain = read(write(table_b(), "plain.csv"))
    marked = read(path)
    assert np.array_equal(marked.messages.speed, plain.messages.speed)
    assert np.array_equal(marked.mocap.yaw, plain.mocap.yaw)


def test_a_few_nan_cells_cost_their_rows(write, table_a):
    table = table_a()
    table["vel encoder"][7] = np.nan
    table["W (IMU)"][9] = np.inf
    recording = read(write(table))
    assert len(recording.messages) == 58
    assert any("non-finite" in n.why and n.rows == 2 for n in recording.notes)
    assert np.isfinite(recording.messages.speed).all()


def test_many_nan_cells_are_refused(write, table_a):
    table = table_a()
    table["vel encoder"][::2] = np.nan
    read_refused(write(table), "vel encoder", "5%")


def test_nan_in_an_unused_column_costs_nothing(write, table_a):
    table = table_a()
    table["voltage"][:] = np.nan
    assert len(read(write(table)).messages) == 60


def edit(path, change) -> None:
    path.write_text(change(path.read_text()))


def test_empty_cell_is_a_missing_value(write, table_a):
    path = write(table_a())
    lines = path.read_text().splitlines()
    cells = lines[5].split(",")
    cells[6] = ""
    lines[5] = ",".join(cells)
    path.write_text("\n".join(lines))
    assert len(read(path).messages) == 59


def test_text_in_a_cell_names_line_and_column(write, table_a):
    path = write(table_a())
    lines = path.read_text().splitlines()
    cells = lines[5].split(",")
    cells[6] = "fast"
    lines[5] = ",".join(cells)
    path.write_text("\n".join(lines))
    read_refused(path, "line 6", "vel encoder", "fast")


def test_cut_off_last_line_is_dropped_and_reported(write, table_a):
    path = write(table_a())
    edit(path, lambda text: text.rstrip()[:-40])
    recording = read(path)
    assert len(recording.messages) == 59
    assert any("cut off" in n.why for n in recording.notes)


def test_short_line_in_the_middle_is_refused(write, table_a):
    path = write(table_a())
    lines = path.read_text().splitlines()
    lines[5] = "1.0,2.0"
    path.write_text("\n".join(lines))
    read_refused(path, "line 6", "2 cells")


@pytest.mark.parametrize(("content", "words"), [
    (b"", ("empty",)),
    (b"\n\n", ("empty",)),
    (b"\x89PNG\r\n\x1a\n\x00\x00\xff\xfe", ("not a text file",)),
    (b"\x00" * 4000, ("not a text file",)),
    (b"hello, this is a letter\nand a second line\n", ("not a DART recording",)),
    (b"<html><body>Not found</body></html>", ("not a DART recording",)),
    (b"1.0,2.0,3.0\n4.0,5.0,6.0\n", ("not a DART recording",)),
    (gzip.compress(b"x" * 500)[:20], ("gzip",)),
], ids=["0 bytes", "blank", "png", "zeros", "text", "html", "numbers", "cut gzip"])
def test_other_files_are_refused(tmp_path, content, words):
    path = tmp_path / "odd.csv"
    path.write_bytes(content)
    read_refused(path, *words)


def test_header_without_rows_is_refused(write, table_a):
    path = write({k: v[:0] for k, v in table_a().items()})
    read_refused(path, "no rows")


def test_no_sensor_message_at_all_is_refused(write, table_b):
    table = table_b()
    table["elapsed time sensors"][:] = 0.0
    read_refused(write(table), "no sensor message")


def test_commands_in_per_cent_are_refused(write, table_a):
    table = table_a()
    table["throttle"][:] = 25.0
    read_refused(write(table), "throttle", "25")


def test_gate_that_is_no_gate_is_refused(write, table_a):
    table = table_a()
    table["safety_value"][3] = 0.5
    read_refused(write(table), "safety_value")


def test_column_twice_is_refused(write, table_a):
    path = write(table_a())
    edit(path, lambda text: text.replace("voltage", "throttle"))
    read_refused(path, "twice")


def test_missing_file_is_refused(tmp_path):
    read_refused(tmp_path / "absent.csv", "no such file")


def test_folder_skips_what_it_cannot_use_and_reports_it(write, table_a, tmp_path):
    write(table_a(), "good.csv")
    (tmp_path / "bad.csv").write_text("a,b\n1,2\n")
    (tmp_path / "empty.csv").write_bytes(b"")
    recordings, skipped = read_all([tmp_path])
    assert [r.path.name for r in recordings] == ["good.csv"]
    assert {f.rsplit("/", 1)[1] for f, _ in skipped} == {"bad.csv", "empty.csv"}
    assert all(reason and "Traceback" not in reason for _, reason in skipped)


def test_file_named_by_itself_is_refused_even_with_a_good_folder(write, table_a, tmp_path):
    good = write(table_a(), "good.csv")
    bad = tmp_path / "bad.csv"
    bad.write_text("a,b\n1,2\n")
    with pytest.raises(RecordingError, match=r"bad\.csv"):
        read_all([good, bad])


def test_folder_without_any_recording_is_refused(tmp_path):
    with pytest.raises(RecordingError, match="no usable recording"):
        read_all([tmp_path])


def test_file_and_its_folder_give_it_once(write, table_a, tmp_path):
    good = write(table_a(), "good.csv")
    assert len(read_all([good, tmp_path])[0]) == 1


@pytest.mark.slow
def test_mangled_files_never_give_a_traceback(write, table_a):
    """Random damage: either a recording with finite numbers or a RecordingError."""
    rng = np.random.default_rng(11)
    source = write(table_a()).read_bytes()
    path = write(table_a(), "mangled.csv")
    outcomes = set()
    for _ in range(300):
        data = bytearray(source)
        for _ in range(rng.integers(1, 6)):
            data[rng.integers(0, len(data))] = rng.integers(0, 256)
        path.write_bytes(bytes(data[:rng.integers(1, len(data) + 1)]))
        try:
            m = read(path).messages
        except RecordingError:
            outcomes.add("refused")
            continue
        outcomes.add("read")
        assert np.isfinite(m.t).all()
        assert np.isfinite(m.speed).all()
    assert outcomes == {"refused", "read"}


def test_a_grid_without_motion_capture_is_refused_for_that(write, table_a):
    """Not for the marker mounting, which no date could supply here."""
    recording = read(write(table_a()))
    for reference in (None, SEP_24):
        with pytest.raises(RecordingError, match="no motion capture in this") as caught:
            grid(recording, reference)
        assert caught.value.found == "schema A"
