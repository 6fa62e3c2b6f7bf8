"""On a cluster of two workers, verbs and studies give what they give on this computer."""

from __future__ import annotations

import json
import os
import re
import socket
import subprocess
import sys
import threading
import time

import pytest

from dart_hal.core.errors import ClusterFailed, LinkLost, UsageError
from dart_hal.core.process import cluster as clusters
from dart_hal.core.process import jobs
from dart_hal.core.process.cluster import use_cluster
from dart_hal.core.process.jobs import choose_processes, each
from studies.calibration import coverage
from studies.diagnosis import campaign
from studies.diagnosis.campaign_cases import Case
from tests.common import EXCERPT, ROOT
from tests.recorded.simulated_recording import simulate_recording, table_of, write_table

CLUSTER_CASES = (Case("large", 0, (("steering_lag", 0.12),)), Case("null", 0, ()))
CLUSTER_SECONDS = (40.0, 25.0)
FOLDERS = tuple(ROOT / "tests" / "recorded" / "data" / name
                for name in ("50_tire_model_data", "91_free_driving_16_sept_2024"))


def local_cluster(**how):
    distributed = pytest.importorskip("distributed", reason="pip install 'dart-hal[cluster]'")
    return distributed.LocalCluster(dashboard_address=":0", protocol="tcp", **how)


@pytest.fixture(scope="module")
def address():
    with local_cluster(n_workers=2, threads_per_worker=1) as cluster:
        yield cluster.scheduler_address


def run_twice(verb, address, *words):
    """The JSON of a verb on this computer and on the cluster, without times."""
    def run(*more):
        ran = verb(*words, *more, "--json")
        assert ran.code == 0, ran.err
        timeless = re.sub(r'"(runtime_s|cpu_s|seconds)": [-\d.e]+', r'"\1": 0', ran.out)
        return ran, json.loads(timeless)

    _, alone = run()
    ran, found = run("--cluster", address)
    assert f"computing on 2 workers of {address}" in ran.err
    return alone, found


@pytest.mark.slow
def test_work_is_done_by_both_workers_and_not_here(address):
    """Negative control of those below: without the cluster it is done here."""
    process = lambda _: os.getpid()  # noqa: E731 - sent by value: workers cannot import this file
    assert set(each(process, range(4))) == {os.getpid()}
    assert choose_processes(0.0) == 1
    with use_cluster(address) as workers:
        assert workers == choose_processes(0.0) == 2
        done_by = set(each(process, range(40)))
    assert os.getpid() not in done_by
    assert len(done_by) == 2
    assert set(each(process, range(4))) == {os.getpid()}


@pytest.mark.slow
def test_diagnose_is_the_same(verb, address):
    only = [word for name in ("gyro_bias", "imu_pitch", "steering_lag", "quadratic_drag")
            for word in ("--only", name)]
    alone, found = run_twice(verb, address, "diagnose", "--model", "paper", "--train", FOLDERS[0],
                             "--test", FOLDERS[1], "--max-causes", 1, *only)
    assert found == alone
    assert alone["causes"]


@pytest.mark.slow
def test_evaluate_is_the_same(verb, address, monkeypatch):
    # Several batches, else there is nothing to distribute.
    monkeypatch.setattr("dart_lab.identification.prediction.rollout.BATCH_WINDOWS", 64)
    alone, found = run_twice(verb, address, "evaluate", "--model", "paper", FOLDERS[1])
    assert found == alone


@pytest.mark.long
def test_joint_fit_and_study_are_the_same(verb, address, tmp_path):
    folder = tmp_path / "recordings"
    folder.mkdir()
    for seed in (3, 4):
        write_table(table_of(simulate_recording(seed, seconds=30.0)[0], "C"),
                    folder / f"{seed}.csv")
    alone, found = run_twice(verb, address, "identify", "all", folder, "--joint", "--dry-run")
    assert found == alone
    alone, found = run_twice(verb, address, "study", folder, "--stage", "check")
    assert found == alone


