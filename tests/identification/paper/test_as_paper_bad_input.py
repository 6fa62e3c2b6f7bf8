"""Folders that the paper's preprocessing cannot take: refused with a clear statement."""

from __future__ import annotations

import gzip
import shutil
from pathlib import Path

import numpy as np
import pytest

from dart_hal.core.errors import RecordingError
from dart_lab.identification.paper import FOLDERS, fit_as_paper

EXCERPT = Path(__file__).resolve().parents[2] / "recorded" / "data"
HEADER = ("elapsed time sensors,current,voltage,acc x (IMU),acc y (IMU),W (IMU),vel encoder,"
          "safety_value,throttle,steering")


def table(n=300, **columns):
    """Rows of schema A at 10 Hz, everything zero but what is given."""
    names = HEADER.split(",")
    short = {"t": "elapsed time sensors", "v": "vel encoder", "gate": "safety_value",
             "tau": "throttle", "s": "steering", "w": "W (IMU)"}
    rows = {name: np.zeros(n) for name in names}
    rows["elapsed time sensors"] = 100.0 + 0.1 * np.arange(n)
    rows["safety_value"] = np.ones(n)
    rows |= {short[key]: np.asarray(value) for key, value in columns.items()}
    return np.stack([np.broadcast_to(rows[name], n) for name in names], axis=1)


def write(root: Path, folder: str, rows: np.ndarray, name: str = "car_1.csv") -> Path:
    path = root / folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [HEADER, *(",".join(map(repr, map(float, row))) for row in rows)]
    path.write_text("\r\n".join(lines) + "\r\n")
    return path


def coasting(n=300):
    t = 0.1 * np.arange(n)
    return table(n, v=np.maximum(0.0, 4.0 - 1.2 * (t % 6.0)), tau=np.zeros(n))


def refused(root, name, text):
    with pytest.raises(RecordingError, match=text) as caught:
        fit_as_paper(root, [name])
    assert caught.value.remedy
    return caught.value


def test_a_folder_that_is_not_there(tmp_path):
    error = refused(tmp_path, "friction", "no recording")
    assert FOLDERS["friction"] in error.expected


def test_mixed_schemas(tmp_path):
    for folder in (FOLDERS["friction"], "circles_27_sept_2024"):
        file = next((EXCERPT / folder).glob("*.csv.gz"))
        (tmp_path / FOLDERS["friction"]).mkdir(exist_ok=True)
        shutil.copy(file, tmp_path / FOLDERS["friction"] / f"{folder[:3]}{file.name}")
    error = refused(tmp_path, "friction", "schema B among files of schema A")
    assert "cir" in error.read


def test_a_car_that_never_moves_or_a_dead_encoder(tmp_path):
    write(tmp_path, FOLDERS["motor"], table(tau=0.3))
    refused(tmp_path, "motor", "never moves, or its encoder is dead")


def test_ten_rows(tmp_path):
    write(tmp_path, FOLDERS["friction"], coasting(10))
    assert refused(tmp_path, "friction", "too few rows").found == "10 rows"


def test_time_running_backwards(tmp_path):
    rows = coasting()
    rows[150:, 0] -= 20.0
    write(tmp_path, FOLDERS["friction"], rows)
    refused(tmp_path, "friction", "does not advance after row 150")


def test_a_cell_that_is_no_number(tmp_path):
    rows = coasting()
    rows[7, 6] = np.nan
    write(tmp_path, FOLDERS["friction"], rows)
    refused(tmp_path, "friction", "line 9 ")


def test_no_fast_rows_for_a_delay_or_a_map(tmp_path):
    slow = table(v=0.3, s=np.sin(0.05 * np.arange(300)), w=0.1)
    for name in ("delay", "steering"):
        write(tmp_path, FOLDERS[name], slow)
        refused(tmp_path, name, "0.8 m/s")


def test_no_coasting_for_friction(tmp_path):
    write(tmp_path, FOLDERS["friction"], table(v=1.0 + 0.01 * (np.arange(300) % 7), tau=0.3))
    refused(tmp_path, "friction", "coast")


def test_one_bad_folder_does_not_cost_the_others(tmp_path):
    shutil.copytree(EXCERPT / FOLDERS["motor"], tmp_path / FOLDERS["motor"])
    write(tmp_path, FOLDERS["friction"], coasting(10))
    made = fit_as_paper(tmp_path)
    assert set(made.fits) == {"motor"}
    reasons = [why for report in made.files.values() if not report.used for why in report.why]
    assert len(reasons) == 4
    assert any("friction not fitted" in why and "too few rows" in why for why in reasons)


def test_a_recording_too_short_for_the_tyres(tmp_path):
    source = next((EXCERPT / FOLDERS["tyres"]).glob("*.csv.gz"))
    lines = gzip.decompress(source.read_bytes()).decode().splitlines()
    target = tmp_path / FOLDERS["tyres"] / "car_1.csv"
    target.parent.mkdir()
    target.write_text("\n".join(lines[:400]))
    refused(tmp_path, "tyres", "between 5 and 58.7 s")


def test_one_level_shows_no_curve(tmp_path):
    """One command, no throttle: amplitudes and gains are confounded."""
    noise = np.random.default_rng(1).normal(size=300)
    one = table(v=1.2 + 0.01 * noise, s=0.5, w=1.0 + 0.05 * noise, tau=0.0)
    for name, unidentified in (("steering",
                                {"k_left", "a_left_rad", "s0", "a_right_rad", "k_right"}),
                               ("motor", {"d", "e", "g"})):
        write(tmp_path, FOLDERS[name], one)
        fit = fit_as_paper(tmp_path, [name]).fits[name]
        assert not fit.sound
        assert {n for n, e in fit.parameters.items() if np.isinf(e.std)} == unidentified
        assert not any(e.identifiable for e in fit.parameters.values())
        assert any("not identifiable" in note for note in fit.notes)


def test_a_gate_that_is_closed_means_throttle_zero(tmp_path):
    """The logged throttle of a closed gate never reached the car."""
    rows = coasting()
    write(tmp_path / "a", FOLDERS["friction"], rows)
    rows[:, 7], rows[:, 8] = 0.0, 0.4
    write(tmp_path / "b", FOLDERS["friction"], rows)
    one, other = (fit_as_paper(tmp_path / r, ["friction"]).fits["friction"] for r in "ab")
    assert one.values() == other.values()
    assert one.n == other.n
