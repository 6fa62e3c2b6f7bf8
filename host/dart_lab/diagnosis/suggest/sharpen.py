"""Suggest the drive that measures a claimed parameter better, by Fisher information.

    C_0 = diag(std^2) of the data at hand,            I_d = A_d^T Omega_d A_d / r of a drive
    sigma(q) = sqrt(g^T (C_0^-1 + I_d)^-1 g),         g = dq/dx of the quantity that is claimed

A_d: Jacobian of the whitened residuals of the drive with the final model, as in a diagnosis of it
(``objective``). r: median ratio of the variances of the data at hand to those of independent
residuals; the residuals of a further drive will be as dependent. Correlations between two groups
are part of I_d: a drive with equal changes by both improves neither.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dart_hal.core.config import ModelFile
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.flat import value
from dart_hal.vehicle.scale import find_scale
from dart_lab.identification.evidence.residuals import Evidence
from dart_lab.identification.evidence.space import MessageTiming, Space
from dart_lab.identification.experiment.floor import Floor
from dart_lab.identification.objective import evaluate_point

from ..alternatives import SIZE_ERRORS
from ..parameters.groups import list_quantities
from ..policy import USUAL, Policy
from ..result import Claim, Diagnosis
from .evidence import LOG_TIMING, Setting, make_setting
from .library import CHOICES, Progress, RehearsedDrive, default_floor, rehearse_choices
from .virtual import record

DIFFERENCE_STEP = 0.05  # prior standard deviations, central differences


@dataclass(frozen=True, slots=True)
class ParameterDrive:
    """The next drive for one claim.

    before, after: standard errors of its quantities, by name, with the data at hand and with the
    drive. enough: all of them are reduced by the required share. drive: "" if none fits on the
    floor.
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
        """Describe the drive and its benefit in one line."""
        if not self.drive:
            return f"no drive that measures the {self.title} better fits on this floor"
        narrowed = "; ".join(f"{name} to +- {_format_number(self.after[name])}{_format_unit(unit)} "
                             f"(now {_format_number(self.before[name])})"
                             for name, unit in self.units.items())
        remark = "" if self.enough else ", the best of all drives"
        return f"drive {self.drive} ({self.seconds:.0f} s): {self.title}, {narrowed}{remark}"

    def to_json(self) -> dict[str, Any]:
        """One entry of ``parameter_drives`` in ``--suggest --json``."""
        return {"group": self.group, "title": self.title, "drive": self.drive or None,
                "description": self.description, "commands": list(self.commands),
                "duration_s": self.seconds, "needs": self.needs, "enough": self.enough,
                "quantities": {name: {"unit": unit, "std": self.before[name],
                                      "std_after": self.after[name]}
                               for name, unit in self.units.items()},
                "by_hand": self.by_hand}


def suggest_parameter_drives(diagnosis: Diagnosis, *, floor: Floor | None = None,
                             model: ModelFile | None = None, progress: Progress | None = None,
                             policy: Policy = USUAL) -> tuple[ParameterDrive, ...]:
    """Suggest for each claim the shortest drive that reduces its errors enough, else the best.

    Arguments as of ``suggest``. Returns nothing if no parameter is claimed.
    """
    if not diagnosis.claims:
        return ()
    floor = floor or default_floor(diagnosis.extended.body)
    scaled = policy.at_scale(find_scale(diagnosis.extended.body))
    information = ParameterInformation(diagnosis, scaled)
    drives: list[tuple[RehearsedDrive, FloatArray]] = []
    for i, drive in enumerate(rehearse_choices(floor, model)):
        if progress is not None:
            progress(i / len(CHOICES), drive.choice.name)
        covariance = information.covariance(drive)
        if covariance is not None:
            drives.append((drive, covariance))
    return tuple(_select_drive(claim, information, drives, policy.suggest.max_error_ratio)
                 for claim in diagnosis.claims)


