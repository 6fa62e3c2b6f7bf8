"""The command line: everything that prints.

Linear algebra has one thread here. Its matrices are small, so threads wait for each
other, and sums in another order end a fit elsewhere: the same files shall
give the same answer on every number of cores.
"""

import os

for _threads in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")
