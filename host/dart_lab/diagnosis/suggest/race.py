"""One drive, simulated with each hypothesis in turn as the truth."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from dart_hal.recording.dart import Recording
from dart_hal.vehicle.effects import apply, effect_for
from dart_hal.vehicle.parameters import Vehicle

from .contest import DriveComparison, FittedConfounder, is_per_recording
from .evidence import LOG_TIMING, Setting
from .library import RehearsedDrive
from .side import RecordingComparison
from .virtual import record

REPEATS = 200  # simulated; a share of 0.95 is known to 0.015

if TYPE_CHECKING:
    from .question import ConfounderQuestion


class DriveSimulation:
    """Simulations of a drive with every hypothesis as the truth, and all others fitted to it."""

    def __init__(self, question: ConfounderQuestion, drive: RehearsedDrive, setting: Setting,
                 seed: int = 0) -> None:
        self.question = question
        self.drive = drive
        self.setting = setting
        self._rng = np.random.default_rng(seed)
        self._correct_shares: dict[tuple[str, str], float] = {}
        names = question.names
        self._comparisons = {truth: self._compare(truth) for truth in names}
        self._confounders: dict[tuple[str, str], FittedConfounder | None] = {}
        for truth, confounder in ((a, b) for a in names for b in names if a != b):
            self._confounders[truth,
                              confounder] = self._comparisons[truth].fit_confounder(confounder)
        pairs = [self.separation(a, b) for a, b in combinations(names, 2)]
        self.min_separation = min(pairs, default=0.0)
        self.separated_pairs = sum(sd >= question.policy.suggest.separation for sd in pairs)

    def separation(self, a: str, b: str) -> float:
        """Standard deviations between two hypotheses, the smaller of both directions."""
        both = self._confounders[a, b], self._confounders[b, a]
        return min(m.separation if m else 0.0 for m in both)

    @property
    def has_motion(self) -> bool:
        """Check that the car moves, so that there are windows of motion."""
        return any(len(recording.evidence.motion_drive) for comparison in self._comparisons.values()
                   for recording in comparison.recordings)

    def fitted_confounder(self, truth: str, confounder: str) -> FittedConfounder | None:
        """The confounder at its best size; None if the drive has no data."""
        return self._confounders[truth, confounder]

    def correct_share(self, a: str, b: str) -> float:
        """Share of simulated repeats in which the truth fits better, in the worse direction."""
        if (a, b) not in self._correct_shares:
            self._correct_shares[a, b] = self._simulate_correct_share(a, b)
        return self._correct_shares[a, b]

    def _simulate_correct_share(self, a: str, b: str) -> float:
        """Simulate ``correct_share``."""
        shares = []
        for truth, confounder in ((a, b), (b, a)):
            fitted = self._confounders[truth, confounder]
            shares.append(0.5 if fitted is None else self._comparisons[truth].correct_share(
                fitted, lambda recording: self.setting.draw_noise(recording.evidence, self._rng),
                REPEATS))
        return min(shares)

    def recording(self, p: Vehicle, part: int = 0) -> Recording:
        """The recording of a car on this drive, without noise."""
        one = self.drive.choice.parts[part]
        return record(p, self.drive.commands[part], self.setting.reference,
                      one.experiment, one.yaw)

    def _compare(self, truth: str) -> DriveComparison:
        """Simulate all parts with one hypothesis as the truth."""
        q = self.question
        recordings = []
        for i, part in enumerate(self.drive.choice.parts):
            car = _lower_level(q.cars[truth], truth, part.battery)
            evidence = self.setting.make_evidence([self.recording(car, i)])
            if len(evidence.drives) and len(evidence.motion_drive) + len(evidence.sensor_drive):
                noise = self.setting.measure_joint_noise(evidence, q.base, car, self._rng)
                recordings.append(RecordingComparison(evidence, noise, q.base, car, q.free, q.known,
                                                      LOG_TIMING, q.policy.prior))
        if not recordings:
            return DriveComparison((), q.base)
        # Sizes on the data at hand count less if the noise of the new drive is larger.
        share = min(self.setting.remaining_share(recording.noise) for recording in recordings)
        sizes = q.sizes[self.setting.needs]
        return DriveComparison(recordings, q.base, lambda *size: share * sizes(*size))


def _lower_level(p: Vehicle, name: str, battery: float) -> Vehicle:
    """The car with a hypothesis whose level may differ between recordings, lower by ``battery``."""
    if not battery or not is_per_recording(name):
        return p
    first = effect_for(p, name).parameters[0]
    have = next(a for a in p.effects if a.name == name)
    level = max(have.values[0] - battery * first.sizes[1], first.low)
    return apply(p, name, **{first.name: level})
