"""A marker frame that was fitted to the recordings is free within its errors."""

from __future__ import annotations

from dataclasses import replace

import pytest

from dart_hal.core.config.model import check_model
from dart_hal.recording.dart import Reference
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.flat import value
from dart_hal.vehicle.load import find_model
from dart_lab.diagnosis import diagnose
from dart_lab.diagnosis.frames import describe_frame, find_frame_errors, free_frame
from dart_lab.diagnosis.write import extended_model
from dart_lab.identification.evidence.space import Space
from tests.diagnosis.searched import drive

FRAME_STD = (0.0020, 0.0020, 0.0020)
OFFSET = 0.004
"""m; two standard errors."""


def add_frame(recording, offset=0.0, std=FRAME_STD):
    """The recording with a fitted frame, so far from where the markers are."""
    marker = recording.marker
    return replace(recording, marker=Reference(marker.lx + offset, marker.theta, marker.ly,
                                               "fitted to these recordings", std))


@pytest.mark.slow
def test_errors_are_those_of_a_frame_that_all_recordings_share():
    a = drive(seed=3)
    b = drive(seed=4)
    assert find_frame_errors([add_frame(a), add_frame(b)]) == {
        "mocap_offset_x.k": 0.002, "mocap_yaw.k": 0.002, "mocap_offset_y.k": 0.002}
    assert find_frame_errors([add_frame(a), add_frame(b, 0.001)]) == {}, "two mountings"
    assert find_frame_errors([a, b]) == {}, "known without an error"
    unknown = add_frame(a, std=(0.002, 0.002, float("nan")))
    assert "mocap_offset_y.k" not in find_frame_errors([unknown])
    assert find_frame_errors([]) == {}


def test_offset_that_a_model_has_stays():
    has = apply(PAPER, "mocap_offset_x", k=0.003)
    freed = free_frame(has, ["mocap_offset_x.k", "mocap_yaw.k"])
    assert [a.name for a in freed.effects] == ["mocap_offset_x", "mocap_yaw"]
    assert value(freed, "mocap_offset_x.k") == 0.003
    assert "+0.0030 m" in describe_frame(freed, ["mocap_offset_x.k"])[0]
    assert describe_frame(freed, []) == ()


def test_offset_that_is_free_is_one_coordinate_even_if_it_is_listed_twice():
    """A suggestion lists all that a refit has moved, offsets of the frame among it."""
    freed = free_frame(PAPER, ["mocap_offset_x.k"])
    space = Space(freed, ("tyres.front_D", "mocap_offset_x.k"), {"mocap_offset_x.k": 0.002})
    assert space.names == ("tyres.front_D", "mocap_offset_x.k")


@pytest.mark.slow
@pytest.mark.parametrize("refit", [False, True])
@pytest.mark.long_except("False")
def test_error_of_a_frame_is_no_cause(refit):
    """The negative control: the same error of a frame that is stated as known is one."""
    file, p = find_model("paper")
    train = drive(seconds=60.0, seed=3)
    test = drive(seconds=40.0, seed=4)
    fitted, known = (diagnose(file, p, [add_frame(train, OFFSET, std)],
                              [add_frame(test, OFFSET, std)],
                              refit=refit) for std in (FRAME_STD, None))
    assert not fitted.causes
    assert fitted.verdict in ("nothing_wrong", "parameters_only")
    moved = value(fitted.extended, "mocap_offset_x.k")
    assert moved == pytest.approx(-OFFSET, abs=0.0015)
    assert any("moves it, within its stated errors" in note for note in fitted.notes)
    written, of_known = (extended_model(d, file, [train]) for d in (fitted, known))
    assert written.effects == (), "it is of these recordings, and not of the car"
    assert check_model(written, "written") == written, "nor in its covariance"
    assert refit == ("diagnosis" in written.covariance)
    if not refit:
        assert "mocap_offset_x" in [e.name for e in of_known.effects]
        assert "mocap_offset_x" in [c.effect for c in known.causes]
