"""Compute on the workers of a dask scheduler: everything that uses ``jobs.each``."""

from __future__ import annotations

import hashlib
import platform
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from dart_hal import __version__
from dart_hal.core.errors import ClusterFailed
from dart_hal.core.process.extras import missing_module_error

# s to wait for the scheduler, and then for its workers.
CONNECT_TIMEOUT = 10.0
MIN_WORKERS = 2
# Packages whose version may change the last bits of a result.
COMPARED_PACKAGES = ("numpy", "scipy")
PACKAGES_WITH_SOURCE = ("dart_hal", "dart_lab")
START_WORKERS = "dask worker {address} --nworkers auto --nthreads 1"


@contextmanager
def use_cluster(address: str | None, timeout: float = CONNECT_TIMEOUT) -> Iterator[int]:
    """Let ``jobs.each`` compute on a cluster; give the number of its workers.

    Args:
        address: of the dask scheduler, such as ``tcp://192.168.1.5:8786``; None: this computer,
            and the number is 0.
        timeout: s to wait for the scheduler, and then for its workers.

    Raises:
        ClusterFailed: no scheduler answers, it has fewer than two workers, or a worker has
            several threads or another version of this software.
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
    from joblib import parallel_config

    with _connect(address, timeout) as client, parallel_config(backend="dask", client=client):
        yield _check_workers(client, address, timeout)


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
