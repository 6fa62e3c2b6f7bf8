"""Slopes of a fit do not depend on how many processes find them."""

from __future__ import annotations

import numpy as np
import pytest

from dart_lab.identification.evidence.space import MessageTiming
from dart_lab.identification.objective import evaluate_point, refit
from tests.diagnosis import searched


@pytest.mark.slow
def test_two_processes_find_what_one_does():
    of_drive = searched.evidence(searched.drive(seconds=20.0))
    noise, point = searched.fit_start(of_drive,
                                      free=("motor.d", "tyres.front_D", "delay.steering_s"))
    one = evaluate_point(of_drive, noise, point.space, point.x)
    start = point.space.point(MessageTiming())
    fits = [refit(of_drive, noise, point.space, start, jobs=jobs) for jobs in (1, 2)]
    assert one.jacobian.any(axis=0).sum() >= 3
    assert np.array_equal(fits[0].x, fits[1].x)
    assert np.array_equal(fits[0].jacobian, fits[1].jacobian)
