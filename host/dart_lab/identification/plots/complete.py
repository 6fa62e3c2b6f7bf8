"""A fit with everything in it that its curve needs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from dart_hal.vehicle import Vehicle
from dart_hal.vehicle.flat import names, unit, value
from dart_lab.identification.fit import Estimate, Fit

REAR = "rear_cornering_stiffness"


def completed(fits: Mapping[str, Fit], base: Vehicle) -> dict[str, Fit]:
    """The fits; that of the tyres with the values that it held at the base's, as not identifiable.

    A joint fit moves two of the four values of the front tyre, the curve needs
    all. The covariance stays that of what was fitted.
    """
    if "tyres" not in fits:
        return dict(fits)
    held = {full.partition(".")[2]: Estimate(float(value(base, full)), math.inf, unit(base, full),
                                             False)
            for full in names(base) if full.startswith("tyres.")}
    tyres = fits["tyres"]
    return {**fits, "tyres": replace(tyres, parameters={**held, **tyres.parameters})}


def papers_form(fits: Mapping[str, Fit]) -> bool:
    """Whether the tyres have the form that pictures show: stiffness of the rear axle in N/rad."""
    return "tyres" in fits and REAR in fits["tyres"].parameters
