"""Rules and gates that are switched off are those of the diagnosis, note when they act, and come
back."""

from __future__ import annotations

import pytest

from dart_lab.diagnosis import gates
from dart_lab.diagnosis.gates import Candidate, explain_failure
from dart_lab.diagnosis.policy import USUAL
from studies.diagnosis import ablation
from studies.diagnosis.ablation import GATED, RULES, without


@pytest.mark.parametrize("name", list(RULES))
def test_rule_is_off_inside_and_on_again_after(name):
    owner, attribute = ablation._place(RULES[name].where)
    before = getattr(owner, attribute)
    with without(name):
        assert getattr(owner, attribute) is not before
    assert getattr(owner, attribute) is before


@pytest.mark.parametrize("name", list(GATED))
def test_gate_is_off_inside_and_on_again_after(name):
    before = gates.GATES
    with without(name):
        assert set(before) - set(gates.GATES) == {GATED[name]}
    assert gates.GATES is before


def test_gate_notes_that_it_acted_only_where_it_did():
    small = Candidate(size=0.5)
    large = Candidate(size=1.0)
    acted = set()
    with ablation.watched(acted):
        assert not explain_failure("fit", large, USUAL)
        assert acted == set()
        assert explain_failure("fit", small, USUAL)
        assert not explain_failure("scan", small, USUAL), "by the linear answer it may be"
    assert acted == {"gate: size of the fit"}
    with without("gate: size of the fit"):
        assert not explain_failure("fit", small, USUAL)
