"""One drive, simulated with each hypothesis in turn as the truth."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from dart_hal.recording.dart import Recording
from dart_hal.vehicle.effects import apply, catalogue
from dart_hal.vehicle.parameters import Vehicle

from .contest import Contest, Mimic, per_recording
from .evidence import MIDDLE, Setting
from .library import Rehearsed
from .side import Side
from .virtual import record

if TYPE_CHECKING:
    from .question import Question


class Race:
    """Every hypothesis of a question as the truth of a drive, all the others against it."""

    def __init__(self, question: Question, drive: Rehearsed, setting: Setting,
                 seed: int = 0) -> None:
        self.question, self.drive, self.setting = question, drive, setting
        self._rng = np.random.default_rng(seed)
        self._right: dict[tuple[str, str], float] = {}
        names = question.names
        self._contests = {truth: self._contest(truth) for truth in names}
        self._mimics: dict[tuple[str, str], Mimic | None] = {}
        for truth, confounder in ((a, b) for a in names for b in names if a != b):
            self._mimics[truth, confounder] = self._contests[truth].mimic(confounder)
        pairs = [self.between(a, b) for a, b in combinations(names, 2)]
        self.least = min(pairs, default=0.0)
        self.separated = sum(sd >= question.policy.suggest.separation for sd in pairs)

    def between(self, a: str, b: str) -> float:
        """Standard deviations between two, whichever is the truth: the smaller one."""
        mimics = self._mimics[a, b], self._mimics[b, a]
        return min(m.separation if m else 0.0 for m in mimics)

    @property
    def moves(self) -> bool:
        """Whether the car drives at all, so that there are windows of motion."""
        return any(len(side.evidence.motion_drive)
                   for contest in self._contests.values() for side in contest.sides)

    def mimic(self, truth: str, confounder: str) -> Mimic | None:
        """The confounder at its best; None where the drive tells nothing at all."""
        return self._mimics[truth, confounder]

    def surest(self) -> float:
        """The smallest share of ``right`` of any pair."""
        return min((self.right(a, b) for a, b in combinations(self.question.names, 2)),
                   default=0.0)

    def right(self, a: str, b: str) -> float:
        """Share of simulated repeats in which the truth wins, the smaller of both directions."""
        if (a, b) not in self._right:
            self._right[a, b] = self._simulated(a, b)
        return self._right[a, b]

    def _simulated(self, a: str, b: str) -> float:
        shares = []
        for truth, confounder in ((a, b), (b, a)):
            mimic = self._mimics[truth, confounder]
            shares.append(0.5 if mimic is None else self._contests[truth].right(
                mimic, lambda side: self.setting.drawn(side.evidence, self._rng),
                self.question.policy.suggest.repeats))
        return min(shares)

    def recording(self, p: Vehicle, part: int = 0) -> Recording:
        """The drive of a car, free of noise."""
        one = self.drive.choice.parts[part]
        return record(p, self.drive.commands[part], self.setting.reference,
                      one.experiment, one.yaw)

    def _contest(self, truth: str) -> Contest:
        q, sides = self.question, []
        for i, part in enumerate(self.drive.choice.parts):
            car = _weaker(q.cars[truth], truth, part.battery)
            evidence = self.setting.of([self.recording(car, i)])
            if len(evidence.drives) and len(evidence.motion_drive) + len(evidence.sensor_drive):
                noise = self.setting.together(evidence, q.base, car, self._rng)
                sides.append(Side(evidence, noise, q.base, car, q.free, q.known, MIDDLE,
                                  q.policy.prior))
        if not sides:
            return Contest((), q.base)
        share = min(self.setting.share(side.noise) for side in sides)
        sizes = q.sizes[self.setting.needs]
        return Contest(sides, q.base, lambda *size: share * sizes(*size))


def _weaker(p: Vehicle, name: str, battery: float) -> Vehicle:
    """The car with a hypothesis whose level belongs to the recording, that much lower."""
    if not battery or not per_recording(name):
        return p
    first = catalogue()[name].parameters[0]
    have = next(a for a in p.effects if a.name == name)
    level = max(have.values[0] - battery * first.sizes[1], first.low)
    return apply(p, name, **{first.name: level})
