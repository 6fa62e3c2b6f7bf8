"""Every threshold of the diagnosis is in its policy, has a description, and is used."""

from __future__ import annotations

import ast
import re
from dataclasses import FrozenInstanceError, fields, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from dart_hal.core.errors import RecordingError
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.scale import REFERENCE_SCALE, Scale
from dart_lab.diagnosis import policy as module
from dart_lab.diagnosis.inputs import check_inputs
from dart_lab.diagnosis.policy import USUAL, InputPolicy, Policy
from dart_lab.diagnosis.question import DiagnosisSetup
from dart_lab.diagnosis.search.selection import Settings
from dart_lab.identification.evidence import policy as evidence_policy
from studies.diagnosis import policy_sensitivity as sensitivity
from studies.diagnosis.policy_sensitivity import Watched, altered, changed, list_thresholds, usual
from tests.diagnosis.searched import drive, names, search

POLICY_FOLDER = Path(module.__file__).parent
GRIDS = {"MAX_FIT_ITERATIONS", "MAX_REUSE_ITERATIONS", "MIN_SQUARED_CHANGE",
         "BASE_NOISE_PASSES", "MAX_NOISE_PASSES", "VOLUME_TOLERANCE",
         "MAX_NOISE_SEPARATIONS", "CERTAIN_RATIO", "MAX_EXPLANATIONS", "MIN_KEPT_SHARE",
         "MIN_GAIN_SHARE", "MIN_LOSS_DIFFERENCE", "NULL_DRAWS", "SLOPE_TOLERANCE", "LADDER",
         "DENSE_LADDER", "PEAK_TOLERANCE", "MAX_REFINEMENTS", "PREDICTION_TOLERANCE",
         "MIN_SIZE_STEP", "MAX_BISECTIONS", "MIN_PROPORTION"}
"""Numbers of a search that decide no name: iterations, starts, rounding, sizes that are tried, and
what changed no answer when it was halved or doubled in the cases of docs/results/ablation.md."""


def bare(text):
    """Fields of dataclasses that no comment explains."""
    return re.findall(r"^    (\w+): (?:float|int|tuple\[.*\]) = [^#\n]*$", text, flags=re.M)


def test_every_threshold_has_a_description():
    for one in (module, evidence_policy):
        assert bare(Path(one.__file__).read_text(encoding="utf-8")) == []
    assert bare("    close: float = 0.7\n") == ["close"]


def test_every_threshold_is_used():
    text = "".join(p.read_text(encoding="utf-8") for p in POLICY_FOLDER.parent.rglob("*.py")
                   if p.name != "policy.py")
    for group in fields(USUAL):
        for one in fields(getattr(USUAL, group.name)):
            assert re.search(rf"\.{one.name}\b", text), f"{group.name}.{one.name}"


def test_the_search_has_no_threshold_of_its_own():
    found = {target.id for path in (POLICY_FOLDER / "search").glob("*.py")
             for node in ast.parse(path.read_text(encoding="utf-8")).body
             if isinstance(node, ast.Assign) and any(isinstance(n, ast.Constant) and isinstance(
                 n.value, float | int) for n in ast.walk(node.value))
             for target in ast.walk(node.targets[0]) if isinstance(target, ast.Name)}
    assert found <= GRIDS


def test_a_policy_is_frozen_and_equal_to_its_like():
    with pytest.raises(FrozenInstanceError):
        USUAL.naming = USUAL.naming
    assert Policy() == USUAL
    assert changed(USUAL, "naming.min_size", 1.0) != USUAL


def test_thresholds_of_1_10_are_those_of_the_scale_1_and_others_follow_the_car():
    assert USUAL.at_scale(REFERENCE_SCALE) == USUAL
    large = USUAL.at_scale(Scale(length=16.0, force=512.0))
    assert large.inputs.min_speed == 4.0 * USUAL.inputs.min_speed
    assert large.inputs.min_yaw_rate == 0.25 * USUAL.inputs.min_yaw_rate
    assert large.evidence.min_encoder_speed == 4.0 * USUAL.evidence.min_encoder_speed
    assert large.unexplained.max_waves == USUAL.unexplained.max_waves / 16.0
    assert large.inputs.max_lateral_accel == USUAL.inputs.max_lateral_accel, "an acceleration"
    assert large.noise == USUAL.noise, "of sensors"


def test_a_recording_too_short_for_one_policy_is_long_enough_for_another():
    short = [drive(seconds=12.0)]
    assert check_inputs(short, [], PAPER, policy=InputPolicy(train_s=5.0)).train
    with pytest.raises(RecordingError, match="too little driving"):
        check_inputs(short, [], PAPER, policy=InputPolicy(train_s=60.0))


