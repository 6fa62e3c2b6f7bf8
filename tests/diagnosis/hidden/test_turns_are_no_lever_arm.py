"""What smoothing leaves of a turn looks like an IMU that sits elsewhere, and is not accepted."""

from __future__ import annotations

import pytest

from studies.diagnosis.campaign import ask, run
from studies.diagnosis.campaign_cases import cases


@pytest.mark.slow
def test_what_smoothing_leaves_of_a_turn_is_no_lever_arm():
    """A drive in which nothing is hidden, commands in step with the messages."""
    case = next(c for c in cases(["null"]) if c.seed == 77)
    assert run(case, asked=ask)["causes"] == []
