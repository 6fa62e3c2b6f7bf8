"""A scan over the catalogue names the one thing that is hidden, and is quiet when nothing is."""

from __future__ import annotations

import pytest

from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import apply
from dart_lab.diagnosis.search.scan import scan
from dart_lab.identification.evidence.drive import prepare_drive
from dart_lab.identification.evidence.noise import estimate_noise
from dart_lab.identification.evidence.residuals import Evidence
from dart_lab.identification.evidence.space import MessageTiming, Space
from dart_lab.identification.objective import refit
from studies.diagnosis.hidden_drive import Plan, write
from studies.diagnosis.known_frame import read

QUIET_LOSS = 30.0
"""Gain below which nothing is named: about twice the largest without anything hidden."""
HIDDEN_PLAN = Plan(seconds=60.0)


def scanned_parameters(tmp_path, p, seed, names=None):
    recording = read(write(tmp_path / "hidden.csv", p, seed, HIDDEN_PLAN))
    evidence = Evidence([prepare_drive(recording, PAPER.body.l_r)], PAPER.body.l_r)
    noise = estimate_noise(evidence.residuals(PAPER), evidence.blocks())
    exact = Space(PAPER, ())
    point = refit(evidence, noise, exact, exact.point(MessageTiming()))
    return scan(evidence, point, names)


@pytest.mark.slow
def test_nothing_hidden_is_quiet(tmp_path):
    assert scanned_parameters(tmp_path, PAPER, 11)[0].gain < QUIET_LOSS


@pytest.mark.parametrize(("name", "k"), [
    ("steering_lag", 0.06), ("steering_trim", -0.01), ("grip", -0.1), ("throttle_lag", 0.08),
    ("gyro_bias", 0.02), ("mocap_offset_x", 0.008), ("rolling_resistance", 0.25)])
@pytest.mark.slow_except("rolling_resistance-0.25")
@pytest.mark.slow
def test_what_is_hidden_comes_first_at_its_size(tmp_path, name, k):
    best = scanned_parameters(tmp_path, apply(PAPER, name, k=k), 12)[0]
    assert best.effect == name
    assert best.gain > QUIET_LOSS
    assert best.values["k"] == pytest.approx(k, rel=0.3)


@pytest.mark.slow
def test_without_the_cause_in_the_catalogue_another_name_gains_less(tmp_path):
    """The negative control: what is left when the right answer is not on offer is a worse one."""
    p = apply(PAPER, "steering_lag", k=0.06)
    right, *_ = scanned_parameters(tmp_path, p, 13, ["steering_lag"])
    wrong, *_ = scanned_parameters(tmp_path, p, 13, ["steering_delay", "yaw_inertia", "grip"])
    assert wrong.gain < right.gain - QUIET_LOSS
