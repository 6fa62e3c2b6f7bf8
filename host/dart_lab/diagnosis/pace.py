"""Progress of work of unknown length, from the number of model evaluations.

    share = start + (end - start) (1 - e^(-n / expected))         after n evaluations of a phase

The share never decreases, and it changes with each evaluation.
"""

from __future__ import annotations

import math

from .search.scan import Progress

MIN_SHARE_STEP = 5e-4  # of the whole; a progress bar is 80 characters wide


class ProgressEstimator:
    """Report progress to a callback; None reports nothing."""

    def __init__(self, progress: Progress | None) -> None:
        self._progress = progress
        self._share = 0.0
        self._start = 0.0
        self._end = 0.0
        self._what = ""
        self._steps = 0
        self._expected = 1.0

    def start_phase(self, end: float, what: str, expected: float) -> None:
        """Start a phase that ends at the share ``end``, after about ``expected`` evaluations."""
        self._start = self._share
        self._end = end
        self._what = what
        self._steps = 0
        self._expected = expected
        self._report(self._share)

    def set_share(self, share: float, what: str) -> None:
        """Report a share that is known."""
        self._share = max(self._share, share)
        self._start = self._share
        self._what = what
        self._steps = 0
        self._report(self._share)

    def count_evaluation(self) -> None:
        """Count one evaluation of a model, and report if the share has changed visibly."""
        self._steps += 1
        done = 1.0 - math.exp(-self._steps / self._expected)
        share = self._start + (self._end - self._start) * done
        if share > self._share + MIN_SHARE_STEP:
            self._share = share
            self._report(share)

    def _report(self, share: float) -> None:
        if self._progress is not None:
            self._progress(share, self._what)
