"""How sure a plan is: the covariance of the estimate, carried along, and what each stage adds.

It is that of the inputs as they are planned, which nobody corrects: a car that plans anew each
0.1 s comes nearer to its first plan than that.
"""

from __future__ import annotations

import numpy as np

from dart_hal.control.mpc.planner import Plan
from dart_hal.core.types import FloatArray

# States of a plan that an estimate of the motion has a covariance of.
KNOWN = (0, 1, 2, 3, 5)
# What a stage adds: rad of the heading for each m/s, m/s, m. By ten cars whose parameters are 5 %
# off (``studies.control.mpc_spread``): 1.6 cm across after 1 s at 1 m/s, 6 at 2 m/s.
TURNED = 0.010
FASTER = 0.02
PLACED = 0.002


def across(plan: Plan, cov: FloatArray) -> FloatArray:
    """Standard deviation [m] across its heading of each state (n + 1,) of a plan, from the
    covariance (5, 5) of the motion at its begin."""
    first = np.zeros((8, 8))
    first[np.ix_(KNOWN, KNOWN)] = cov
    adds = np.array((PLACED, PLACED, TURNED * plan.states[:, 3].mean(), FASTER, 0, 0, 0, 0))
    spread = plan.covariances(first, np.diag(np.square(adds)))
    psi = plan.states[:, 2]
    normal = np.stack([-np.sin(psi), np.cos(psi)], axis=1)
    std: FloatArray = np.sqrt(np.einsum("ki,kij,kj->k", normal, spread[:, :2, :2], normal))
    return std
