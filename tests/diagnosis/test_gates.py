"""Each gate decides by one quantity, and all are in one list."""

from __future__ import annotations

import pytest

from dart_hal.vehicle.effects import catalogue
from dart_lab.diagnosis.gates import (
    GATES,
    STAGES,
    Candidate,
    explain_failure,
    find_failed_gate,
    relative_size,
)
from dart_lab.diagnosis.policy import USUAL

FAILING = {
    "significance": Candidate(gain=9.0, threshold=10.0),
    "largest gain": Candidate(chosen="grip"),
    "size": Candidate(size=0.3),
    "gain of the fit": Candidate(gain=20.0, fit_gain=9.0, threshold=10.0),
    "size of the fit": Candidate(size=0.7),
    "gain with the others": Candidate(remaining_gain=9.0, threshold=10.0),
    "structure": Candidate(structure_after=5.0, structure_before=6.0, structure_removed=4.0),
    "possible size": Candidate(impossible="k = 1.2 is outside its physical range"),
    "probability": Candidate(probability=0.7),
    "confirmation": Candidate(probability=0.99, cost=(0.99, 0.9, 1.1)),
}


def test_all_gates_are_of_a_stage_in_the_order_of_the_stages():
    stages = [gate.stage for gate in GATES]
    assert list(dict.fromkeys(stages)) == list(STAGES)
    assert stages == sorted(stages, key=list(STAGES).index)
    assert [gate.name for gate in GATES] == list(FAILING)


@pytest.mark.parametrize("gate", GATES, ids=lambda gate: gate.name)
def test_candidate_fails_by_one_quantity_alone(gate):
    assert explain_failure(gate.stage, Candidate(), USUAL) == "", "nothing speaks against it"
    assert find_failed_gate(gate.stage, FAILING[gate.name], USUAL) is gate
    assert explain_failure(gate.stage, FAILING[gate.name], USUAL)


def test_confident_effect_needs_the_ratio_and_a_likely_one_its_interval():
    confident = Candidate(probability=0.97, cost=(1.05, 0.98, 1.1))
    likely = Candidate(probability=0.96, cost=(1.05, 0.98, 1.1))
    assert not explain_failure("test", confident, USUAL)
    assert ("without it the test errors are 5 % larger [-2 %, +10 %]"
            in explain_failure("test", likely, USUAL))


def test_size_is_relative_to_the_small_one():
    grip = catalogue()["grip"]
    small = grip.parameters[0].sizes[0]
    assert relative_size(grip, {"k": -3.0 * small}) == pytest.approx(3.0)
    assert relative_size(grip, {}) == 0.0
