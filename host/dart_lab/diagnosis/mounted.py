"""Fit how the IMU is mounted in the car, or the scale of its gyro, in addition to the model.

No car is built more exactly than a few degrees and a centimetre, so the effect of the mounting is
no structure. The extended model includes the part of it that only the accelerometer shows, and with
motion capture also the part that the gyro shows. It belongs to this car, and is known afterwards.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dart_hal.vehicle.effects import catalogue
from dart_lab.identification.evidence.noise import Noise
from dart_lab.identification.evidence.residuals import Evidence
from dart_lab.identification.objective import Point, covariance

from .result import ParameterEstimate, estimate_effects
from .search.forward import ForwardSearch
from .search.selection import label_point_rows

ACCEL_SIGNALS = frozenset({"accel"})


@dataclass(frozen=True, slots=True)
class MountingFit:
    """A fit with the mounting, its noise, and the mounting effects that were added."""

    point: Point
    noise: Noise
    names: tuple[str, ...]


def fit_mounting(search: ForwardSearch, evidence: Evidence, point: Point, noise: Noise
                 ) -> MountingFit:
    """Fit all of ``Evidence.mounting`` that the point does not have."""
    has = {a.name for a in point.vehicle.effects}
    names = tuple(name for name in evidence.mounting if name not in has)
    if not names:
        return MountingFit(point, noise, ())
    extended = search.fit_with_nuisance(point, noise, names)
    return MountingFit(extended, extended.noise, names)


def describe_imu_mounting(fit: MountingFit, evidence: Evidence
                          ) -> Mapping[str, Mapping[str, ParameterEstimate]]:
    """Return the mounting by effect and parameter.

    Effects on the gyro only with motion capture: else the gyro is part of the measured motion, and
    every other parameter would depend on them. Standard errors are by blocks of 2 s, also of many
    recordings.
    """
    signals = ACCEL_SIGNALS | {"gyro"} if evidence.has_mocap else ACCEL_SIGNALS
    names = [n for n in fit.names if set(catalogue()[n].signals) <= signals]
    if not names:
        return {}
    point = fit.point
    block = label_point_rows(evidence, point).block
    stds = point.space.standard_errors(point.x, covariance(point, block))
    return estimate_effects(point.vehicle, names, stds)
