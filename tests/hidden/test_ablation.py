"""Rules that are switched off are those of the diagnosis, note when they act, and come back."""

from __future__ import annotations

import ablation
import pytest
from ablation import RULES, without

from dart_hal.diagnose.search import selection
from dart_hal.vehicle.effects import catalogue

LINEAR = "size by the linear answer"


@pytest.mark.parametrize("name", list(RULES))
def test_rule_is_off_inside_and_on_again_after(name):
    owner, attribute = ablation._place(RULES[name].where)
    before = getattr(owner, attribute)
    with without(name):
        assert getattr(owner, attribute) is not before
    assert getattr(owner, attribute) is before


def test_rule_notes_that_it_acted_only_where_it_did():
    grip, share = catalogue()["grip"], ablation.NAMING.tried_size
    acted = set()
    with ablation.watched(acted):
        assert not selection._too_small(grip, {"k": 1.0}, share)
        assert acted == set()
        assert selection._too_small(grip, {"k": 0.0}, share)
    assert acted == {LINEAR}
    with without(LINEAR):
        assert not selection._too_small(grip, {"k": 0.0}, share)
        assert selection._too_small(grip, {"k": 0.0}, ablation.NAMING.least_size)
