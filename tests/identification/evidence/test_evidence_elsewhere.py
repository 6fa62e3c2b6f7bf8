"""What a process keeps of an evidence that came from another one."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import apply
from dart_lab.identification.evidence import residuals
from tests.diagnosis import searched


@pytest.fixture(autouse=True)
def _nothing_came_before(monkeypatch):
    monkeypatch.setattr(residuals, "EVIDENCE_CACHE", type(residuals.EVIDENCE_CACHE)())


@pytest.fixture(scope="module")
def evidence():
    return searched.evidence(searched.drive(seconds=8.0))


def test_the_second_packet_finds_what_the_first_has_kept(evidence):
    packet = pickle.dumps(evidence)
    first = pickle.loads(packet)
    assert first is not evidence
    assert not first._parts_cache
    assert not first._residuals_cache
    p = apply(PAPER, "motor_gain", k=0.1)
    assert np.array_equal(first.residuals(p).motion, evidence.residuals(p).motion)
    assert pickle.loads(packet) is first
    assert first._parts_cache
    assert first._residuals_cache


def test_another_evidence_of_the_same_recordings_is_another(evidence):
    other = searched.evidence(searched.drive(seconds=8.0))
    assert pickle.loads(pickle.dumps(other)) is not pickle.loads(pickle.dumps(evidence))


def test_a_process_keeps_few(evidence):
    for _ in range(residuals.MAX_CACHED_EVIDENCE + 1):
        pickle.loads(pickle.dumps(searched.evidence(searched.drive(seconds=8.0))))
    assert len(residuals.EVIDENCE_CACHE) == residuals.MAX_CACHED_EVIDENCE
