"""Joint fit by multiple shooting: all sub-models together, on their prediction errors.

The paper identifies one sub-model after the other, and each step passes its error to the next.
Here short windows of the recordings are predicted from their measured start, and all parameters
are fitted together to the measured motion. Confounded sub-models show in the covariance.
"""

from __future__ import annotations

from .fit import FREE, JointFit, fit_from_recordings, fit_jointly
from .problem import CHANNELS, ShootingProblem

__all__ = ["CHANNELS", "FREE", "JointFit", "ShootingProblem", "fit_from_recordings", "fit_jointly"]
