"""Fit the servo in addition to the model: its top speed, and the play of the linkage.

Every servo has a top speed and every linkage has play, and a car whose steering was not calibrated
has a model without both. A fit then puts a lag and a wrong steering map in their place, and the
friction of the bends into motor and friction. The reported numbers are therefore those of fits with
both. Like the mounting of the IMU they are parts of this car and no causes.
"""

from __future__ import annotations

from collections.abc import Mapping

from dart_hal.vehicle.effects import apply
from dart_lab.identification.evidence.residuals import Evidence
from dart_lab.identification.objective import Point, refit

from .final_fit import FinalFit
from .result import ParameterEstimate, estimate_effects
from .search.forward import ForwardSearch

# First sizes in a fit, which cannot start at 0, where a change does nothing: time from straight
# ahead to full lock [s], and play at the road wheels [rad], both of an ordinary servo.
FIRST_SIZES = {"steering_rate_limit": 0.1, "steering_backlash": 0.02}
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
    has = {a.name for a in point.vehicle.effects}
    missing = {name: size for name, size in FIRST_SIZES.items() if name not in has}
    if not missing or not (evidence.has_mocap and evidence.commands_stamped):
        return point
    vehicle = point.vehicle
    for name, size in missing.items():
        vehicle = apply(vehicle, name, k=size)
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
    return estimate_effects(final.vehicle, names, final.stds)
