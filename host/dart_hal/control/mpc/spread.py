"""Uncertainty of a plan: the propagated covariance of the estimate, plus process noise of each
stage.

It is that of the planned inputs without feedback. A car that plans again every 0.1 s stays closer
to its first plan.
"""

from __future__ import annotations

import numpy as np

from dart_hal.control.mpc.planner import MpcPlan
from dart_hal.core.types import FloatArray

# States of a plan that the covariance of the motion estimate covers.
ESTIMATED_STATES = (0, 1, 2, 3, 5)
# Process noise of a stage: heading [rad] for each m/s, speed [m/s], position [m]. From ten cars
# whose parameters are 5 % off (``studies.control.mpc_spread``): 1.6 cm lateral after 1 s at 1 m/s,
# 6 cm at 2 m/s.
HEADING_STD_PER_SPEED = 0.010
SPEED_STD = 0.02
POSITION_STD = 0.002


def lateral_std(plan: MpcPlan, cov: FloatArray) -> FloatArray:
    """Return the standard deviation [m] across the heading of each state (n + 1,) of a plan.

    cov (5, 5): covariance of the motion estimate. It counts as that of the first state, which is
    predicted from that estimate over the transport delay.
    """
    first = np.zeros((8, 8))
    first[np.ix_(ESTIMATED_STATES, ESTIMATED_STATES)] = cov
    heading_std = HEADING_STD_PER_SPEED * plan.states[:, 3].mean()
    stage_std = np.array((POSITION_STD, POSITION_STD, heading_std, SPEED_STD, 0, 0, 0, 0))
    covariances = plan.covariances(first, np.diag(np.square(stage_std)))
    psi = plan.states[:, 2]
    normal = np.stack([-np.sin(psi), np.cos(psi)], axis=1)
    std: FloatArray = np.sqrt(np.einsum("ki,kij,kj->k", normal, covariances[:, :2, :2], normal))
    return std
