"""A small version of ``python -m studies.localisation.figures``: two rooms, half a minute."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.estimation.localisation.field import map_of_lines
from dart_hal.estimation.localisation.health import Status
from dart_hal.estimation.localisation.localiser import Localiser
from studies.localisation.world import Drive, drive, hidden, run


@pytest.fixture(scope="module")
def quick() -> Drive:
    return drive(2003, hidden(2003, speed=2.0, seconds=15.0))


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.slow
def test_a_car_of_hidden_errors_is_followed_at_two_metres_per_second(quick):
    found = run(quick)
    assert len(found.off) == len(quick.scans)
    assert rms(found.off) < 0.01
    assert found.off.max() < 0.06        # while the errors are learnt
    assert found.off[25:].max() < 0.03
    assert rms(found.yaw[40:]) < np.radians(0.2)
    assert 0.2 < found.nees.mean() < 5.0


@pytest.mark.slow
def test_without_deskewing_it_is_three_times_worse(quick):
    """The negative control, with the better of the single stamps."""
    begun = replace(quick, scans=quick.scans[:40])
    assert rms(run(begun, deskew=False).off) > 3.0 * rms(run(begun).off)


@pytest.mark.slow
def test_the_hidden_errors_are_learnt():
    hid = hidden(2001, seconds=20.0)
    belief = run(drive(2001, hid)).localiser.belief
    truth = np.array((hid.travel, hid.bias, hid.gyro, hid.slip, hid.late))
    off = belief.mean[3:8] - truth
    assert (np.abs(off) < (0.005, 0.004, 0.004, 0.012, 0.003)).all()


@pytest.mark.slow
def test_a_wrong_pose_is_reported_within_three_scans(quick):
    local = Localiser(quick.chart, (1.0, 1.0, 0.3))
    results = run(quick, localiser=local).told[:3]
    assert [result.status for result in results if result][-1] is Status.LOST


def test_the_field_is_the_distance_to_lines_and_nothing_pulls_outside():
    chart = map_of_lines(np.array(((0.0, 0.0, 2.0, 0.0),)))
    d, gx, gy = chart.look(np.array((1.0, 1.0, 1.0, 9.0)), np.array((0.3, -0.2, 0.55, 9.0)))
    assert np.allclose(d, (0.3, 0.2, 0.55, 0.6), atol=1e-3)
    assert np.allclose(gx, 0.0, atol=1e-6)
    assert np.allclose(gy, (1.0, -1.0, 1.0, 0.0), atol=1e-3)
