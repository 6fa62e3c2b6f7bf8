"""Joint fit by multiple shooting: all sub-models together, on what they predict.

One sub-model at a time is how the paper identifies, and each step hands its
error to the next. Here short stretches of the recordings are predicted from
their measured start, and all parameters move together until the predictions
fit; what two sub-models explain alike shows in the covariance.
"""

from __future__ import annotations

from .fit import FREE, JointFit, fit_from_recordings, fit_jointly
from .problem import CHANNELS, Problem

__all__ = ["CHANNELS", "FREE", "JointFit", "Problem", "fit_from_recordings", "fit_jointly"]
