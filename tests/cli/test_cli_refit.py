"""A model that was refitted is marked against the truth of a car with much play."""

from __future__ import annotations

import pytest

from dart_hal.core.config import load_model
from dart_lab.diagnosis import conclude

# A car with much play (1.9 degrees), that was never calibrated.
LOOSE_CAR = "sim://?nano=mock&mocap=1&seed=43"
REFIT_SEED = 43


@pytest.mark.slow
@pytest.mark.parametrize("with_servo", [True, False])
@pytest.mark.long_except("True")
def test_steering_of_a_car_with_play_is_inside_its_intervals(verb, tmp_path, monkeypatch,
                                                             with_servo):
    """The control is a fit without the servo."""
    if not with_servo:
        monkeypatch.setattr(conclude, "fit_servo", lambda search, evidence, point, jobs: point)
    run = tmp_path / "steps.mcap"
    cars = tmp_path / "cars"
    assert verb("experiment", "steps", "--url", LOOSE_CAR, "--no-fit", "--out", run, "--cars",
                cars).code == 0
    model = cars / f"sim-{REFIT_SEED}" / "model.toml"
    model.parent.mkdir(parents=True, exist_ok=True)
    assert verb("diagnose", "--train", run, "--only", "gyro_latency", "--out", model).code == 0
    assert load_model(model).provenance["causes"] == []
    marks = verb("sim", "--reveal", "--url", LOOSE_CAR, "--against", cars, "--json").json["marks"]
    steering = [m["inside"] for m in marks if m["name"].startswith("steering.")]
    assert len(steering) == 5
    if not with_servo:
        assert sum(steering) <= 2
        return
    assert sum(steering) >= 4
    # Figures by which the intervals of the tyres are known to be too narrow.
    assert "standard errors of the tyres" in load_model(model).provenance["caution"]
    parts = {e.name: e.parameters["k"] for e in load_model(model).effects}
    assert parts["steering_rate_limit"].value == pytest.approx(0.098, abs=0.02)  # 6 rad/s
    assert 0.01 < parts["steering_backlash"].value < 0.04
    assert parts["steering_backlash"].std < 0.01
