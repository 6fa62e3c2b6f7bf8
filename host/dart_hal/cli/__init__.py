"""The command line. Only this package prints.

Linear algebra runs on one thread. The matrices are small, so several threads would mostly wait
for each other. They would also add in another order, which changes the result of a fit in its
last digits: the same files must give the same answer on any number of cores.
"""

import os

# numpy reads these variables when it is imported, so they are set before.
for _threads in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")
