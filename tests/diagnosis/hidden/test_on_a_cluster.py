"""A diagnosis and a small campaign on a cluster of two workers give what one process gives."""

from __future__ import annotations

import importlib.util
import json
import os
import re

import pytest
from joblib import parallel_config

from dart_hal.core.process.jobs import each
from studies.diagnosis import campaign
from studies.diagnosis.campaign_cases import Case
from tests.common import ROOT

CLUSTER_CASES = (Case("large", 0, (("steering_lag", 0.12),)), Case("null", 0, ()))
CLUSTER_SECONDS = (40.0, 25.0)
ONLY = ("gyro_bias", "imu_pitch", "steering_lag", "quadratic_drag")

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def cluster():
    distributed = pytest.importorskip("distributed", reason="pip install 'dart-hal[cluster]'")
    with distributed.Client(n_workers=2, threads_per_worker=1, dashboard_address=None) as client:
        client.wait_for_workers(2)
        yield client


def example():
    spec = importlib.util.spec_from_file_location(
        "diagnose_on_a_cluster", ROOT / "examples" / "diagnose_on_a_cluster.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_work_is_done_by_both_workers_and_not_here(cluster):
    """Negative control of the two below: without the line it is done here."""
    process = lambda _: os.getpid()  # noqa: E731 - sent by value: workers cannot import this file
    assert set(each(process, range(4))) == {os.getpid()}
    with parallel_config(backend="dask"):
        done_by = set(each(process, range(40)))
    assert os.getpid() not in done_by
    assert len(done_by) == 2


def test_a_diagnosis_is_the_same(cluster):
    ask = example()
    folders = [str(ROOT / f) for f in (ask.TRAIN, ask.TEST)]

    def diagnose_locally():
        return {**ask.diagnosed(*folders, only=ONLY, max_causes=1).to_json(), "runtime_s": 0.0}

    alone = diagnose_locally()
    with parallel_config(backend="dask"):
        assert diagnose_locally() == alone
    assert alone["causes"]


def answers():
    """By case, without CPU seconds and names of temporary folders."""
    return {a["key"]: json.loads(re.sub(r'"[^"/]*/(train|test)_', r'"\1_', json.dumps(
        {**a, "seconds": 0.0}))) for a in campaign.results(CLUSTER_CASES, CLUSTER_SECONDS, 1)}


def test_a_campaign_is_the_same(cluster):
    alone = answers()
    with parallel_config(backend="dask"):
        assert answers() == alone
    assert len(alone) == len(CLUSTER_CASES)
    assert not any("error" in a for a in alone.values())
