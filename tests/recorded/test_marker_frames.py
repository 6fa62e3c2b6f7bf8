"""The marker frame: of published files known, of all others fitted, and never assumed."""

from __future__ import annotations

import gzip
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from dart_hal.core.errors import RecordingError
from dart_hal.recording.check import check
from dart_hal.recording.dart import Reference, fit_reference, grid, read, with_marker_frames
from dart_hal.recording.dart import reference as reference_module
from dart_hal.recording.dart.reference import SEP_24, Y_2025, difference, find_tabulated
from dart_hal.vehicle.sets import PAPER, UPSTREAM_2024
from tests.recorded.simulated_recording import simulate_recording, table_of, write_table

FREE = "91_free_driving_16_sept_2024/car_1_Datarecording_09_16_2024_10_01_01.csv.gz"
ALLOWED = 2.6
"""Standard errors; normal ones exceed it in 1 of 100 cases."""


def fit_frame(recording):
    return with_marker_frames([recording])[0]


def kinds(recording) -> set[str]:
    return {note.kind for note in recording.notes}


def z_scores(fitted: Reference, true: Reference) -> np.ndarray:
    pairs = ((fitted.lx, true.lx), (fitted.theta, true.theta), (fitted.ly, true.ly))
    return np.array([(a - b) / s for (a, b), s in zip(pairs, fitted.std, strict=True)
                     if np.isfinite(s)])


def changed_copy(source: Path, target: Path) -> Path:
    """A published file with one digit of one cell changed."""
    text = gzip.decompress(source.read_bytes()).decode()
    lines = text.splitlines(keepends=True)
    lines[5000] = lines[5000].replace("0", "1", 1)
    target.write_text("".join(lines))
    return target


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("base", [PAPER, UPSTREAM_2024], ids=lambda p: p.name)
@pytest.mark.slow_except("paper-0", "upstream-2024-1")
def test_frame_of_a_simulated_car_is_fitted_within_its_standard_errors(base, seed):
    recording, true = simulate_recording(seed, base)
    fitted = fit_reference([recording])
    assert np.abs(z_scores(fitted, true)).max() < ALLOWED
    assert fitted.std[0] < 0.01, "an error that is too wide would accept anything"


@pytest.mark.slow
@pytest.mark.parametrize("base", [PAPER, UPSTREAM_2024], ids=lambda p: p.name)
def test_stated_errors_of_the_frame_hold_over_many_drives(base):
    z = np.concatenate([z_scores(fit_reference([r]), true)
                        for r,
                        true in (simulate_recording(seed, base) for seed in range(100, 130))])
    assert (np.abs(z) < ALLOWED).mean() > 0.95


def test_fit_without_the_error_of_the_equation_states_too_small_errors(monkeypatch):
    """Negative control: with the scatter alone the truth lies outside."""
    monkeypatch.setattr(reference_module, "SLIP_ERROR", 0.0)
    z = [abs(z_scores(fit_reference([r]), true)[0])
         for r, true in (simulate_recording(seed, UPSTREAM_2024) for seed in range(2))]
    assert max(z) > ALLOWED


def test_markers_that_are_mounted_backwards_are_found(tmp_path):
    true = Reference(0.12, 3.0, 0.0, "backwards")
    recording, _ = simulate_recording(5, frame=true)
    read_again = read(write_table(table_of(recording), tmp_path / "turned.csv"))
    fitted = fit_reference([read_again])
    assert fitted.theta == pytest.approx(3.0, abs=ALLOWED * fitted.std[1])
    assert fitted.lx == pytest.approx(0.12, abs=ALLOWED * fitted.std[0])


@pytest.mark.parametrize("schema", ["B", "C"])
@pytest.mark.slow_except("C")
def test_date_and_schema_give_no_frame(schema, tmp_path):
    """The files are of September 2024, or of schema C, and of another car than DART's."""
    recording, true = simulate_recording(1)
    made = fit_frame(read(write_table(table_of(recording, schema), tmp_path / "own.csv")))
    assert find_tabulated(made) == (SEP_24 if schema == "B" else Y_2025), "what was assumed before"
    assert not made.published
    assert np.abs(z_scores(made.marker, true)[:2]).max() < ALLOWED
    assert "marker" in kinds(made)
    assert abs(made.marker.theta - find_tabulated(made).theta) > 10.0 * made.marker.std[1]


def test_published_file_has_the_frame_of_the_table(excerpt):
    made = fit_frame(read(excerpt / FREE))
    assert made.published
    assert made.marker == SEP_24
    assert "marker_differs" not in kinds(made)


def test_changed_copy_of_a_published_file_is_fitted_and_agrees_with_the_table(excerpt, tmp_path):
    made = fit_frame(read(changed_copy(excerpt / FREE, tmp_path / "copy.csv")))
    assert not made.published
    assert made.marker != SEP_24
    assert np.abs(z_scores(made.marker, SEP_24)).max() < ALLOWED
    assert difference(SEP_24, made.marker) == ""


