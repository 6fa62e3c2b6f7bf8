"""One cause that a car writes a little differently than the catalogue brings no second name along.

The stranger's drag of turned wheels acts along the wheels and goes with the sine of their angle;
the catalogue's acts along the car and goes with the angle.
"""

from __future__ import annotations

from dataclasses import replace

import pytest
from campaign import ask, run
from campaign_cases import Case
from stranger_causes import SIZES

from dart_hal.diagnose.policy import USUAL

pytestmark = pytest.mark.more


COMPANIONS = pytest.mark.xfail(strict=True, reason=(
    "since the noise is measured without the causes, yaw_damping is accepted beside the drag with "
    "P 0.88 (was possible, P 0.73): it takes 33 % of the yaw error of the held-out drive"))


@pytest.mark.parametrize("seed", [pytest.param(100, marks=COMPANIONS), 300])
def test_a_drag_along_the_wheels_is_one_cause(seed):
    answer = run(Case("fixed", seed, (("cornering_drag", SIZES["cornering_drag"][1]),)))
    assert [c["effect"] for c in answer["causes"]] == ["cornering_drag"]
    assert "yaw_damping" in {p["effect"] for p in answer["possible"]}


def test_without_the_grade_there_are_more_names():
    """The negative control."""
    every = replace(USUAL, grade=replace(USUAL.grade, likely=0.0, confident=0.0))
    answer = run(Case("fixed", 100, (("cornering_drag", SIZES["cornering_drag"][1]),)),
                 asked=lambda *files: ask(*files, policy=every))
    assert len(answer["causes"]) > 1