class ParameterInformation:
    """Fisher information about the parameters of the final model, in prior coordinates."""

    def __init__(self, diagnosis: Diagnosis, policy: Policy) -> None:
        car = diagnosis.extended
        evidence = diagnosis.evidence
        stds = {name: m.std for name, m in diagnosis.refitted.items() if math.isfinite(m.std)}
        # No drive separates mass from force: sizes that are not measured keep their errors.
        stds |= {size: error * value(car, size) for effect, (size, error) in SIZE_ERRORS.items()
                 if size not in stds and effect not in {a.name for a in car.effects}}
        self._car = car
        self._policy = policy
        self._space = Space(car, tuple(stds), stds, 0.0, policy.prior)
        self.setting: Setting = make_setting(evidence, car, car, MessageTiming(),
                                        evidence.drives[0].grid.reference, policy)
        # The variances of the data at hand are 1, by the choice of coordinates.
        independent = np.diag(np.linalg.pinv(self._information(evidence, MessageTiming())))
        self._ratio = max(1.0, float(np.median(1.0 / independent[independent > 0.0])))

    def covariance(self, drive: RehearsedDrive) -> FloatArray | None:
        """Covariance (k, k) of the coordinates with the drive; None if the drive has no data."""
        # Fisher information adds: what is known now (the identity, by the choice of coordinates)
        # plus J'WJ of the simulated drive.
        normal = np.eye(len(self._space))  # C_0^-1: the coordinates are in prior standard errors
        has_motion = False
        for part, commands in zip(drive.choice.parts, drive.commands, strict=True):
            run = record(self._car, commands, self.setting.reference, part.experiment, part.yaw)
            evidence = self.setting.make_evidence([run])
            if not len(evidence.drives) or not len(evidence.motion_drive):
                continue
            normal = normal + self._information(evidence, LOG_TIMING) / self._ratio
            has_motion = True
        return np.asarray(np.linalg.inv(normal)) if has_motion else None

    def _information(self, evidence: Evidence, timing: MessageTiming) -> FloatArray:
        """Fisher information (k, k) of recordings whose residuals are independent."""
        point = evaluate_point(evidence, self.setting.noise, self._space, self._space.point(timing))
        weighted = point.jacobian * point.irls_weight[:, None]
        return np.asarray(weighted.T @ point.jacobian)

    def gradients(self, claim: Claim) -> dict[str, FloatArray]:
        """Gradient (k,) of each quantity of a claim with respect to the coordinates."""
        base = self._space.point(LOG_TIMING)
        out = {}
        for name, (_, quantity) in list_quantities(claim.group, self._car).items():
            gradient = np.zeros(len(self._space))
            for i in range(len(self._space.names)):
                step = np.zeros(len(gradient))
                step[i] = DIFFERENCE_STEP
                up, down = (self._space.split(base + sign * step)[0] for sign in (1.0, -1.0))
                gradient[i] = (quantity(up) - quantity(down)) / (2.0 * DIFFERENCE_STEP)
            out[name] = gradient
        return out


def _select_drive(claim: Claim, information: ParameterInformation,
                  drives: Iterable[tuple[RehearsedDrive, FloatArray]],
                  narrower: float) -> ParameterDrive:
    """Select the first drive that reduces all errors enough, or the best."""
    gradients = information.gradients(claim)
    best = None
    smallest = math.inf
    for drive, covariance in drives:
        # Delta method: the variance of a quantity with gradient g is g^T C g, and g^T g now.
        ratio = [math.sqrt(float(g @ covariance @ g) / max(float(g @ g), 1e-12))
                 for g in gradients.values()]
        if max(ratio) < smallest:
            best = (drive, dict(zip(gradients, ratio, strict=True)))
            smallest = max(ratio)
        if smallest <= narrower:
            break
    units = {name: q.unit for name, q in claim.quantities.items()}
    before = {name: q.std for name, q in claim.quantities.items()}
    if best is None:
        return ParameterDrive(claim.group, claim.title, "", "", (), 0.0, information.setting.needs,
                              False, units, before, before, claim.experiment)
    drive, shares = best
    return ParameterDrive(claim.group, claim.title, drive.choice.name, drive.choice.description,
                          drive.shell_commands, drive.seconds, information.setting.needs,
                          smallest <= narrower, units, before, {name: shares[name] * std for name,
                                                                std in before.items()},
                          claim.experiment)


def _format_number(x: float) -> str:
    return f"{x:.2g}"


def _format_unit(unit: str) -> str:
    return "" if unit == "-" else f" {unit}"