@pytest.mark.parametrize(("steering", "why"), [(0.02, "straight"), (0.0, "straight")])
def test_drive_with_too_few_turns_is_not_given_a_frame(steering, why, tmp_path):
    recording, _ = simulate_recording(2, seconds=30.0, steering=steering)
    made = fit_frame(read(write_table(table_of(recording), tmp_path / f"{why}.csv")))
    assert made.marker is None
    note = next(n for n in made.notes if n.kind == "reference_unknown")
    assert "--reference" in note.why
    assert any(f.kind == "reference_unknown" and f.serious for f in check(made).findings)
    with pytest.raises(RecordingError, match="marker frame") as caught:
        grid(made)
    assert "--reference" in caught.value.remedy


def test_circles_to_one_side_give_no_frame(write, table_b):
    made = fit_frame(read(write(table_b(n=2000, speed=0.8))))
    assert made.marker is None
    assert "reference_unknown" in kinds(made)


def test_straight_drive_gets_the_frame_of_the_other_drives_of_its_day():
    turning, true = simulate_recording(3)
    straight, _ = simulate_recording(4, seconds=20.0, steering=0.0, frame=true)
    together = with_marker_frames([turning, straight])
    assert together[0].marker == together[1].marker
    assert "2 recordings" in next(n.why for n in together[1].notes if n.kind == "marker")


@pytest.mark.slow
def test_recordings_of_two_mountings_on_one_day_keep_their_own_frames():
    first, one = simulate_recording(6, UPSTREAM_2024)
    second, two = simulate_recording(7, UPSTREAM_2024)
    made = with_marker_frames([first, second])
    for recording, true in zip(made, (one, two), strict=True):
        assert np.abs(z_scores(recording.marker, true)[:2]).max() < ALLOWED
        assert "not like the others" in next(n.why for n in recording.notes if n.kind == "marker")


def test_given_frame_that_contradicts_the_driving_is_cautioned():
    recording, true = simulate_recording(8, UPSTREAM_2024)
    wrong = Reference(true.lx - 0.05, true.theta + 0.02, true.ly, "given by --reference")
    cautioned = with_marker_frames([recording], wrong)[0]
    assert cautioned.marker == wrong, "what is given is used"
    note = next(n for n in cautioned.notes if n.kind == "marker_differs")
    assert "L_x by -0.0" in note.why
    assert "standard errors" in note.why
    right = with_marker_frames([recording], replace(true, source="given by --reference"))[0]
    assert "marker_differs" not in kinds(right)


@pytest.mark.slow
def test_frame_of_the_zheng_car_agrees_with_an_independent_fit(other_cars):
    made = fit_frame(read(other_cars / "zheng2022" / "day1.csv.gz"))
    assert made.marker.lx == pytest.approx(0.21, abs=ALLOWED * made.marker.std[0])
    assert made.marker.theta == pytest.approx(-0.0117, abs=ALLOWED * made.marker.std[1])
    assert made.marker.std[0] < 0.01


@pytest.mark.slow
def test_drive_without_turns_gets_no_frame_where_its_day_has_two(tmp_path):
    """It may be of either mounting."""
    first, _ = simulate_recording(6, UPSTREAM_2024)
    second, _ = simulate_recording(7, UPSTREAM_2024)
    straight, _ = simulate_recording(4, seconds=20.0, steering=0.0)
    made = with_marker_frames([first, second, straight])
    assert made[2].marker is None
    assert "reference_unknown" in kinds(made[2])


def read_with_one_sided_circles(excerpt, write, table_b, seconds: float = 0.0) -> list:
    """A published drive, and circles to one side that begin some seconds after it."""
    published = read(excerpt / FREE)
    circles = read(write(table_b(n=2000, speed=0.8)))
    moved = replace(circles.mocap, epoch=published.mocap.epoch + seconds)
    return with_marker_frames([published, replace(circles, mocap=moved)])


def test_circles_to_one_side_take_the_known_frame_of_their_day(excerpt, write, table_b):
    published, circles = read_with_one_sided_circles(excerpt, write, table_b)
    assert circles.marker == published.marker == SEP_24
    note = next(n.why for n in circles.notes if n.kind == "marker_of_day")
    assert note.startswith("caution")
    assert any(f.kind == "marker_of_day" and f.serious for f in check(circles).findings)
    assert "same car" in note


@pytest.mark.slow
def test_circles_of_another_day_or_car_take_no_known_frame(excerpt, write, table_b):
    published, circles = read_with_one_sided_circles(excerpt, write, table_b, 86_400.0)
    assert circles.marker is None
    red = SimpleNamespace(name="red", geometry=PAPER.body)
    circles = replace(circles, mocap=replace(circles.mocap, epoch=published.mocap.epoch),
                      framed=False)
    published = replace(published, framed=False)
    assert with_marker_frames([published, circles])[1].marker == SEP_24, "control"
    for pair in ([published, replace(circles, car=red)], [replace(published, car=red), circles]):
        assert with_marker_frames(pair)[1].marker is None
