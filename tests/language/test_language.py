"""The language of the code does not get worse: each package has its budgets, which only fall."""

from __future__ import annotations

import pytest

from tests.language.measure_language import exceeds, measure, measure_package, read_budgets

PLAIN = """
def estimate_delay(samples, rate):
    # The delay is where the correlation is largest.
    return samples.argmax() / rate
"""
PRIVATE = """
def settled(of, beside):
    \"\"\"What was told, and what nobody asked.\"\"\"
    a, b = 1, 2
    return of
"""


pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def figures():
    return measure()


def test_no_figure_is_worse_than_its_budget(figures):
    budgets = read_budgets()
    worse = [f"{name}: {key} {value}, allowed {budgets[name][key]}"
             for name, found in figures.items() for key, value in found.items()
             if exceeds(key, value, budgets[name][key])]
    assert not worse, "write in the words of names.md: " + "; ".join(worse)


def test_budgets_are_those_of_the_packages(figures):
    assert {name: set(found) for name, found in figures.items()} == {
        name: set(found) for name, found in read_budgets().items()}


def test_plain_code_has_no_private_words():
    found = measure_package([PLAIN])
    assert (found.private_words, found.participles, found.prepositions) == (0.0, 0.0, 0.0)
    assert found.comments == 1000.0 / 3.0


@pytest.mark.parametrize("key", ["private_words", "participles", "prepositions",
                                 "tuple_assignments", "comments"])
def test_control_private_code_exceeds_every_budget(key):
    plain = vars(measure_package([PLAIN]))
    private = vars(measure_package(100 * [PRIVATE]))
    assert exceeds(key, private[key], plain[key])
    for name, budget in read_budgets().items():
        if key in budget and (key != "comments" or budget[key] > 0.0):
            assert exceeds(key, private[key], budget[key]), name
