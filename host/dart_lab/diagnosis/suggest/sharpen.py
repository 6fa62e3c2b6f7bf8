"""The drive that would measure a claimed parameter better: for each claim, by Fisher information.

    C_0 = diag(std^2) of what the data at hand left,  I_d = A_d^T Omega_d A_d of a simulated drive
    sigma(q) = sqrt(g^T (C_0^-1 + I_d)^-1 g),         g = dq/dx of the quantity that is claimed

A_d: Jacobian of the whitened residuals of the drive with the final model, as a diagnosis of it
would see them (``search.fit``). What two groups leave open between them is in I_d: a drive that
moves both alike narrows neither.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dart_hal.core.config import ModelFile
from dart_hal.core.types import FloatArray
from dart_lab.identification.experiment.floor import Floor

from ..evidence.space import MessageTiming, Space
from ..parameters.groups import quantities_of
from ..policy import USUAL, Policy
from ..result import Claim, Diagnosis
from ..search.fit import evaluate_point
from .evidence import MIDDLE, Setting, setting
from .library import CHOICES, FLOOR, Progress, Rehearsed, rehearsed
from .virtual import record

STEP = 0.05  # prior standard deviations, both sides


@dataclass(frozen=True, slots=True)
class Sharper:
    """What to drive for one claim.

    before, after: standard errors of its quantities, by name, as the data at hand leave them and
    as they would be with the drive; enough: all of them are narrowed to the share asked for.
    drive "": none fits on the floor.
    """

    group: str
    title: str
    drive: str
    description: str
    commands: tuple[str, ...]
    seconds: float
    needs: str
    enough: bool
    units: Mapping[str, str]
    before: Mapping[str, float]
    after: Mapping[str, float]
    by_hand: str

    def sentence(self) -> str:
        """What to do and what it would show, in one line."""
        if not self.drive:
            return f"no drive fits on this floor that would measure the {self.title} better"
        narrowed = "; ".join(f"{name} to +- {_rounded(self.after[name])}{_spaced(unit)} "
                             f"(now {_rounded(self.before[name])})"
                             for name, unit in self.units.items())
        so = "" if self.enough else ", which is the most that any of the drives would"
        return f"drive {self.drive} ({self.seconds:.0f} s): {self.title}, {narrowed}{so}"

    def to_json(self) -> dict[str, Any]:
        """One entry of ``parameter_drives`` in ``--suggest --json``."""
        return {"group": self.group, "title": self.title, "drive": self.drive or None,
                "description": self.description, "commands": list(self.commands),
                "duration_s": self.seconds, "needs": self.needs, "enough": self.enough,
                "quantities": {name: {"unit": unit, "std": self.before[name],
                                      "std_after": self.after[name]}
                               for name, unit in self.units.items()},
                "by_hand": self.by_hand}


def sharpen(diagnosis: Diagnosis, *, floor: Floor = FLOOR, model: ModelFile | None = None,
            progress: Progress | None = None, policy: Policy = USUAL) -> tuple[Sharper, ...]:
    """For each claim the shortest drive that narrows all its quantities enough, else the best.

    Arguments as of ``suggest``. Empty where no parameter is claimed.
    """
    if not diagnosis.claims:
        return ()
    seen = Seen(diagnosis, policy)
    drives: list[tuple[Rehearsed, FloatArray]] = []
    for i, drive in enumerate(rehearsed(floor, model)):
        if progress is not None:
            progress(i / len(CHOICES), drive.choice.name)
        covariance = seen.covariance(drive)
        if covariance is not None:
            drives.append((drive, covariance))
    return tuple(_answer(claim, seen, drives, policy.suggest.narrower)
                 for claim in diagnosis.claims)


class Seen:
    """The final model of a diagnosis, in coordinates of what its refit left open."""

    def __init__(self, diagnosis: Diagnosis, policy: Policy) -> None:
        car, evidence = diagnosis.extended, diagnosis.evidence
        moved = {name: m for name, m in diagnosis.refitted.items() if math.isfinite(m.std)}
        self._car, self._policy = car, policy
        self._space = Space(car, tuple(moved), {n: m.std for n, m in moved.items()}, 0.0,
                            policy.prior)
        self.setting: Setting = setting(evidence, car, car, MessageTiming(),
                                        evidence.drives[0].grid.reference, policy)

    def covariance(self, drive: Rehearsed) -> FloatArray | None:
        """(k, k) with the drive, in the coordinates; None where it shows nothing."""
        normal, told = np.eye(len(self._space)), False
        for part, commands in zip(drive.choice.parts, drive.commands, strict=True):
            run = record(self._car, commands, self.setting.reference, part.experiment, part.yaw)
            evidence = self.setting.of([run])
            if not len(evidence.drives) or not len(evidence.motion_drive):
                continue
            point = evaluate_point(evidence, self.setting.noise, self._space,
                                   self._space.point(MIDDLE))
            weighted = point.jacobian * point.irls_weight[:, None]
            normal, told = normal + weighted.T @ point.jacobian, True
        return np.asarray(np.linalg.inv(normal)) if told else None

    def slopes(self, claim: Claim) -> dict[str, FloatArray]:
        """(k,) of each quantity of a claim, by the coordinates."""
        base = self._space.point(MIDDLE)
        out = {}
        for name, (_, quantity) in quantities_of(claim.group).items():
            slope = np.zeros(len(self._space))
            for i in range(len(self._space.names)):
                step = np.zeros(len(slope))
                step[i] = STEP
                up, down = (self._space.split(base + way * step)[0] for way in (1.0, -1.0))
                slope[i] = (quantity(up) - quantity(down)) / (2.0 * STEP)
            out[name] = slope
        return out


def _answer(claim: Claim, seen: Seen, drives: Iterable[tuple[Rehearsed, FloatArray]],
            narrower: float) -> Sharper:
    slopes, best, least = seen.slopes(claim), None, math.inf
    for drive, covariance in drives:
        ratio = [math.sqrt(float(g @ covariance @ g) / max(float(g @ g), 1e-12))
                 for g in slopes.values()]
        if max(ratio) < least:
            best, least = (drive, dict(zip(slopes, ratio, strict=True))), max(ratio)
        if least <= narrower:
            break
    units = {name: q.unit for name, q in claim.quantities.items()}
    before = {name: q.std for name, q in claim.quantities.items()}
    if best is None:
        return Sharper(claim.group, claim.title, "", "", (), 0.0, seen.setting.needs, False, units,
                       before, before, claim.experiment)
    drive, shares = best
    return Sharper(claim.group, claim.title, drive.choice.name, drive.choice.description,
                   drive.typed, drive.seconds, seen.setting.needs, least <= narrower, units,
                   before, {name: shares[name] * std for name, std in before.items()},
                   claim.experiment)


def _rounded(x: float) -> str:
    return f"{x:.2g}"


def _spaced(unit: str) -> str:
    return "" if unit == "-" else f" {unit}"
