"""The next drive: what would separate causes that these data cannot tell apart."""

from .choose import suggest
from .result import Pair, Prediction, Suggestion, Tried
from .sharpen import Sharper, sharpen

__all__ = ["Pair", "Prediction", "Sharper", "Suggestion", "Tried", "sharpen", "suggest"]
