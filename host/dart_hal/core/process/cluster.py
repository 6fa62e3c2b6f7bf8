"""Compute on the workers of a dask scheduler: everything that uses ``jobs.each``.

A lost cluster shows in three ways. A scheduler that dies, or a worker that dies with data that were
sent to it, cancels the computation. Without any worker the scheduler waits for one for ever:
``ClusterWatch`` cancels the computation then. ``report_loss`` turns all into ClusterFailed.
"""

from __future__ import annotations

import hashlib
import logging
import platform
import socket
import threading
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from weakref import WeakKeyDictionary

from dart_hal import __version__
from dart_hal.core.errors import ClusterFailed, DartHalError
from dart_hal.core.process.extras import missing_module_error

# s to wait for the scheduler, and then for its workers.
CONNECT_TIMEOUT = 10.0
MIN_WORKERS = 2
# Packages whose version may change the last bits of a result.
COMPARED_PACKAGES = ("numpy", "scipy")
PACKAGES_WITH_SOURCE = ("dart_hal", "dart_lab")
# s between two looks at the number of workers; the time-out is counted in them.
WATCH_INTERVAL = 1.0
START_WORKERS = "dask worker {address} --nworkers auto --nthreads 1"


@contextmanager
def use_cluster(address: str | None, timeout: float = CONNECT_TIMEOUT) -> Iterator[int]:
    """Let ``jobs.each`` compute on a cluster; give the number of its workers.

    Args:
        address: of the dask scheduler, such as ``tcp://192.168.1.5:8786``; None: this computer,
            and the number is 0.
        timeout: s to wait for the scheduler, then for its workers, and for a new worker when none
            is left.

    Raises:
        ClusterFailed: no scheduler answers, it has fewer than two workers, or a worker has
            several threads or another version of this software. ``jobs.each`` raises it if the
            scheduler or the workers are lost while they compute.
        UsageError: the package ``distributed`` is not installed.

    Example::

        from dart_hal.core.process.cluster import use_cluster

        with use_cluster("tcp://192.168.1.5:8786"):
            found = diagnose(file, vehicle, train, test, jobs=2)
    """
    if address is None:
        yield 0
        return
    if find_spec("distributed") is None:
        raise missing_module_error("distributed", "--cluster")
    import distributed  # noqa: F401 - its import makes the handlers of its logger
    from joblib import parallel_config

    with ExitStack() as stack:
        # A lost cluster is reported by report_loss, not by the tracebacks of the package.
        stack.enter_context(_mute_logger("distributed"))
        client = stack.enter_context(_connect(address, timeout))
        stack.enter_context(parallel_config(backend="dask", client=client))
        workers = _check_workers(client, address, timeout)
        stack.enter_context(ClusterWatch(client, address, timeout))
        yield workers


class ClusterWatch:
    """Cancels the computations of a client that has had no worker for ``timeout`` s.

    address: of the scheduler. lost: why the computations were cancelled, empty if they were not.
    """

    def __init__(self, client: Any, address: str, timeout: float) -> None:
        self.address = address
        self.lost = ""
        self._client = client
        self._timeout = timeout
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="cluster watch", daemon=True)

    def __enter__(self) -> ClusterWatch:
        _WATCHES[self._client] = self
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        without = 0.0
        while not self._ended.wait(WATCH_INTERVAL):
            try:
                without = 0.0 if self._client.nthreads() else without + WATCH_INTERVAL
            except (OSError, CancelledError):
                return  # the scheduler is lost, and the client cancels its computations itself
            if without > self._timeout:
                self.lost = f"no worker for {self._timeout:g} s"
                self._client.close()
                return


_WATCHES: WeakKeyDictionary[Any, ClusterWatch] = WeakKeyDictionary()


@contextmanager
def report_loss(client: Any) -> Iterator[None]:
    """Raise ClusterFailed for what a lost cluster raises in a computation of ``client``."""
    from distributed import KilledWorker

    watch = _WATCHES.get(client)
    if watch is None:  # a cluster that the program has given to joblib itself
        yield
        return
    try:
        yield
    # OSError includes the errors of a connection and a time-out.
    except (CancelledError, KilledWorker, OSError) as error:
        # What the work itself raises, such as a missing file, is no loss of the cluster.
        if isinstance(error, DartHalError) or getattr(error, "filename", None) is not None:
            raise
        raise ClusterFailed(
            f"the cluster at {watch.address} was lost while it computed",
            found=watch.lost or str(error) or type(error).__name__,
            expected="a scheduler and workers that run until the end",
            likely="the scheduler or its workers were stopped, the network was cut, or a worker "
                   "ran out of memory",
            remedy="start the scheduler and the workers again, then the same command, which has "
                   "written no result; or leave out --cluster") from error


