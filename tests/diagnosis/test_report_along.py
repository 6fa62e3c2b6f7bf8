"""Means along a variable: standard errors by stretches, and the variable that shows a cause."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import apply
from dart_lab.diagnosis.report.along import (
    ResidualRows,
    _error,
    compute_curve,
    find_largest_change,
    list_columns,
)
from dart_lab.diagnosis.report.compared import stages_around
from dart_lab.diagnosis.result import Stage
from dart_lab.diagnosis.unexplained.features import FEATURE_UNITS
from dart_lab.identification.evidence.onboard import OnboardEvidence
from dart_lab.identification.evidence.onboard_drive import prepare_stretches
from tests.diagnosis import made_by_hand as made


def test_the_error_of_a_mean_counts_stretches_and_not_rows():
    rng = np.random.default_rng(0)
    stretch = np.repeat(np.arange(400), 20)
    shared = rng.normal(size=400)[stretch]  # every row of a stretch the same
    alone = rng.normal(size=8000)
    assert _error(shared, stretch) == pytest.approx(1 / np.sqrt(400), rel=0.15)
    assert _error(alone, stretch) == pytest.approx(1 / np.sqrt(8000), rel=0.15)
    assert np.isnan(_error(alone[:20], stretch[:20]))


def test_a_hidden_lag_shows_most_in_the_yaw_rate_along_the_steering_rate():
    d = made.diagnosis()
    rows = ResidualRows(d.evidence, d.extended)
    before, after = stages_around(d, 0)
    found = find_largest_change(rows, list_columns(d.evidence, "yaw_rate"), before, after,
                 ("yaw_rate", "steering_rate"))
    assert (found.column.channel, found.variable) == ("omega", "steering_rate")
    assert found.score > 0.2
    assert np.nanmax(np.abs(found.after.mean)) < 0.3 * np.nanmax(np.abs(found.before.mean))


def test_the_causes_in_the_other_order_are_not_confused():
    d = made.diagnosis()
    assert [s.label for s in stages_around(d, 1)] == ["+ steering_lag", "+ gyro_scale"]
    assert [s.label for s in stages_around(d, 0)] == ["refitted base", "+ steering_lag"]


@pytest.mark.slow
def test_a_stage_that_changes_nothing_has_nothing_to_show():
    d = made.diagnosis()
    rows = ResidualRows(d.evidence, d.extended)
    assert find_largest_change(rows, list_columns(d.evidence), d.stages[0], d.stages[1],
                               tuple(FEATURE_UNITS)) is None


def test_a_variable_that_does_not_vary_or_is_unknown_is_not_drawn():
    d = made.diagnosis()
    rows = ResidualRows(d.evidence, d.extended)
    column = list_columns(d.evidence, "vx")[0]
    assert compute_curve(rows, column, "recording", d.stages[0]) is None
    values = rows.features(column)
    values["speed"] = np.full_like(values["speed"], 0.7)
    assert compute_curve(rows, column, "speed", d.stages[0]) is None


def test_folding_adds_left_and_right_up():
    d = made.diagnosis()
    rows = ResidualRows(d.evidence, PAPER)
    gyro = list_columns(d.evidence, "gyro")
    plain, folded = (next(c for c in gyro if c.folded is f) for f in (False, True))
    scale_missing = d.stages[-2].residuals
    right, *_, left = rows.means(plain, "yaw_rate", scale_missing).mean
    assert np.sign(left) == -np.sign(right)
    means = rows.means(folded, "speed", scale_missing).mean
    assert (np.sign(means) == np.sign(left)).all()


def test_without_mocap_the_lag_shows_in_the_gyro():
    evidence = OnboardEvidence(prepare_stretches(made.recording()), PAPER.body.l_r)
    lag = apply(PAPER, "steering_lag", k=0.12)
    before, after = (Stage("", p, {}, evidence.residuals(p)) for p in (PAPER, lag))
    assert {c.channel for c in list_columns(evidence)} == {"encoder", "gyro", "accel_x", "accel_y"}
    found = find_largest_change(ResidualRows(evidence, lag), list_columns(evidence, "gyro"), before,
                                after, ("steering_rate",))
    assert (found.column.channel, found.variable) == ("gyro", "steering_rate")
    assert found.column.after == pytest.approx(0.3)
