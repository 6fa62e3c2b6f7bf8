"""Recordings of two floors or cars, and test recordings of another floor, are recognised."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.load import find_model
from dart_lab.diagnosis import diagnose
from dart_lab.diagnosis.cautions import AT_BOUND, list_cautions
from dart_lab.diagnosis.gains import make_recording_set
from dart_lab.diagnosis.grade.alike import PROBES, SizesByRecording, find_groups
from dart_lab.diagnosis.policy import USUAL, TwoCarsPolicy
from dart_lab.diagnosis.result import ParameterChange
from dart_lab.diagnosis.run import make_evidence
from dart_lab.identification.evidence.noise import estimate_noise
from dart_lab.identification.evidence.space import (
    MAX_COMMAND_AGE,
    MESSAGE_AGE_REACH,
    MessageTiming,
    Space,
)
from dart_lab.identification.objective import evaluate_point
from studies.diagnosis import hidden_drive
from studies.diagnosis.known_frame import read
from tests.diagnosis.onboard_files import record_onboard

SLIPPERY = apply(PAPER, "grip", k=-0.25)
WEAK = apply(PAPER, "motor_gain", k=-0.12)
SLACK = apply(PAPER, "steering_backlash", k=0.06)


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """drive(car, seed): half a minute of it, made once."""
    folder = tmp_path_factory.mktemp("alike")
    made = {}

    def record_once(name, car, seed):
        if (name, seed) not in made:
            plan = hidden_drive.Plan(seconds=30.0)
            made[name, seed] = read(hidden_drive.write(folder / f"{name}_{seed}.csv", car,
                                                       seed=seed, plan=plan))
        return made[name, seed]

    return record_once


def side(recordings):
    evidence, _ = make_evidence(recordings, PAPER.body.l_r)
    return make_recording_set(evidence, recordings, PAPER.body.l_r, None)


def list_warnings(train, test, p=PAPER, policy=USUAL):
    """The warnings with a fit that ends at the paper's car."""
    sides = side(train), side(test)
    of_side = sides[0].evidence
    space = Space(p, ())
    noise = estimate_noise(of_side.residuals(p, MessageTiming()), of_side.blocks())
    last = evaluate_point(of_side, noise, space, space.point(MessageTiming()))
    return " ".join(list_cautions(last, sides, {}, {}, (), policy))


def names(recordings):
    return " ".join(r.name for r in recordings)


@pytest.mark.slow
def test_one_car_on_one_floor_is_not_two(drive):
    same = [drive("same", PAPER, i) for i in range(4)]
    assert list_warnings(same[:3], same[3:]) == ""


@pytest.mark.slow
def test_what_the_model_lacks_is_no_other_floor(drive):
    same = [drive("slack", SLACK, i) for i in range(4)]
    assert list_warnings(same[:3], same[3:]) == ""


@pytest.mark.parametrize(("other", "what"), [(SLIPPERY, "grip"), (WEAK, "drive force")])
@pytest.mark.slow
def test_two_floors_or_cars_are_distinguished_by_name(drive, other, what):
    ours = [drive("same", PAPER, i) for i in range(2)]
    theirs = [drive(what.partition(" ")[0], other, i) for i in range(3)]
    warnings = list_warnings([ours[0], theirs[0], ours[1], theirs[1]], theirs[2:])
    assert what in warnings
    assert "two floors or cars" in warnings
    assert f"--train {names(theirs[:2])}" in warnings
    assert f"--train {names(ours)}" in warnings


@pytest.mark.slow
def test_a_test_set_of_another_floor_is_reported(drive):
    warnings = list_warnings([drive("same", PAPER, i) for i in range(3)],
                             [drive("grip", SLIPPERY, 0)])
    assert "the test recordings look like another floor or car" in warnings
    assert "grip is -0.2" in warnings


@pytest.mark.slow
def test_without_the_errors_of_the_sizes_one_floor_would_be_two(drive):
    """Control: what the model lacks makes every drive want a little else."""
    same = [drive("slack", SLACK, i) for i in range(4)]
    blind = replace(USUAL, two_cars=TwoCarsPolicy(
        min_difference_stds=0.0, min_difference_sizes=0.0, min_spread_ratio=0.0))
    assert "floor" in list_warnings(same[:3], same[3:], policy=blind)


@pytest.mark.slow
def test_by_its_own_sensors_a_car_is_distinguished_from_another(tmp_path):
    """No floor then: how much a tyre holds hides in what no sensor sees. Control: one car."""
    ours, theirs = ([record_onboard(tmp_path, p, seed, 30.0) for seed in seeds] for p, seeds in (
        (PAPER, (1, 2, 3)), (WEAK, (4, 5))))
    warnings = list_warnings([*ours[:2], theirs[0]], [theirs[1]])
    assert "two floors or cars" in warnings
    assert "drive force" in warnings
    assert f"--train {names(theirs[:1])}" in warnings
    assert list_warnings(ours[:2], ours[2:]) == ""


@pytest.mark.slow
@given(st.integers(0, 2**32), st.integers(2, 12))
@settings(max_examples=50, deadline=None)
def test_noise_of_its_stated_size_is_no_second_floor(seed, n):
    rng = np.random.default_rng(seed)
    error = rng.uniform(0.003, 0.03, (n, len(PROBES)))
    sizes = SizesByRecording(tuple(map(str, range(n))),
                             error * rng.standard_normal(error.shape), error)
    assert find_groups(sizes, USUAL.two_cars) is None


def test_a_parameter_or_a_time_on_its_bound_is_reported(drive):
    one = [drive("same", PAPER, 0)]
    sides = side(one), side([drive("same", PAPER, 1)])
    of_side = sides[0].evidence
    space = Space(PAPER, ())
    noise = estimate_noise(of_side.residuals(PAPER, MessageTiming()), of_side.blocks())
    x = space.point(MessageTiming())
    x[1] = MAX_COMMAND_AGE / MESSAGE_AGE_REACH  # of commands, the oldest there is
    moved = {"tyres.front_B": ParameterChange(11.9, 13.8, 0.5, "1/rad", AT_BOUND),
             "motor.d": ParameterChange(28.0, 27.0, 0.1, "N")}
    point = evaluate_point(of_side, noise, space, x)
    edges = [n for n in list_cautions(point, sides, moved, {}, (), USUAL) if AT_BOUND in n]
    assert len(edges) == 2
    assert edges[0].startswith("tyres.front_B ended")
    assert "100 ms before its commands" in edges[1]
    x[1] *= 0.9  # control: where there is still room, nothing is reported
    free = {name: replace(m, doubt="") for name, m in moved.items()}
    point = evaluate_point(of_side, noise, space, x)
    assert not any(AT_BOUND in n for n in list_cautions(point, sides, free, {}, (), USUAL))


@pytest.mark.slow
def test_a_whole_diagnosis_reports_it(drive):
    file, p = find_model("paper")
    train = [drive("same", PAPER, 0), drive("grip", SLIPPERY, 0), drive("same", PAPER, 1)]
    found = diagnose(file, p, train, [drive("grip", SLIPPERY, 1)])
    assert any("two floors or cars" in note for note in found.notes)
