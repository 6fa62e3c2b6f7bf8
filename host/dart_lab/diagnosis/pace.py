"""Progress where nothing says how long it takes: a little with each evaluation of a model.

    share = from + (to - from) (1 - e^(-n / expected))         after n evaluations of a phase

It never goes back, and it stands only as long as one evaluation takes.
"""

from __future__ import annotations

import math

from .search.scan import Progress

LEAST = 5e-4  # of the whole; a bar is 80 characters wide


class Pace:
    """Tells of phases; ``progress`` None: nobody listens."""

    def __init__(self, progress: Progress | None) -> None:
        self._progress = progress
        self._share = self._from = self._to = 0.0
        self._what, self._steps, self._expected = "", 0, 1.0

    def phase(self, to: float, what: str, expected: float) -> None:
        """What comes next goes as far as ``to``, in about as many evaluations."""
        self._from, self._to, self._what = self._share, to, what
        self._steps, self._expected = 0, expected
        self._tell(self._share)

    def at(self, share: float, what: str) -> None:
        """So far it is, as somebody knows."""
        self._share = self._from = max(self._share, share)
        self._what, self._steps = what, 0
        self._tell(self._share)

    def step(self) -> None:
        """One more evaluation."""
        self._steps += 1
        done = 1.0 - math.exp(-self._steps / self._expected)
        share = self._from + (self._to - self._from) * done
        if share > self._share + LEAST:
            self._share = share
            self._tell(share)

    def _tell(self, share: float) -> None:
        if self._progress is not None:
            self._progress(share, self._what)
