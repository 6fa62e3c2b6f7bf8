"""When a delay counts as identified, and what a fit reports while it works."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from dart_hal.car.runs import read_any
from dart_hal.vehicle import PAPER
from dart_lab.identification.fit import MAX_TIME_STD
from dart_lab.identification.submodels import delay, fit_submodels
from dart_lab.identification.submodels.driving import StraightDriving
from dart_lab.identification.submodels.report import Ledger
from dart_lab.identification.submodels.steering_timing import ActuatorTiming

EXCERPT = Path(__file__).resolve().parents[1] / "recorded" / "data"
NOT_DRIVEN = StraightDriving(None, "held", 0, 0, 0, 0.0, 0.0, 0.0, 0, 0.0)


@pytest.mark.parametrize(("std", "offset", "identifiable"), [
    (0.9 * MAX_TIME_STD, True,
     True),  # a lag of zero can be identified: its error counts, not its share
    (1.1 * MAX_TIME_STD, True, False), (0.9 * MAX_TIME_STD, False, False)])
def test_a_time_is_reported_by_its_error_alone(monkeypatch, std, offset, identifiable):
    found = ActuatorTiming(np.array([0.03, 0.0]), std**2 * np.eye(2), offset, (), 100, 0.1, True)
    monkeypatch.setattr(delay, "read_yaw_response", lambda *_: object())
    monkeypatch.setattr(delay, "steering_timing", lambda _: found)
    fit = delay.fit_delay([object()], None, PAPER, NOT_DRIVEN, Ledger())
    assert fit.parameters["steering_s"].identifiable is identifiable
    assert fit.parameters["steering_lag_s"].identifiable is identifiable
    assert not fit.parameters["throttle_s"].identifiable  # held, nothing known of it


def test_progress_grows_and_names_what_comes():
    recordings, _ = read_any(sorted((EXCERPT / "19_step_input_data").glob("*15_28_11*")))
    reports: list[tuple[float, str]] = []
    fit_submodels(recordings, ("steering", "friction", "tyres"),
                  progress=lambda share, text: reports.append((share, text)))
    assert [text for _, text in reports] == ["straight driving", "steering", "tyres"]
    shares = [share for share, _ in reports]
    assert shares[0] == 0.0
    assert all(a < b < 1.0 for a, b in pairwise(shares))
