"""The coverage campaign: what it counts, and one car of it."""

from __future__ import annotations

import json

import numpy as np
import pytest

from studies.calibration import coverage
from studies.calibration.coverage import EACH, POOLED, rows_of
from studies.calibration.hidden_errors import errors, worst
from studies.calibration.joint_errors import calibrated, joint_errors, true_parameters

CARS = 400


def found(stated: float) -> list[dict[str, list[tuple[float, float]]]]:
    """Errors of 1 with standard errors of ``stated``; ring: 20 numbers a car."""
    rng = np.random.default_rng(3)
    return [{"bias": [(float(rng.normal()), stated)],
             "ring": [(float(e), 1.0) for e in rng.normal(size=20)]} for _ in range(CARS)]


def test_honest_intervals_are_honest():
    bias, ring, pooled = rows_of(found(1.0))
    assert all(EACH[0] < row.share < EACH[1] for row in (bias, ring))
    assert POOLED[0] < pooled.share < POOLED[1]
    assert pooled.share == pytest.approx(0.5 * (bias.share + ring.share))
    assert bias.rms == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("stated", [0.5, 2.0])
def test_control_wrong_intervals_are_detected(stated):
    bias, ring, pooled = rows_of(found(stated))
    assert not EACH[0] < bias.share < EACH[1]
    assert EACH[0] < ring.share < EACH[1]
    assert not POOLED[0] < pooled.share < POOLED[1]


def run_campaign(folder, monkeypatch, capsys, order):
    """Run "joint all" on four cars that a fake calibrates; return (what is printed, results)."""
    def calibrate(seed, car):
        car.mkdir(parents=True)
        (car / "calibration.toml").touch()
        return {"bias": [(0.1 * seed, 1.0)]}

    def fit_jointly(seed, car):
        # A car that nothing has calibrated gives other numbers.
        return {"motor.d": [(seed if (car / "calibration.toml").exists() else 9.0, 1.0)]}

    monkeypatch.setattr(coverage, "CARS", folder / "cars")
    monkeypatch.setattr(coverage, "calibrated", calibrate)
    monkeypatch.setattr(coverage, "joint_errors", fit_jointly)
    monkeypatch.setattr(coverage, "each", lambda work, items, *rest, **more: map(
        work, [items[k % len(items)] for k in order]))
    results = folder / "results.jsonl"
    monkeypatch.setattr("sys.argv", ["coverage", "joint", "all", "--seeds", "4", "--results",
                                     str(results)])
    coverage.main()
    return capsys.readouterr().out, results.read_text()


def test_the_answer_does_not_depend_on_the_order_in_which_workers_finish(tmp_path, monkeypatch,
                                                                         capsys):
    one, other = (run_campaign(tmp_path / name, monkeypatch, capsys, order)
                  for name, order in (("machine", range(4)), ("cluster", (2, 0, 3, 1))))
    assert one == other
    assert "9.0" not in one[1]
    assert [json.loads(line)["seed"] for line in one[1].splitlines()] == [1, 1, 2, 2, 3, 3, 4, 4]


@pytest.mark.long
def test_every_number_of_one_hidden_car_is_near_the_truth():
    z = worst(errors("all", 12))
    assert len(z) >= 25
    assert {name: round(x, 1) for name, x in z.items() if x > 4.0} == {}


def test_true_parameters_are_in_units_of_the_recorded_throttle():
    """Of an ESC that ends at 440 us the force per recorded throttle of 450 us is larger."""
    own, wide = true_parameters(7, 450.0), true_parameters(7, 900.0)
    assert wide["motor.d"] == pytest.approx(2.0 * own["motor.d"])
    assert wide["motor.g"] == pytest.approx(0.5 * own["motor.g"])
    assert own["delay.steering_s"] > 0.012  # the wait for a PWM frame and the pulse


@pytest.mark.long
def test_the_joint_fit_of_a_calibrated_hidden_car_is_near_the_truth(tmp_path):
    """Before commands counted from their writes 9 of 18 were beyond 3.8 standard errors."""
    calibrated(9001, tmp_path)
    z = worst(joint_errors(9001, tmp_path))
    assert len(z) == 18
    assert {name: round(x, 1) for name, x in z.items() if x > 3.3} == {}
