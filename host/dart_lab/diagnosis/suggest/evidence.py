"""Evidence of a simulated drive and the noise that a diagnosis would measure on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.types import FloatArray, IntArray
from dart_hal.recording.dart import Recording, Reference
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evidence.drive import prepare_drive
from dart_lab.identification.evidence.noise import Noise, estimate_noise
from dart_lab.identification.evidence.onboard import OnboardEvidence
from dart_lab.identification.evidence.onboard_drive import prepare_stretches
from dart_lab.identification.evidence.residuals import Evidence, Residuals
from dart_lab.identification.evidence.space import MessageTiming

from ..policy import Policy
from .virtual import COMMAND_AGE

GYRO_NOISE = 0.004  # rad/s of a car at rest, if the data have no rest
NOISE_RUN = 4  # rows in a row that noise is drawn in: windows of 2 s
BLOCK_LABEL_OFFSET = 10**9  # makes the labels of blocks of a new drive unique
MOCAP = "motion capture"
ONBOARD = "on-board sensors"
LOG_TIMING = MessageTiming(0.0, COMMAND_AGE)  # of ``virtual.record``


@dataclass(frozen=True, slots=True)
class Setting:
    """How drives are judged. needs: MOCAP or ONBOARD.

    final_residuals, base_residuals: residuals of the data at hand in SI units, of their best model
    (unexplained by any hypothesis, the source of simulated noise) and of the base. blocks: as
    ``Evidence.blocks``. noise: as measured by a diagnosis of these data. noise_scale: as
    ``Session.noise_scale``, which a drive without noise cannot give.
    """

    needs: str
    l_r: float
    reference: Reference
    final_residuals: Residuals
    base_residuals: Residuals
    blocks: tuple[IntArray, IntArray]
    noise: Noise
    noise_scale: FloatArray
    policy: Policy

    def make_evidence(self, recordings: Sequence[Recording]) -> Evidence:
        """Evidence or OnboardEvidence of recordings; it may be empty."""
        if self.needs == MOCAP:
            return Evidence([prepare_drive(r, self.l_r, self.reference, policy=self.policy.evidence)
                             for r in recordings], self.l_r)
        return OnboardEvidence([replace(o, noise_scale=self.noise_scale) for r in recordings
                                for o in prepare_stretches(r, self.policy.evidence)], self.l_r)

    def draw_noise(self, evidence: Evidence, rng: np.random.Generator) -> Residuals:
        """Draw noise for every row of an evidence."""
        return Residuals(_draw_runs(self.final_residuals.motion, len(evidence.motion_drive), rng),
                         _draw_runs(self.final_residuals.sensors, len(evidence.sensor_drive), rng))

    def measure_joint_noise(self, evidence: Evidence, base: Vehicle, truth: Vehicle,
                            rng: np.random.Generator) -> Noise:
        """Measure the noise of these data and a new drive together, for the base alone.

        Changes by the cause are part of this noise: large effects have less weight.
        """
        predicted, true = (evidence.residuals(p, LOG_TIMING) for p in (base, truth))
        noise = self.draw_noise(evidence, rng)
        old = self.base_residuals
        new = (predicted.motion - true.motion + noise.motion,
               predicted.sensors - true.sensors + noise.sensors)
        blocks = tuple(np.concatenate([existing, BLOCK_LABEL_OFFSET + added]) for existing,
                       added in zip(self.blocks, evidence.blocks(), strict=True))
        return estimate_noise(Residuals(np.concatenate([old.motion, new[0]]),
                                 np.concatenate([old.sensors, new[1]])), (blocks[0], blocks[1]),
                       policy=self.policy.noise)

    def remaining_share(self, noise: Noise) -> float:
        """Share of the loss by the cause on the data at hand that remains with another noise."""
        cause = Residuals(self.base_residuals.motion - self.final_residuals.motion,
                          self.base_residuals.sensors - self.final_residuals.sensors)
        own, other = (float(weight @ self.noise.loss(x)) for x, weight in (
            self.noise.stack(cause), noise.stack(cause)))
        return min(other / own, 1.0) if own > 0.0 else 0.0


def make_setting(evidence: Evidence, base: Vehicle, full: Vehicle, timing: MessageTiming,
                 reference: Reference, policy: Policy) -> Setting:
    """Make the setting of the data at hand; full: their best model, base: without the cause."""
    r, base_residuals = (evidence.residuals(p, timing) for p in (full, base))
    needs = ONBOARD if isinstance(evidence, OnboardEvidence) else MOCAP
    if needs == ONBOARD and not any(drive.at_rest.any() for drive in evidence.drives):
        # Without a standstill the noise of the gyro is unknown: use that of the policy.
        quiet = GYRO_NOISE * np.random.default_rng(0).normal(size=len(r.sensors))
        r, base_residuals = (replace(x, sensors=np.column_stack(
            [x.sensors[:, :1], quiet, x.sensors[:, 2:]])) for x in (r, base_residuals))
    blocks = evidence.blocks()
    return Setting(needs, evidence.l_r, reference, r, base_residuals, blocks,
                   estimate_noise(base_residuals, blocks, policy=policy.noise),
                   _noise_scale(evidence), policy)


def select_onboard(evidence: Evidence, policy: Policy) -> OnboardEvidence | None:
    """The same recordings by on-board sensors alone; None if they have no motion or only those."""
    if isinstance(evidence, OnboardEvidence):
        return None
    alone = OnboardEvidence([o for d in evidence.drives for o in prepare_stretches(
        d.recording, policy.evidence)], evidence.l_r)
    return alone if len(alone.motion_drive) else None


def _noise_scale(evidence: Evidence) -> FloatArray:
    """Median noise scale of the recordings, (2,)."""
    if not isinstance(evidence, OnboardEvidence):
        return np.ones(2)
    return np.asarray(np.median([drive.noise_scale for drive in evidence.drives], axis=0))


def _draw_runs(rows: FloatArray, n: int, rng: np.random.Generator) -> FloatArray:
    """Draw n of the rows (m, c) in runs of correlated noise; each run with a random sign."""
    if not n or not len(rows):
        return np.zeros((n, rows.shape[1]))
    starts = rng.integers(0, max(len(rows) - NOISE_RUN, 1), n // NOISE_RUN + 1)
    index = np.minimum(starts[:, None] + np.arange(NOISE_RUN), len(rows) - 1)
    sign = rng.choice([-1.0, 1.0], len(starts))
    return np.asarray((rows[index] * sign[:, None, None]).reshape(-1, rows.shape[1])[:n])