@contextmanager
def _mute_logger(name: str) -> Iterator[None]:
    """Let the handlers of a logger show nothing below CRITICAL."""
    levels = {handler: handler.level for handler in logging.getLogger(name).handlers}
    for handler in levels:
        handler.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for handler, level in levels.items():
            handler.setLevel(level)


def describe_installation() -> dict[str, str]:
    """Return what must agree on all computers of a cluster: versions, and a hash of the source."""
    digest = hashlib.sha256()
    for package in PACKAGES_WITH_SOURCE:
        spec = find_spec(package)
        for folder in (spec.submodule_search_locations or ()) if spec else ():
            for file in sorted(Path(folder).rglob("*.py")):
                digest.update(file.relative_to(folder).as_posix().encode() + file.read_bytes())
    return {"dart-hal": f"{__version__} (source {digest.hexdigest()[:8]})",
            "Python": ".".join(platform.python_version_tuple()[:2]),
            **{name: _package_version(name) for name in COMPARED_PACKAGES}}


def _package_version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


@contextmanager
def _connect(address: str, timeout: float) -> Iterator[Any]:
    """Connect to the scheduler. Raises ClusterFailed where none answers in time."""
    from distributed import Client

    try:
        # The client waits for ever for a program that accepts the connection and sends nothing; a
        # scheduler sends the first byte.
        with socket.create_connection(_parse_address(address), timeout) as probe:
            if not probe.recv(1):
                raise ConnectionError("the connection was closed")
        client: Any = Client(  # type: ignore[no-untyped-call]
            address, timeout=timeout, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ClusterFailed(
            f"no dask scheduler answers at {address} within {timeout:g} s",
            found=str(error) or type(error).__name__,
            expected="the address that the scheduler prints, such as tcp://192.168.1.5:8786",
            remedy="dask scheduler ; on each computer: "
                   + START_WORKERS.format(address="SCHEDULER:8786")) from None
    with client:
        yield client


def _parse_address(address: str) -> tuple[str, int]:
    """Return host and port. Raises ValueError for another form than tcp://HOST:PORT."""
    url = urlsplit(address if "://" in address else f"tcp://{address}")
    if url.scheme != "tcp" or not url.hostname or url.port is None:
        raise ValueError(address)
    return url.hostname, url.port


def _check_workers(client: Any, address: str, timeout: float) -> int:
    """Return the number of workers. Raises ClusterFailed where they would compute otherwise."""
    start = START_WORKERS.format(address=address)
    try:
        client.wait_for_workers(MIN_WORKERS, timeout=timeout)
    except TimeoutError:
        raise ClusterFailed(
            f"the scheduler at {address} has fewer than {MIN_WORKERS} workers",
            found=f"{len(client.nthreads())}", expected=f"at least {MIN_WORKERS}: a single one is "
            "no faster than this computer", remedy=start) from None
    # 1. One thread in each: computations of one process would share their caches.
    threads = client.nthreads()
    several = {worker: n for worker, n in threads.items() if n != 1}
    if several:
        worker, n = next(iter(several.items()))
        raise ClusterFailed(f"{len(several)} of {len(threads)} workers have several threads",
                            found=f"{worker}: {n} threads", expected="one thread in each worker",
                            remedy=start)
    # 2. The same software: a worker without it returns the exception of its import.
    installed = describe_installation()
    for worker, answer in client.run(describe_installation, on_error="return").items():
        versions = answer if isinstance(answer, dict) else {"dart-hal": "none, or an older one"}
        differing = [name for name in installed if versions.get(name) != installed[name]]
        if differing:
            name = differing[0]
            raise ClusterFailed(
                f"the worker {worker} has another version of {name} than this computer",
                found=versions.get(name, "unknown"), expected=installed[name],
                remedy="install the same there, then start the worker again")
    return len(threads)
