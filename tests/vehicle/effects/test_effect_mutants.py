"""The laws notice every change of an equation: a sign, an operator, a term, a number, a variable.

Each mutant of an effect's file is executed and checked with plain floats and series. The ones that
no test can notice are in ``tests/mutation/equivalent.py``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from dart_hal.vehicle.effects import catalogue
from tests.vehicle.effects.law_engines import check_effect

sys.path.append(str(Path(__file__).parents[2] / "mutation"))
from equivalent import EFFECTS_FOLDER, EQUIVALENTS, equivalence
from term_mutants import term_mutants

KNOWN_EQUIVALENTS = [known for known in EQUIVALENTS if known.file.startswith(EFFECTS_FOLDER)]


def is_noticed(mutant):
    """Return whether the laws notice the mutant, or it cannot be computed at all."""
    scope = {"__name__": "mutant"}
    try:
        exec(compile(mutant.text, mutant.file, "exec"), scope)
        with np.errstate(all="ignore"):
            return bool(check_effect(scope["EFFECT"]))
    except (ArithmeticError, AttributeError, KeyError, ValueError):
        return True


def list_survivors(name):
    """Return the mutants of an effect that the laws do not notice."""
    return [f"{m.place} {m.operator}: {m.before} => {m.after}"
            for m in term_mutants(f"{EFFECTS_FOLDER}{name}.py")
            if not equivalence(m) and not is_noticed(m)]


@pytest.mark.slow_except("steering_gain", "load_transfer", "imu_yaw", "steering_rate_limit")
@pytest.mark.parametrize("name", catalogue())
def test_laws_notice_every_change_of_an_equation(name):
    assert list_survivors(name) == []


def test_an_equation_is_broken_in_every_one_of_its_terms():
    """The control: all that is made of a scale, (1 + k) v."""
    returned = [m.after for m in term_mutants(f"{EFFECTS_FOLDER}gyro_scale.py")]
    assert sorted(returned) == sorted([
        "return v / (1.0 + k)", "return (v)", "return (1.0 + k)", "return v * (1.0 - k)",
        "return v * ((1.0))", "return v * ((k))", "return v * (1.25 + k)", "signals={},"])


def test_mutant_survives_where_the_law_is_missing(monkeypatch):
    """The control: without its laws for a right turn and for braking, a term goes unnoticed."""
    from tests.vehicle.effects import law_engines

    laws = [law for law in law_engines.LAWS if law.effect == "load_transfer"]
    monkeypatch.setattr(law_engines, "LAWS", laws[3:4])
    assert len(list_survivors("load_transfer")) > 3


@pytest.mark.parametrize("known", KNOWN_EQUIVALENTS, ids=lambda known: known.after)
def test_an_equivalent_mutant_is_one_that_is_made(known):
    assert sum(known.matches(mutant) for mutant in term_mutants(known.file)) == 1
