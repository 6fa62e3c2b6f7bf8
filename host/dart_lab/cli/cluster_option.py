"""``--cluster``: the verbs with long computations run them on the workers of a dask scheduler."""

from __future__ import annotations

import click

from dart_hal.cli.common.options import CommandT
from dart_hal.cli.common.output import show_notices


def cluster_option(command: CommandT) -> CommandT:
    """Add ``--cluster``: the address of a dask scheduler, for ``connect_cluster``."""
    return click.option("--cluster", metavar="ADDRESS", default=None,
                        help="compute on the workers of the dask scheduler at this address, such "
                        "as tcp://192.168.1.5:8786; the result is the same")(command)


def connect_cluster(address: str | None) -> None:
    """Compute on the cluster until the verb ends. Call it after the arguments are checked.

    Raises ClusterFailed, and UsageError without the package distributed.
    """
    if address is None:
        return
    from dart_hal.core.process.cluster import use_cluster

    workers = click.get_current_context().with_resource(use_cluster(address))
    show_notices((f"computing on {workers} workers of {address}",))
