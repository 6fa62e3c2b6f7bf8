"""Diagnose recordings on a cluster: here two processes of this computer, elsewhere any number.

What takes long in `dart_hal` fans out through joblib, so one line decides where
it runs: `parallel_config(backend="dask")`. The result is the same as in one
process. For a cluster of several computers give Client the scheduler's address.

    pip install -e '.[cluster]'
    python examples/diagnose_on_a_cluster.py TRAIN TEST
"""

import sys

from dask.distributed import Client
from joblib import parallel_config

from dart_hal import find_model, read_any
from dart_lab import check_inputs, diagnose

DATA = "tests/recorded/data/"
TRAIN, TEST = DATA + "50_tire_model_data", DATA + "91_free_driving_16_sept_2024"


def diagnosed(train, test, **options):
    """What the model of the paper gets wrong on folders or files of recordings."""
    file, vehicle = find_model("paper")
    sides = check_inputs(read_any([train])[0], read_any([test])[0], vehicle)
    return diagnose(file, vehicle, sides.train, sides.test, **options)


def main(train=TRAIN, test=TEST):
    with Client(n_workers=2, threads_per_worker=1, dashboard_address=None), \
            parallel_config(backend="dask"):  # this line decides where it runs
        found = diagnosed(train, test, max_causes=1)
    print(found.verdict, *(f"{c.effect}: {c.title}" for c in found.causes), sep="\n")


if __name__ == "__main__":  # the workers import this file
    main(*sys.argv[1:])
