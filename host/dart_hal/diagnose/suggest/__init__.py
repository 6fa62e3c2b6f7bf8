"""The next drive: what would separate causes that these data cannot tell apart."""

from .choose import suggest
from .result import Pair, Prediction, Suggestion, Tried

__all__ = ["Pair", "Prediction", "Suggestion", "Tried", "suggest"]
