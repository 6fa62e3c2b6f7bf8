"""Progress: from the first evaluations on, never back, and without a long stall."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.vehicle.load import find_model
from dart_lab.diagnosis import diagnose
from dart_lab.diagnosis.pace import ProgressEstimator
from dart_lab.identification.evidence.residuals import Evidence
from tests.diagnosis import searched

MAX_EVALUATIONS = 60  # evaluations of a model, a second of five minutes of driving


@pytest.mark.slow
def test_progress_never_stalls_and_never_goes_back(monkeypatch):
    evaluations = [0]
    reports = []
    residuals = Evidence.residuals

    def count_evaluation(self, *args, **more):
        evaluations[0] += 1
        return residuals(self, *args, **more)

    monkeypatch.setattr(Evidence, "residuals", count_evaluation)
    file, p = find_model("paper")
    diagnose(file, p, [searched.drive(seconds=12.0)], [searched.drive(seconds=8.0, seed=4)],
             only=("steering_lag", "grip"),
             progress=lambda share, what: reports.append((evaluations[0], share, what)))
    at, shares = (np.array([entry[i] for entry in reports], dtype=float) for i in (0, 1))
    assert (np.diff(shares) >= 0.0).all()
    assert shares[0] < 0.2
    assert shares[-1] <= 1.0
    moved = at[np.flatnonzero(np.diff(np.concatenate([[0.0], shares])) > 0.0)]
    assert np.diff(np.concatenate([[0.0], moved, [evaluations[0]]])).max() < MAX_EVALUATIONS


def test_a_phase_comes_near_its_end_and_the_next_begins_there():
    reports = []
    pace = ProgressEstimator(lambda share, what: reports.append((round(share, 3), what)))
    pace.start_phase(0.2, "fit", 10)
    for _ in range(1000):
        pace.count_evaluation()
    assert 0.19 < reports[-1][0] <= 0.2
    pace.set_share(0.5, "scan")
    assert reports[-1] == (0.5, "scan")
    pace.set_share(0.4, "scan")
    assert reports[-1][0] == 0.5


def test_without_a_callback_nothing_is_reported():
    pace = ProgressEstimator(None)
    pace.start_phase(1.0, "fit", 10)
    pace.count_evaluation()
    pace.set_share(0.5, "scan")
