"""What a process keeps of an evidence that came from another one."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import apply
from dart_lab.diagnosis.evidence import residuals
from tests.diagnosis import searched


@pytest.fixture(autouse=True)
def _nothing_came_before(monkeypatch):
    monkeypatch.setattr(residuals, "HAD", type(residuals.HAD)())


@pytest.fixture(scope="module")
def seen():
    return searched.evidence(searched.drive(seconds=8.0))


def test_the_second_packet_finds_what_the_first_has_kept(seen):
    packet = pickle.dumps(seen)
    first = pickle.loads(packet)
    assert first is not seen
    assert not first._kept
    assert not first._said
    p = apply(PAPER, "motor_gain", k=0.1)
    assert np.array_equal(first.residuals(p).motion, seen.residuals(p).motion)
    assert pickle.loads(packet) is first
    assert first._kept
    assert first._said


def test_another_evidence_of_the_same_recordings_is_another(seen):
    other = searched.evidence(searched.drive(seconds=8.0))
    assert pickle.loads(pickle.dumps(other)) is not pickle.loads(pickle.dumps(seen))


def test_a_process_keeps_few(seen):
    for _ in range(residuals.FEW + 1):
        pickle.loads(pickle.dumps(searched.evidence(searched.drive(seconds=8.0))))
    assert len(residuals.HAD) == residuals.FEW
