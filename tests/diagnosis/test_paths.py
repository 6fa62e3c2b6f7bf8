"""Paths in the worst and the median window are those of the errors that the evaluation states."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest

from dart_hal.vehicle import PAPER
from dart_lab.diagnosis.gains import RecordingSet
from dart_lab.diagnosis.paths import find_paths
from tests.diagnosis import made_by_hand as made


def test_windows_are_the_worst_and_the_median_of_the_position_error_at_their_end():
    worst, median = made.paths(2)
    position = made.side().errors(PAPER)[-1, 3]
    assert (worst.kind, median.kind) == ("worst", "median")
    assert worst.error == position.max()
    assert median.error == pytest.approx(np.median(position), rel=0.05)
    assert worst.windows == len(position)


@pytest.mark.parametrize("kind", [0, 1])
def test_path_of_the_model_ends_as_far_from_the_measured_one_as_the_error_states(kind):
    window = made.paths(2)[kind]
    end = window.paths["refitted"][:, -1] - window.paths["measured"][:, -1]
    assert np.hypot(*end) == pytest.approx(window.error, rel=1e-6)
    better = window.paths["extended"][:, -1] - window.paths["measured"][:, -1]
    assert np.hypot(*better) < window.error


def test_paths_begin_at_the_origin_and_head_along_x():
    for window in made.paths(2):
        assert set(window.paths) == {"measured", "given", "refitted", "extended"}
        for xy in window.paths.values():
            assert xy.shape == (2, 41)
            assert xy[:, 0] == pytest.approx([0.0, 0.0], abs=1e-9)
            assert xy[0, 2] > 3.0 * abs(xy[1, 2])  # 0.1 s ahead, the car has not turned yet


def test_without_motion_capture_there_is_no_path():
    side = RecordingSet(made.side().evidence, None)
    assert find_paths(side, {"given": PAPER}, "given") == ()


@pytest.mark.parametrize("lost", [20, 195])
def test_windows_without_a_finite_prediction_are_not_chosen(lost):
    errors = made.side().errors(PAPER).copy()
    ordered = np.sort(errors[-1, 3])[::-1]
    errors[:, :, errors[-1, 3] >= ordered[lost - 1]] = np.inf
    side = SimpleNamespace(errors=lambda p: errors, prepared=made.side().prepared,
                           evidence=made.side().evidence)
    found = find_paths(side, {"given": PAPER}, "given")
    if lost == len(ordered):
        assert found == ()
    else:
        assert found[0].error == ordered[lost]


def test_paths_are_plain_numbers_in_the_answer():
    answer = json.loads(json.dumps([w.to_json() for w in made.paths(1)]))
    assert answer[0]["paths"]["measured"][0][-1] == pytest.approx(
        made.paths(1)[0].paths["measured"][0, -1], abs=6e-4)