@pytest.mark.slow
def test_a_search_decides_by_the_policy_that_it_is_given():
    lag = drive(("steering_lag", 0.06), seed=8)
    assert names(search(lag, names=("steering_lag",))) == ["steering_lag"]
    strict = changed(USUAL, "naming.min_size", 100.0)
    assert names(search(lag, names=("steering_lag",), policy=strict)) == []


@pytest.mark.slow
def test_the_loss_is_that_of_the_policy():
    one = ("gyro_bias",)
    found = search(drive(), names=one)
    other = search(drive(), names=one, policy=replace(
        USUAL, noise=replace(USUAL.noise, robust=6.0)))
    assert other.noise.policy.robust == 6.0
    assert not np.array_equal(other.noise.motion, found.noise.motion)


def test_a_watched_threshold_decides_as_it_is_and_notes_what_half_and_double_would():
    noted = set()
    share = Watched.of(0.5, (0.25, 1.0), noted)
    for gain in (10.0, np.float64(10.0)):
        assert not gain * 0.2 > share * gain
        assert not noted, "nothing to note: 2 is below 2.5, 5 and 10"
    assert np.float64(6.0) > share * np.float64(10.0)
    assert noted == {1}, "6 is above 5 and below 10"
    assert max(3.0, share * 10.0) == 5.0
    assert noted == {0, 1}, "with half it would be 3"


def test_a_watched_threshold_is_followed_through_arithmetic_and_arrays():
    noted = set()
    clip = Watched.of(3.0, (1.5, 6.0), noted)
    assert (2.0 * clip + 1.0) / 2.0 == 3.5
    assert not noted, "numbers that nothing was compared with"
    assert np.array_equal(np.clip([0.0, 1.0], -clip, clip), [0.0, 1.0])
    assert not noted, "within half of it"
    assert np.array_equal(np.clip(np.array([0.0, 4.0]), -clip, clip), [0.0, 3.0])
    assert noted == {0, 1}


def test_half_and_double_are_of_what_is_usual():
    for name in list_thresholds():
        if name == "false_alarm":
            continue
        policy = altered(name, 2.0)["policy"]
        group, key = name.split(".")
        assert getattr(getattr(policy, group), key) == 2.0 * usual(name)
    assert altered("false_alarm", 0.5) == {"false_alarm": 0.005}


def test_a_case_is_diagnosed_again_only_where_a_threshold_matters(monkeypatch):
    def ask(*files, policy=USUAL, **how):
        return {"verdict": str(policy.naming.min_size < 1.0)}  # 0.8 is, and 0.4; 1.6 is not

    monkeypatch.setattr(sensitivity, "ask", ask)
    monkeypatch.setattr(sensitivity, "run", lambda case, seconds, thresholds: {
        "key": case.key, **thresholds()})
    cases = [SimpleNamespace(key="a"), SimpleNamespace(key="b")]
    known = {c.key: sensitivity.examine_first(c, (1.0, 1.0))[0] for c in cases}
    noted = known["a"]["noted"]
    assert {n for n, factors in noted.items() if factors} == {"naming.min_size"}
    assert noted["naming.min_size"] == [2.0]
    repeated = sensitivity.choose(cases, known, checked=1, repeats=9)
    assert [(c.key, f) for c, n, f in repeated if n == "naming.min_size"] == [
        ("a", 0.5), ("a", 2.0), ("b", 2.0)]
    assert [(c.key, f) for c, n, f in repeated if n == "noise.max_residual"] == [
        ("a", 0.5), ("a", 2.0)]
    other, = sensitivity.examine((cases[0], "naming.min_size", 2.0), (1.0, 1.0))
    assert other == {"key": "a naming.min_size x 2", "verdict": "False"}
    assert not sensitivity.same_numbers(known["a"], other)


def test_what_acts_after_the_search_is_concluded_again_from_the_same_search(monkeypatch):
    def conclude(setup, *rest):
        floor = setup.settings.policy.unexplained.min_share
        return SimpleNamespace(to_json=lambda: {"verdict": str(floor < 0.15)}, stages=[
            SimpleNamespace(horizons={"1.0": {"pooled": dict.fromkeys(sensitivity.CHANNELS, 1.0)}})
        ])

    monkeypatch.setattr(sensitivity.diagnosis_run, "conclude", conclude)
    noted = {n: set() for n in list_thresholds()}
    found = {}
    setup = DiagnosisSetup("", PAPER, None, None, Settings(policy=sensitivity.watch(noted)), True,
                           SimpleNamespace())
    with sensitivity.concluded_again(noted, found):
        assert sensitivity.diagnosis_run.conclude(setup).to_json() == {"verdict": "True"}
    unnoted = {f"unexplained.{n} x {f:g}": "True" for n in ("accel", "encoder")
               for f in sensitivity.FACTORS}
    assert {change: line["verdict"] for change, line in found.items()} == {
        "unexplained.min_share x 2": "False", **unnoted}
    assert sensitivity.diagnosis_run.conclude is conclude
