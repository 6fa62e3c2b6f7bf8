"""How the IMU sits in the car, or how its gyro is scaled: fitted beside the model.

No car is built truer than a few degrees and a centimetre, so what that explains is no structure.
What only the accelerometer shows of it goes into the extended model, and beside motion capture what
the gyro shows: it is of this car, and in the next drives it is known and no news.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dart_hal.vehicle.effects import catalogue
from dart_hal.vehicle.flat import value

from .evidence.noise import Noise
from .evidence.residuals import Evidence
from .policy import Policy
from .result import Number
from .search.fit import Point, covariance
from .search.forward import ForwardSearch
from .search.selection import label_point_rows

ACCELEROMETER = frozenset({"accel"})


@dataclass(frozen=True, slots=True)
class Mounted:
    """A fitted point with its mounting beside it, the noise there, and the effects of it that the
    point has not."""

    point: Point
    noise: Noise
    names: tuple[str, ...]


def mounted(search: ForwardSearch, evidence: Evidence, point: Point, noise: Noise) -> Mounted:
    """With all of ``Evidence.mounting``."""
    has = {a.name for a in point.vehicle.effects}
    names = tuple(name for name in evidence.mounting if name not in has)
    if not names:
        return Mounted(point, noise, ())
    beside = search.fit_with_nuisance(point, noise, names)
    return Mounted(beside, beside.noise, names)


def of_the_imu(at: Mounted, evidence: Evidence, policy: Policy
                         ) -> Mapping[str, Mapping[str, Number]]:
    """By effect and parameter; what moves the gyro only where the motion is known without it, for
    else all else would have to follow."""
    told = ACCELEROMETER | {"gyro"} if evidence.has_mocap else ACCELEROMETER
    names = [n for n in at.names if set(catalogue()[n].signals) <= told]
    if not names:
        return {}
    point = at.point
    block = label_point_rows(evidence, point, policy).block
    stds = point.space.standard_errors(point.x, covariance(point, block))
    return {n: {q.name: Number(float(value(point.vehicle, f"{n}.{q.name}")),
                               stds[f"{n}.{q.name}"], q.unit, q.null)
                for q in catalogue()[n].parameters} for n in names}
