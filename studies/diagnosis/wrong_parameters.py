"""Parameters of a stranger's car that are not as its model says: groups, and how they are altered.

A steering delay is only made longer: that of commands logged at 10 Hz could as well be shorter by
their age, which nobody knows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from studies.diagnosis.stranger import Car


def _times(*names: str) -> Callable[[Car, float], None]:
    def alter(car: Car, share: float) -> None:
        for name in names:
            setattr(car, name, getattr(car, name) * (1.0 + share))

    return alter


def _later(name: str) -> Callable[[Car, float], None]:
    def alter(car: Car, seconds: float) -> None:
        setattr(car, name, getattr(car, name) + seconds)

    return alter


WRONG: Mapping[str, tuple[Callable[[Car, float], None], tuple[float, float], bool]] = {
    "friction": (_times("fa", "fb", "fc"), (0.12, 0.30), True),
    "motor": (_times("md", "me"), (0.12, 0.30), True),
    "steering map": (_times("a_left", "a_right"), (0.05, 0.10), True),
    "steering timing": (_later("steer_delay"), (0.03, 0.06), False),
    "throttle timing": (_later("gas_delay"), (0.05, 0.10), False),
    "front tyre": (_times("D"), (0.12, 0.30), True),
    "rear tyre": (_times("Cr"), (0.12, 0.30), True)}
"""By group: how it is altered, by how much at least and at most (a share, or s), either sign."""
COVERS = {"drive force": {"friction", "motor"}, "tyres": {"front tyre", "rear tyre"},
          "command timing": {"steering timing", "throttle timing"}}
"""Claims of two groups that the data do not tell apart."""


def drawn(rng: np.random.Generator, most: int = 3) -> tuple[tuple[str, float], ...]:
    """One to ``most`` groups and by how much each is altered."""
    picks = rng.choice(list(WRONG), int(rng.integers(1, most + 1)), replace=False)
    out = []
    for name in map(str, picks):
        _, (low, high), signed = WRONG[name]
        sign = float(rng.choice([-1.0, 1.0])) if signed else 1.0
        out.append((name, sign * float(rng.uniform(low, high))))
    return tuple(out)


def claimed(hidden: set[str], groups: list[str]) -> tuple[int, int]:
    """(false claims, groups that were altered and are not claimed)."""
    left, false = set(hidden), 0
    for group in groups:
        covered = COVERS.get(group, {group}) & left
        false += not covered
        left -= covered
    return false, len(left)
