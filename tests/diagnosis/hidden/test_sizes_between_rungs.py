"""The scan looks near a cause of any size: none falls between two that it tries."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import apply, catalogue
from dart_lab.diagnosis.search import size_search
from dart_lab.diagnosis.search.scan import EffectScan
from dart_lab.diagnosis.search.size_search import scanned_parameters
from dart_lab.identification.evidence.drive import prepare_drive
from dart_lab.identification.evidence.noise import estimate_noise
from dart_lab.identification.evidence.residuals import Evidence
from dart_lab.identification.evidence.space import MessageTiming, Space
from dart_lab.identification.objective import refit
from studies.diagnosis.hidden_drive import Plan, write
from studies.diagnosis.known_frame import read

SHARE = 0.85  # of what the true size gains
MIN_GAIN = 4.0  # of loss: two standard deviations of one number
ALIASES = ("pwm_quantisation",)
"""A command between two steps lies between two of finer steps as well: sizes have aliases."""
BETWEEN_RUNGS = 1
"""The size in the middle between two that the scan tries, of five; of either sign the positive."""
SIGNED_SIZES = [pytest.param(e.name, q.name, float(sign * k),
                             marks=() if n == BETWEEN_RUNGS and sign > 0.0 else pytest.mark.long)
                for e in catalogue().values() for q in scanned_parameters(e)
                for sign in ((1.0, -1.0) if q.low < q.null else (1.0,))
                for n, k in enumerate(np.geomspace(q.sizes[0], q.sizes[2], 5))
                if q.low <= q.null + sign * k <= q.high]


def gains(tmp_path, name, values, top=0.34):
    """(what the scan finds, what the true size gains); top: the largest throttle of the drive."""
    plan = Plan(seconds=60.0, fast=(0.21, top))
    recording = read(write(tmp_path / "hidden.csv", apply(PAPER, name, **values), 12, plan))
    evidence = Evidence([prepare_drive(recording, PAPER.body.l_r)], PAPER.body.l_r)
    noise = estimate_noise(evidence.residuals(PAPER), evidence.blocks())
    exact = Space(PAPER, ())
    point = refit(evidence, noise, exact, exact.point(MessageTiming()))
    scan = EffectScan(evidence, point)
    truth = scan.residual(apply(point.vehicle, name, **values))
    return scan.best_trial(name), scan.gain(truth)


@pytest.mark.parametrize(("name", "parameter", "k"), SIGNED_SIZES)
@pytest.mark.slow
def test_the_scan_finds_what_the_true_size_gains(tmp_path, name, parameter, k):
    q = next(q for q in catalogue()[name].parameters if q.name == parameter)
    found, truth = gains(tmp_path, name, {parameter: q.null + k})
    share = 0.3 if name in ALIASES else SHARE
    assert found.gain > share * truth - MIN_GAIN


@pytest.mark.slow
def test_a_throttle_that_ends_between_two_rungs_is_found(tmp_path):
    """At .36, in a drive that commands up to .42: on either rung next to it nothing is gained."""
    found, truth = gains(tmp_path, "motor_saturation", {"k": 1 / 0.36}, top=0.42)
    assert found.gain > SHARE * truth > 100.0
    assert found.values["k"] == pytest.approx(1 / 0.36, rel=0.02)


@pytest.mark.slow
def test_without_looking_between_the_rungs_it_is_missed(tmp_path, monkeypatch):
    """The negative control."""
    monkeypatch.setattr(size_search, "MAX_BISECTIONS", 0)
    monkeypatch.setattr(size_search, "MAX_REFINEMENTS", 2)
    found, truth = gains(tmp_path, "motor_saturation", {"k": 1 / 0.36}, top=0.42)
    assert found.gain < 0.2 * truth
