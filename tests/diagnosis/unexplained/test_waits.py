"""Pulses wait for their frame, and for a while all equally long: that is no structure, all else
is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.core.timing import PWM_FRAME
from dart_hal.recording.dart import RUN
from dart_hal.vehicle import PAPER
from dart_lab.diagnosis.search.forward import ForwardSearch
from dart_lab.diagnosis.search.selection import Settings
from dart_lab.diagnosis.unexplained.features import window_features
from dart_lab.diagnosis.unexplained.structure import find_structure
from dart_lab.diagnosis.unexplained.waits import remove_frame_wait
from dart_lab.identification.evidence.onboard_drive import MESSAGES_AHEAD
from dart_lab.identification.evidence.space import NO_DELAY, MessageTiming
from tests.diagnosis.onboard_files import evidence, record_onboard

GYRO = slice(1, None, 2)


@pytest.fixture(scope="module")
def plain_evidence(tmp_path_factory):
    return evidence(record_onboard(tmp_path_factory.mktemp("plain"), seed=21))


@pytest.fixture
def run(plain_evidence):
    """The same drive as a run of our own: every command has its instant."""
    return type(plain_evidence)([replace(d, recording=replace(d.recording, schema=RUN))
                                 for d in plain_evidence.drives], PAPER.body.l_r)


def erring(monkeypatch, of_drive, error):
    """What it is off, for the right model: ``error`` (n, c) and noise of 5 mm/s and 5 mrad/s."""
    right = of_drive.residuals(PAPER).motion
    rng = np.random.default_rng(3)
    residuals = of_drive.residuals
    off = error + 0.005 * rng.normal(size=error.shape)

    def with_error(p, timing=NO_DELAY):
        r = residuals(p, timing)
        return replace(r, motion=r.motion - right + off)

    monkeypatch.setattr(of_drive, "residuals", with_error)


def delay_pulses(of_drive):
    """Frames keep step with the messages: all pulses wait 7 ms longer than in the mean."""
    older = (of_drive.residuals(PAPER, MessageTiming(command_age=0.004)).motion
             - of_drive.residuals(PAPER, MessageTiming(command_age=-0.004)).motion) / 0.008
    return 0.35 * PWM_FRAME * older


def reduce_gyro_by_angle(of_drive):
    """A gyro that measures less the further the wheels are turned."""
    error = np.zeros((len(of_drive.motion_drive), 2 * MESSAGES_AHEAD))
    error[:, GYRO] = 0.05 * np.tanh(3.0 * window_features(of_drive, PAPER, 50)["steering_angle"]
                                    )[:, None]
    return error


def structure(of_drive, r):
    noise = ForwardSearch(of_drive, PAPER, Settings())._measure_training_noise(PAPER, NO_DELAY)
    return {u.channel for u in find_structure(of_drive, PAPER, r(noise), noise) if u.channel
            == "gyro"}


@pytest.mark.parametrize(("error", "as_it_is", "left"), [
    (delay_pulses, {"gyro"}, set()), (reduce_gyro_by_angle, {"gyro"}, {"gyro"})])
@pytest.mark.slow
def test_what_a_wait_does_is_no_structure_and_all_else_is(monkeypatch, run, error, as_it_is, left):
    erring(monkeypatch, run, error(run))
    assert structure(run, lambda noise: run.residuals(PAPER)) == as_it_is
    assert structure(run, lambda noise: remove_frame_wait(run, PAPER, NO_DELAY, noise)) == left


def test_no_pulse_waits_longer_than_a_frame(monkeypatch, run):
    most = delay_pulses(run) / 0.35 / 2.0  # half a frame to either side of the mean
    erring(monkeypatch, run, 8.0 * most)
    noise = ForwardSearch(run, PAPER, Settings())._measure_training_noise(PAPER, NO_DELAY)
    taken = np.abs(remove_frame_wait(run, PAPER, NO_DELAY,
                                     noise).motion - run.residuals(PAPER).motion)
    assert taken.max() == pytest.approx(np.abs(most).max(), rel=0.3)


def test_where_ages_are_fitted_nothing_is_taken_off(plain_evidence):
    noise = ForwardSearch(plain_evidence, PAPER, Settings())._measure_training_noise(PAPER,
                                                                                     NO_DELAY)
    assert np.array_equal(remove_frame_wait(plain_evidence, PAPER, NO_DELAY, noise).motion,
                          plain_evidence.residuals(PAPER).motion)
