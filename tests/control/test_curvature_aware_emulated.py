"""MPCC and CA-MPCC on emulated cars: by the lidar's poses, and as the example has it."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from dart_hal.control.curvature_aware.generator import TUNED, PathWeights
from dart_hal.control.curvature_aware.progress import Law
from dart_hal.control.mpc.disturbance import MAX_ERROR
from dart_hal.control.mpc.planner import PlanOutcome
from studies.control.curvature_aware_emulated import drive
from studies.control.curvature_aware_uncalibrated import drive as uncalibrated

FOLDER = Path(__file__).parents[2] / "examples" / "use_cases"


@pytest.mark.slow
def test_a_lap_by_the_lidar():
    """A car that was not used before; localisation is part of the error."""
    found, follower = drive(4, Law.CA, TUNED, laps=1.0)
    assert follower.why == "the path is driven"
    assert found.rms < 0.03
    assert found.left == 0
    assert found.plan_end < 0.02
    assert set(follower.tracker.mpcc.outcomes.elements()) == {PlanOutcome.SOLVED}


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 8])
@pytest.mark.long_except("3")
def test_a_car_of_which_nothing_is_known_passes_and_keeps_its_lane(seed):
    """They were 0.8 and 0.9 m off their path, with what was learnt of the steering at its end
    (3) and with plans that no tyres hold (8)."""
    found = uncalibrated(seed)
    assert found.why == "the path is driven"
    assert found.clearance > 0.05
    assert found.most < 0.3
    assert np.abs(np.array(found.rows)[:, 4:]).max() < MAX_ERROR


@pytest.mark.long
@pytest.mark.parametrize("seed", [5, 6])
def test_the_plain_law_promises_more_on_every_car(seed):
    plain, aware = (drive(seed, law, PathWeights())[0] for law in (Law.MPCC, Law.CA))
    assert plain.plan_end > 0.03
    assert aware.plan_end < 0.4 * plain.plan_end


@pytest.mark.long
def test_the_example(monkeypatch, tmp_path):
    """By the diagnosed model: plans, tracking, and the obstacle is passed."""
    monkeypatch.syspath_prepend(str(FOLDER))
    spec = importlib.util.spec_from_file_location("curvature_aware",
                                                  FOLDER / "curvature_aware.py")
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    drives, air = example.main(tmp_path / "laps.png", tmp_path / "obstacle.gif")
    assert drives["CA-MPCC, published"][0] < 0.4 * drives["MPCC, published"][0]
    for name in ("MPCC, tuned", "CA-MPCC, tuned"):
        assert drives[name][1] < 0.025
        assert drives[name][3] == 0
    assert air > 0.03
    assert (tmp_path / "obstacle.gif").stat().st_size > 10_000
