"""Commands of a run have instants of their own: no residual is put down to their age.

Those of a published recording have that of the next message. There a residual that a command
moves much is doubted, and of a backlash, which looks like commands of many ages, less is left.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from searched import drive, evidence

from dart_hal.diagnose.evidence.space import Timing
from dart_hal.diagnose.search.forward import Search
from dart_hal.diagnose.search.selection import Settings
from dart_hal.recording.dart import RUN
from dart_hal.vehicle import PAPER

SOME_AGE = Timing(command_age=0.02, spread=0.01)


@pytest.fixture(scope="module")
def seen():
    return evidence(drive(("steering_backlash", 0.08), seconds=24.0))


def certainty(seen):
    return Search(seen, PAPER, Settings())._measured(PAPER, SOME_AGE).certain


def test_commands_of_a_published_recording_may_have_any_age(seen):
    assert not seen.commands_stamped
    assert np.min(certainty(seen)) < 0.9


def test_commands_of_a_run_have_their_own(seen):
    runs = [replace(d, recording=replace(d.recording, schema=RUN)) for d in seen.drives]
    run = type(seen)(runs, PAPER.body.l_r)
    assert run.commands_stamped
    assert np.min(certainty(run)) == 1.0
    mixed = type(seen)([*seen.drives, *runs], PAPER.body.l_r)
    assert not mixed.commands_stamped
