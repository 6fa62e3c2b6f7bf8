"""Commands of a run have instants of their own, but for the wait for a frame of the PWM.

Those of a published recording have that of the next message. There a residual that a command
moves much is doubted, and of a backlash, which looks like commands of many ages, less is left.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.core.timing import PWM_WAIT_STD
from dart_hal.recording.dart import RUN
from dart_hal.vehicle import PAPER
from dart_lab.diagnosis.search.forward import ForwardSearch
from dart_lab.diagnosis.search.selection import Settings
from dart_lab.identification.evidence.noise import estimate_noise
from dart_lab.identification.evidence.residuals import Residuals
from dart_lab.identification.evidence.space import MessageTiming
from tests.diagnosis.searched import drive, evidence

SOME_AGE = MessageTiming(command_age=0.02, age_spread=0.01)


@pytest.fixture(scope="module")
def evidence_of_drive():
    return evidence(drive(("steering_backlash", 0.08), seconds=24.0))


def certainty(evidence_of_drive):
    return ForwardSearch(evidence_of_drive, PAPER,
                         Settings())._measure_training_noise(PAPER, SOME_AGE).age_scale


@pytest.mark.slow
def test_commands_of_a_published_recording_may_have_any_age(evidence_of_drive):
    assert not evidence_of_drive.commands_stamped
    assert np.min(certainty(evidence_of_drive)) < 0.9


@pytest.mark.slow
def test_commands_of_a_run_wait_for_a_frame_and_no_longer(evidence_of_drive):
    runs = [replace(d, recording=replace(d.recording, schema=RUN))
            for d in evidence_of_drive.drives]
    run = type(evidence_of_drive)(runs, PAPER.body.l_r)
    assert run.commands_stamped
    r = run.residuals(PAPER, SOME_AGE).motion
    younger = replace(SOME_AGE, command_age=SOME_AGE.command_age - PWM_WAIT_STD)
    late = run.residuals(PAPER, younger).motion
    moved = np.abs(late - r) / np.median(np.abs(r), axis=0)
    certain = certainty(run)
    assert np.min(certain[moved < 0.01]) > 0.95
    assert np.median(certain[moved > 1.0]) < 0.8
    # where ages may be a tenth of a second
    assert np.min(certain) > np.min(certainty(evidence_of_drive))
    mixed = type(evidence_of_drive)([*evidence_of_drive.drives, *runs], PAPER.body.l_r)
    assert not mixed.commands_stamped


def test_a_known_wait_is_the_size_of_its_doubt():
    rng = np.random.default_rng(0)
    older = np.repeat([0.0, 5.0], [900, 100])[:, None]  # rad/s2: a step in a tenth of the windows
    motion = 0.004 * rng.normal(size=(1000, 1)) + older * rng.uniform(-0.01, 0.01, (1000, 1))
    block = np.arange(1000) // 4
    found = estimate_noise(Residuals(motion, np.empty((0, 4))), (block, block[:0]),
                           sensitivity=older, age_std=PWM_WAIT_STD)
    assert np.all(found.age_scale[:900] == 1.0)
    assert found.age_scale[900:] == pytest.approx(
        1.0 / np.sqrt(1.0 + (PWM_WAIT_STD * 5.0 / 0.004)**2), rel=0.1)
    assert np.std(found.age_scale[900:] * motion[900:]) == pytest.approx(0.004, rel=0.15)
