"""What the diagnosis would make of a drive: the same evidence, and the noise it would meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.types import FloatArray, IntArray
from dart_hal.recording.dart import Recording, Reference
from dart_hal.vehicle.parameters import Vehicle

from ..evidence.drive import prepare_drive
from ..evidence.noise import Noise, estimate_noise
from ..evidence.onboard import OnboardEvidence
from ..evidence.onboard_drive import prepare_stretches
from ..evidence.residuals import Evidence, Residuals
from ..evidence.space import MessageTiming
from ..policy import Policy
from .virtual import COMMAND_AGE

FURTHER = 10**9  # added to labels of blocks, so that they are others
MOCAP, ONBOARD = "motion capture", "on-board sensors"
MIDDLE = MessageTiming(0.0, COMMAND_AGE)
"""How ``virtual.record`` stamps."""


@dataclass(frozen=True, slots=True)
class Setting:
    """How drives are judged. needs: MOCAP or ONBOARD.

    rest, lacking: residuals of the data at hand in SI units, of their best model
    (what no hypothesis explains, to be drawn from) and of the base; blocks: as
    ``Evidence.blocks``; noise: as a diagnosis of these data measures it; noise_scale:
    as ``OnboardStretch.noise_scale``, which a drive without noise cannot tell.
    """

    needs: str
    l_r: float
    reference: Reference
    rest: Residuals
    lacking: Residuals
    blocks: tuple[IntArray, IntArray]
    noise: Noise
    noise_scale: FloatArray
    policy: Policy

    def of(self, recordings: Sequence[Recording]) -> Evidence:
        """Evidence or OnboardEvidence of recordings; it may be empty."""
        if self.needs == MOCAP:
            return Evidence([prepare_drive(r, self.l_r, self.reference, policy=self.policy.evidence)
                             for r in recordings], self.l_r)
        return OnboardEvidence([replace(o, noise_scale=self.noise_scale) for r in recordings
                                for o in prepare_stretches(r, self.policy.evidence)], self.l_r)

    def drawn(self, evidence: Evidence, rng: np.random.Generator) -> Residuals:
        """Noise for every row of an evidence."""
        run = self.policy.suggest.run
        return Residuals(_runs(self.rest.motion, len(evidence.motion_drive), rng, run),
                         _runs(self.rest.sensors, len(evidence.sensor_drive), rng, run))

    def together(self, evidence: Evidence, base: Vehicle, truth: Vehicle,
                 rng: np.random.Generator) -> Noise:
        """As a diagnosis of these data and a new drive measures it, which knows the base alone.

        What the cause does is noise to it: large effects weigh less.
        """
        ours, theirs = (evidence.residuals(p, MIDDLE) for p in (base, truth))
        drawn, old = self.drawn(evidence, rng), self.lacking
        new = (ours.motion - theirs.motion + drawn.motion,
               ours.sensors - theirs.sensors + drawn.sensors)
        blocks = tuple(np.concatenate([was, FURTHER + is_]) for was, is_ in zip(
            self.blocks, evidence.blocks(self.policy.blocks.seconds), strict=True))
        return estimate_noise(Residuals(np.concatenate([old.motion, new[0]]),
                                 np.concatenate([old.sensors, new[1]])), (blocks[0], blocks[1]),
                       policy=self.policy.noise)

    def share(self, noise: Noise) -> float:
        """Of what the data at hand say of the cause, that other noise leaves."""
        cause = Residuals(self.lacking.motion - self.rest.motion,
                          self.lacking.sensors - self.rest.sensors)
        own, other = (float(weight @ self.noise.loss(x)) for x, weight in (
            self.noise.stack(cause), noise.stack(cause)))
        return min(other / own, 1.0) if own > 0.0 else 0.0


def setting(evidence: Evidence, base: Vehicle, full: Vehicle, timing: MessageTiming,
            reference: Reference, policy: Policy) -> Setting:
    """From the data at hand; full is the best model of them, base lacks the cause."""
    r, lacking = (evidence.residuals(p, timing) for p in (full, base))
    needs = ONBOARD if isinstance(evidence, OnboardEvidence) else MOCAP
    if needs == ONBOARD and not any(drive.at_rest.any() for drive in evidence.drives):
        quiet = policy.suggest.gyro_noise * np.random.default_rng(0).normal(size=len(r.sensors))
        r, lacking = (replace(x, sensors=np.column_stack(
            [x.sensors[:, :1], quiet, x.sensors[:, 2:]])) for x in (r, lacking))
    blocks = evidence.blocks(policy.blocks.seconds)
    return Setting(needs, evidence.l_r, reference, r, lacking, blocks,
                   estimate_noise(lacking, blocks, policy=policy.noise),
                   _noise_scale(evidence), policy)


def without_mocap(evidence: Evidence, policy: Policy) -> OnboardEvidence | None:
    """The same recordings by their own sensors alone; None where that says nothing, or is all."""
    if isinstance(evidence, OnboardEvidence):
        return None
    alone = OnboardEvidence([o for d in evidence.drives for o in prepare_stretches(
        d.recording, policy.evidence)], evidence.l_r)
    return alone if len(alone.motion_drive) else None


def _noise_scale(evidence: Evidence) -> FloatArray:
    if not isinstance(evidence, OnboardEvidence):
        return np.ones(2)
    return np.asarray(np.median([drive.noise_scale for drive in evidence.drives], axis=0))


def _runs(rows: FloatArray, n: int, rng: np.random.Generator, run: int) -> FloatArray:
    """n rows in runs, for noise has a memory, out of (m, c), each mirrored or not."""
    if not n or not len(rows):
        return np.zeros((n, rows.shape[1]))
    starts = rng.integers(0, max(len(rows) - run, 1), n // run + 1)
    index = np.minimum(starts[:, None] + np.arange(run), len(rows) - 1)
    sign = rng.choice([-1.0, 1.0], len(starts))
    return np.asarray((rows[index] * sign[:, None, None]).reshape(-1, rows.shape[1])[:n])
