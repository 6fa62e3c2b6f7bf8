"""Fit the servo in addition to the model: its top speed, and the play of the linkage.

The reported numbers are those of fits with both: ``identification.servo`` says why. Like the
mounting of the IMU they are parts of this car and no causes.
"""

from __future__ import annotations

from collections.abc import Mapping

from dart_hal.vehicle.effects import catalogue
from dart_hal.vehicle.flat import value
from dart_lab.identification.servo import FIRST_SIZES, add_servo_parts

from .evidence.residuals import Evidence
from .final_fit import FinalFit
from .result import ParameterEstimate
from .search.fit import Point, refit
from .search.forward import ForwardSearch

# The noise is measured again before each fit but the first.
PASSES = 2
# Of the models with these parts: docs/results/calibration_coverage.md.
TYRE_CAUTION = ("do not rely on the standard errors of the tyres: of 24 tyre parameters of hidden "
                "cars their 90 % intervals held 18")


def fit_servo(search: ForwardSearch, evidence: Evidence, point: Point, jobs: int = 1) -> Point:
    """Fit the parts of the servo that a point lacks together with all its parameters.

    Returns the point itself for other recordings than runs with motion capture: others do not have
    the times of the commands, or not the angle of the wheels.
    """
    vehicle = add_servo_parts(point.vehicle)
    if vehicle is point.vehicle or not (evidence.has_mocap and evidence.commands_stamped):
        return point
    space = search.make_space(vehicle)
    x = space.transfer(space.start(vehicle, point.timing), point.space, point.x)
    fit = refit(evidence, point.noise, space, x, jobs=jobs)
    for _ in range(PASSES - 1):
        noise = search.measure_noise(evidence, fit.vehicle, fit.timing)
        fit = refit(evidence, noise, space, fit.x, jobs=jobs)
    return fit


def describe_servo(final: FinalFit, searched: Point) -> Mapping[str, Mapping[str,
                                                                        ParameterEstimate]]:
    """Return the parts of the servo that only the final fit has, by effect and parameter."""
    had = {a.name for a in searched.vehicle.effects}
    names = [a.name for a in final.vehicle.effects if a.name in FIRST_SIZES and a.name not in had]
    return {n: {q.name: ParameterEstimate(float(value(final.vehicle, f"{n}.{q.name}")),
                                          final.stds[f"{n}.{q.name}"], q.unit, q.null)
                for q in catalogue()[n].parameters} for n in names}
