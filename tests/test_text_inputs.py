"""Each text file that a user gives is read in UTF-8 and UTF-16, with and without a mark."""

from __future__ import annotations

import codecs
import shutil

import numpy as np
import pytest

from dart_hal.cli.drive import load_control
from dart_hal.control.path_file import read_path
from dart_hal.core.config.folders import load_car, save_calibration
from dart_hal.core.errors import ConfigError, RecordingError
from dart_hal.core.text_file import decode_text, read_text
from dart_hal.devices.poses import open_poses
from dart_hal.recording.dart.table import parse
from dart_hal.recording.table import CSV_COLUMNS, read_csv
from tests.common import ROOT

CAR_FOLDER = ROOT / "cars" / "dart-01"
ENCODINGS = ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32"]
DART_HEADER = ("elapsed time sensors,current,voltage,acc x (IMU),acc y (IMU),W (IMU),"
               "vel encoder,safety_value,throttle,steering\r\n")


def read_car(folder, data):
    target = folder / "dart-01"
    shutil.copytree(CAR_FOLDER, target)
    (target / "car.toml").write_bytes(data((CAR_FOLDER / "car.toml").read_text(encoding="utf-8")))
    return load_car("dart-01", [folder]).config.name == "dart-01"


def read_poses(folder, data):
    (folder / "p.csv").write_bytes(data("t,x,y,yaw\n0,1,2,0\n1,1,2,0\n"))
    source = open_poses(f"file://{folder / 'p.csv'}")
    return len(source.poll(0.0)) == 1


def read_run(folder, data):
    row = ["0.0"] * len(CSV_COLUMNS)
    row[1], row[7], row[-1], row[-2] = "1", "2", "", ""
    (folder / "r.csv").write_bytes(data(",".join(CSV_COLUMNS) + "\n" + ",".join(row) + "\n"))
    return len(read_csv(folder / "r.csv")) == 1


def read_recording(folder, data):
    rows = "".join(f"{0.1 * i},0,0,0,0,0,1,1,0.2,0\r\n" for i in range(5))
    (folder / "d.csv").write_bytes(data(DART_HEADER + rows))
    return parse(folder / "d.csv")[1]["vel encoder"].tolist() == [1.0] * 5


def read_way(folder, data):
    (folder / "w.csv").write_bytes(data("x,y\n0,0\n1,0\n2,0.5\n"))
    return bool(np.isfinite(read_path(folder / "w.csv").length))


READERS = [read_car, read_poses, read_run, read_recording, read_way]


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("read", READERS)
def test_text_input_is_read_in_every_encoding(tmp_path, read, encoding):
    assert read(tmp_path, lambda text: text.encode(encoding))


@pytest.mark.parametrize("read", READERS[:4])
def test_bytes_that_are_no_text_are_refused(tmp_path, read):
    """The negative control: the same file in an encoding that nothing marks."""
    with pytest.raises((ConfigError, RecordingError)):
        read(tmp_path, lambda text: b"\xff" + text.encode())


def test_calibration_with_a_mark_can_be_written_again(tmp_path):
    shutil.copytree(CAR_FOLDER, tmp_path / "dart-01")
    text = 'schema = "dart-hal/calibration/1"\ncar = "dart-01"\n# by hand: 22 °C\n'
    path = tmp_path / "dart-01" / "calibration.toml"
    path.write_bytes(text.encode("utf-16"))
    files = load_car("dart-01", [tmp_path])
    assert files.calibration is not None
    save_calibration(files.calibration, path.parent)
    assert "22 °C" in read_text(path)


@pytest.mark.parametrize("text", ["a", "ab", "1\n", "x,y\r\n1,2\r\n", "größe = 3\n", ""])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-32"])
def test_marked_text_is_decoded(text, encoding):
    assert decode_text(text.encode(encoding)) == text.replace("\r\n", "\n")


def test_binary_is_not_taken_for_utf_16():
    with pytest.raises(UnicodeDecodeError):
        decode_text(bytes(range(256)))


def test_script_with_a_mark_is_driven(tmp_path):
    script = tmp_path / "script.py"
    script.write_bytes(codecs.BOM_UTF8 + b"def control(state):\n    return 0.1, 0.0\n")
    assert load_control(script)(None) == (0.1, 0.0)
