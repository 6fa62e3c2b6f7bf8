"""`dart-hal study`: a folder of recordings becomes a checked, fitted and diagnosed model."""

from __future__ import annotations

import json

import pytest

from dart_hal.recording.dart import Reference
from tests.recorded.simulated_recording import simulate_recording, table_of, write_table

FRAME = Reference(0.1, 0.01, 0.0, "of the simulation")
FRAME_OPTION = ("--reference", "0.1,0.01,0.0")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("recordings")
    for seed in (3, 4):
        recording, _ = simulate_recording(seed, seconds=30.0, frame=FRAME)
        write_table(table_of(recording, "C"), path / f"{seed}.csv")
    return path


@pytest.mark.slow
def test_a_whole_study_has_a_page_and_repeats_a_stage(verb, folder, tmp_path):
    ran = verb("study", folder, "--html", tmp_path / "study" / "index.html", *FRAME_OPTION,
               "--out", tmp_path / "study")
    assert ran.code == 0
    saved = tmp_path / "study"
    assert {p.name for p in saved.iterdir()} >= {
        "1_check.json", "2_identifiability.json", "3_fit.json", "4_validation.json",
        "5_diagnosis.json", "6_next.json", "model.toml", "diagnosis.html", "index.html"}
    errors = json.loads((saved / "4_validation.json").read_text())["facts"]["pooled"]
    assert errors["fitted"]["yaw_rate"] < errors["constant velocity"]["yaw_rate"]
    page = (saved / "index.html").read_text()
    assert "not run" not in page
    before = (saved / "3_fit.json").read_bytes()
    (saved / "4_validation.json").unlink()
    assert verb("study", folder, *FRAME_OPTION, "--out", saved, "--stage", "validation").code == 0
    assert json.loads((saved / "4_validation.json").read_text())["facts"]["pooled"] == errors
    assert (saved / "3_fit.json").read_bytes() == before


def test_a_study_without_a_usable_recording_states_why(verb, tmp_path):
    recording, _ = simulate_recording(5, seconds=4.0)
    write_table(table_of(recording, "B"), tmp_path / "short.csv")
    ran = verb("study", tmp_path / "short.csv", "--out", tmp_path / "study")
    assert ran.code == 1
    first = ran.out.split("First: ")[1].splitlines()[0]
    assert "short.csv is not used: marker frame not identified" in first
    assert "train: ;" not in ran.out


@pytest.mark.parametrize(("words", "what"), [
    ((), "no recording named"), (("gone.csv",), "no such file"),
    (("--stage", "guess", "x"), "guess")])
def test_wrong_words_are_refused(verb, words, what):
    ran = verb("study", *words)
    assert ran.code == 2
    assert what in ran.err