def answers():
    """By case, without CPU seconds and names of temporary folders."""
    return {a["key"]: json.loads(re.sub(r'"[^"/]*/(train|test)_', r'"\1_', json.dumps(
        {**a, "seconds": 0.0}))) for a in campaign.results(CLUSTER_CASES, CLUSTER_SECONDS, 1)}


@pytest.mark.long
def test_a_campaign_is_the_same(address):
    alone = answers()
    with use_cluster(address):
        assert answers() == alone
    assert len(alone) == len(CLUSTER_CASES)
    assert not any("error" in a for a in alone.values())


@pytest.mark.long
def test_coverage_is_the_same(address, tmp_path, monkeypatch):
    def lines(*words):
        file = tmp_path / f"{len(words)}.jsonl"
        monkeypatch.setattr("sys.argv", ["coverage", "throttle", "--seeds", "2", "--results",
                                         str(file), *words])
        coverage.main()
        return sorted(file.read_text().splitlines())

    assert lines("--cluster", address) == lines()


class MortalCluster:
    """A scheduler and two workers, each a process of its own that can be killed."""

    def __init__(self, port):
        self.address = f"tcp://127.0.0.1:{port}"
        self.scheduler = self._start("scheduler", "--host", "127.0.0.1", "--port", str(port))
        self.workers = [self._start("worker", self.address, "--nthreads", "1", "--no-nanny")
                        for _ in range(2)]

    def _start(self, *words):
        return subprocess.Popen([sys.executable, "-m", "dask", *words, "--no-dashboard"],
                                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def kill(self, *processes):
        for process in processes:
            process.kill()
            process.wait()


@pytest.fixture
def mortal():
    pytest.importorskip("distributed", reason="pip install 'dart-hal[cluster]'")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    cluster = MortalCluster(port)
    try:
        # The client does not wait until a scheduler listens.
        while not is_open(port):
            assert cluster.scheduler.poll() is None
            time.sleep(0.1)
        yield cluster
    finally:
        cluster.kill(cluster.scheduler, *cluster.workers)


def is_open(port):
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def sum_with_deaths(mortal, victims, timeout):
    """The sum of 0 to 29, computed on a cluster whose victims die at its beginning."""
    # Sent by value: workers cannot import this file.
    work = lambda k: time.sleep(0.2) or k  # noqa: E731
    with use_cluster(mortal.address, timeout=timeout):
        found = each(work, range(30), parts=30)
        first = next(found)
        mortal.kill(*victims)
        return first + sum(found)


@pytest.mark.slow
def test_one_dead_worker_of_two_does_not_change_the_result(mortal):
    """The control of those below."""
    assert sum_with_deaths(mortal, mortal.workers[:1], 60.0) == sum(range(30))


@pytest.mark.slow
@pytest.mark.parametrize("who", ["scheduler", pytest.param("workers", marks=pytest.mark.long)])
def test_lost_cluster_ends_the_computation(mortal, who, capfd):
    victims = mortal.workers if who == "workers" else [mortal.scheduler]
    with pytest.raises(ClusterFailed, match="was lost while it computed") as lost:
        sum_with_deaths(mortal, victims, 15.0)
    assert mortal.address in lost.value.what
    assert (lost.value.found == "no worker for 15 s") == (who == "workers")
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.long
def test_diagnosis_on_a_dying_cluster_leaves_no_file(verb, mortal, monkeypatch, tmp_path):
    """The scheduler dies while the first computation is on the workers."""
    reported = jobs._report_loss

    def report_and_kill(backend):
        if backend is not None:
            threading.Timer(0.5, mortal.kill, [mortal.scheduler]).start()
        return reported(backend)

    # The workers are connected by then: counting them is no computation.
    monkeypatch.setattr(jobs, "cluster_workers", lambda: 2 * (jobs._cluster_backend() is not None))
    monkeypatch.setattr(jobs, "_report_loss", report_and_kill)
    error = verb("diagnose", "--model", "paper", "--train", FOLDERS[0], "--test", FOLDERS[1],
                 "--out", "found.toml", "--html", "page.html", "--cluster", mortal.address,
                 "--json").error
    assert error["code"] == ClusterFailed.code
    assert "was lost while it computed" in error["what"]
    assert "start the scheduler and the workers again" in error["try"]
    assert not list(tmp_path.iterdir())


class WatchedClient:
    """A client of which only the watch is known."""


@pytest.mark.slow_except("error1*")
@pytest.mark.parametrize(("error", "expected"), [
    (OSError("timed out"), ClusterFailed), (FileNotFoundError(2, "no such file", "run.csv"),
                                            FileNotFoundError), (LinkLost("gone"), LinkLost)])
def test_errors_of_the_work_are_not_taken_for_a_lost_cluster(error, expected):
    pytest.importorskip("distributed", reason="pip install 'dart-hal[cluster]'")
    client = WatchedClient()
    clusters._WATCHES[client] = clusters.ClusterWatch(client, "tcp://10.0.0.1:8786", 1.0)
    with pytest.raises(expected) as found, clusters.report_loss(client):
        raise error
    assert type(found.value) is expected


@pytest.mark.slow
def test_workers_with_another_version_are_refused(address, monkeypatch):
    monkeypatch.setattr(clusters, "__version__", "0.0.1")  # of this process alone
    with pytest.raises(ClusterFailed, match="another version of dart-hal") as refused, \
            use_cluster(address):
        pass
    assert refused.value.expected.startswith("0.0.1 ")


@pytest.mark.slow
@pytest.mark.parametrize(("how", "what"), [
    ({"n_workers": 1, "threads_per_worker": 1}, "fewer than 2 workers"),
    ({"n_workers": 2, "threads_per_worker": 2}, "several threads")])
def test_unfit_workers_are_refused(how, what):
    with local_cluster(processes=False, **how) as cluster, \
            pytest.raises(ClusterFailed, match=what) as refused, \
            use_cluster(cluster.scheduler_address, timeout=0.5):
        pass
    assert "--nthreads 1" in refused.value.remedy


@pytest.mark.slow
@pytest.mark.parametrize("listening", [False, True])
def test_address_without_a_scheduler_ends_in_time(listening):
    """Whether the connection is refused, or accepted by a program that never answers."""
    pytest.importorskip("distributed")
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        if listening:
            other.listen()
        address = f"tcp://127.0.0.1:{other.getsockname()[1]}"
        with pytest.raises(ClusterFailed, match="no dask scheduler") as refused, \
                use_cluster(address, timeout=0.5):
            pass
    assert address in refused.value.what


@pytest.mark.slow
def test_address_of_no_known_form_is_refused(verb):
    pytest.importorskip("distributed")
    assert verb("evaluate", EXCERPT, "--cluster", "post://office", "--json").error["code"] == \
        ClusterFailed.code


def test_missing_package_is_named_with_its_command(monkeypatch):
    monkeypatch.setattr(clusters, "find_spec", lambda _name: None)
    with pytest.raises(UsageError, match="needs the Python package distributed") as refused, \
            use_cluster("tcp://127.0.0.1:8786"):
        pass
    assert "distributed>=2024" in refused.value.remedy


def test_no_address_is_this_computer():
    with use_cluster(None) as workers:
        assert workers == 0


@pytest.mark.parametrize(("words", "what"), [
    (("identify", "all", EXCERPT), "the joint fit alone"),
    (("diagnose", "--train", EXCERPT, "--jobs", "2"), "--jobs and --cluster")])
def test_options_that_exclude_a_cluster_are_refused_first(verb, words, what):
    assert what in verb(*words, "--cluster", "post://office", "--json").error["what"]
