"""A car that is the model is predicted without error; one that is not, is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.recording.dart import Reference
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.sets import PAPER, UPSTREAM_2024
from dart_lab.identification.evaluation import (
    errors,
    evaluate,
    kinematic,
    measured,
    predict,
    predict_ctrv,
    score,
)
from dart_lab.identification.evaluation.prediction import CHANNELS
from dart_lab.identification.evaluation.takeover import predict_at_measured_speed
from dart_lab.identification.prediction import rollout
from dart_lab.identification.prediction.rollout import BATCH_WINDOWS
from tests.recorded.simulated_recording import simulate_recording


@pytest.mark.parametrize("p", [PAPER, kinematic(PAPER), UPSTREAM_2024],
                         ids=["dynamic", "kinematic", "with lags"])
def test_its_own_car_is_predicted_exactly(driven, p):
    cases = [driven(p, weave=0.5), driven(p, file="other", steering=-0.3, seconds=9.0)]
    e = errors(predict(p, cases), measured(cases))
    assert e.shape == (3, 5, sum(map(len, cases)))
    assert np.abs(e).max() < 1e-9


def test_another_car_is_not(driven):
    cases = [driven(PAPER, weave=0.5)]
    late = replace(PAPER, delay=replace(PAPER.delay, steering_s=0.05))
    e = score(errors(predict(late, cases), measured(cases)), cases)
    assert e.rmse(1.0)["yaw_rate"] > 0.05
    assert e.rmse(2.0)["position"] > e.rmse(0.5)["position"] > 0.0


def test_the_memory_bound_changes_nothing(driven, monkeypatch):
    cases = [driven(PAPER, weave=0.4, seconds=12.0)]
    whole = predict(PAPER, cases)
    monkeypatch.setattr(rollout, "BATCH_WINDOWS", 7)
    sizes = []
    assert np.array_equal(predict(PAPER, cases, sizes.append), whole)
    assert sizes == sorted(sizes)
    assert sizes[-1] == 1.0
    assert len(sizes) == -(-len(cases[0]) // 7)
    assert BATCH_WINDOWS > 7


def test_holding_is_exact_on_a_circle_and_on_a_straight(driven):
    circle = driven(kinematic(PAPER), throttle=0.24, steering=0.6, seconds=30.0)
    late = replace(circle, windows=replace(circle.windows, start=circle.windows.start[-20:]))
    e = errors(predict_ctrv([late]), measured([late]))
    assert np.abs(late.grid.omega[-1]) > 0.5
    assert np.abs(e[-1]).max() < 2e-4, "the speed is steady within some 1e-5 m/s"
    g = circle.grid
    straight = replace(late, grid=replace(
        g, x=0.8 * g.t, y=0.6 * g.t, yaw=np.full(len(g), np.arctan2(0.6, 0.8)),
        v_x=np.ones(len(g)), v_y=np.zeros(len(g)), omega=np.zeros(len(g))))
    assert np.abs(errors(predict_ctrv([straight]), measured([straight]))).max() < 1e-12


def test_holding_with_lateral_velocity_turns_the_velocity_too(driven):
    case = driven(PAPER)
    t, om, vx, vy = case.grid.t, 1.3, 0.9, 0.2
    yaw = 0.4 + om * t
    fine = np.linspace(0.0, 1.0, 100_001)[:-1] + 5e-6
    turn = 0.4 + om * (case.grid.t[case.windows.start[0]] + fine)
    mean = np.mean(vx * np.cos(turn) - vy * np.sin(turn))
    g = replace(case.grid, x=0 * t, y=0 * t, yaw=yaw, v_x=vx + 0 * t, v_y=vy + 0 * t,
                omega=om + 0 * t)
    x = predict_ctrv([replace(case, grid=g)])[1, 0, 0]
    assert x == pytest.approx(mean, abs=1e-9)


def test_yaw_counts_turns_and_position_is_a_distance(driven):
    cases = [driven(PAPER)]
    truth = measured(cases)
    wrong = truth.copy()
    wrong[:, 0] += 3.0
    wrong[:, 1] -= 4.0
    wrong[:, 2] += 2.0 * np.pi
    e = errors(wrong, truth)
    assert e[:, CHANNELS.index("position")] == pytest.approx(5.0)
    assert e[:, CHANNELS.index("yaw_deg")] == pytest.approx(360.0)


def test_a_diverged_prediction_is_infinitely_wrong_and_is_counted(driven):
    cases = [driven(PAPER)]
    truth = measured(cases)
    lost = truth.copy()
    lost[2, 3, 4] = np.nan
    s = score(errors(lost, truth), cases)
    assert s.rmse(2.0)["vx"] == np.inf
    assert s.rmse(1.0)["vx"] == 0.0
    assert s.to_json()["2.0"]["pooled"]["diverged"] == 1
    assert "diverged" not in s.to_json()["1.0"]["pooled"]


def test_at_the_measured_speed_only_the_turning_is_predicted(driven):
    cases = [driven(PAPER, weave=0.5)]
    weak = replace(PAPER, motor=replace(PAPER.motor, d=15.0))
    free, given = predict(weak, cases)[1], predict_at_measured_speed(weak, cases)
    truth = measured(cases)[1]
    assert np.abs(free[3] - truth[3]).max() > 0.3
    assert np.abs(given[3] - truth[3]).max() < 0.03
    assert np.abs(given[5] - truth[5]).max() < 0.1 * np.abs(free[5] - truth[5]).max()
    speed = cases[0].grid.v_x[cases[0].windows.start]
    assert np.array_equal(measured(cases, (0,))[0, 3], speed), "untouched"


def test_effects_of_the_model_on_the_poses_are_removed_from_them():
    """A marker frame that is 0.05 rad off, and a model that knows it; control: the frame alone."""
    frame = Reference(0.1, 0.02, 0.0)
    wrong = replace(frame, theta=0.07)
    recording, _ = simulate_recording(3, seconds=20.0, frame=frame)
    right = evaluate(PAPER, [recording], reference=frame, limit=False)
    turned = evaluate(PAPER, [recording], reference=wrong, limit=False)
    freed = evaluate(apply(PAPER, "mocap_yaw", k=0.05), [recording], reference=wrong, limit=False)
    assert freed.model.rmse(1.0)["vy"] == pytest.approx(right.model.rmse(1.0)["vy"], rel=0.01)
    assert turned.model.rmse(1.0)["vy"] > 2.0 * right.model.rmse(1.0)["vy"]
    assert "mocap_yaw" in freed.notes[0]
