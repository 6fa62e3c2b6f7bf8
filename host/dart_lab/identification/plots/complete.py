"""Completion of fits with the fixed parameters that their curves need."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from dart_hal.vehicle import Vehicle
from dart_hal.vehicle.flat import names, unit, value
from dart_lab.identification.fit import FittedParameter, SubmodelFit

REAR_STIFFNESS = "rear_cornering_stiffness"


def complete_fits(fits: Mapping[str, SubmodelFit], base: Vehicle) -> dict[str, SubmodelFit]:
    """Add the fixed values of the tyres to their fit, as not identifiable.

    A joint fit has two of the four parameters of the front tyre, the curve needs all. The
    covariance remains that of the fitted ones.
    """
    if "tyres" not in fits:
        return dict(fits)
    fixed = {full.partition(".")[2]: FittedParameter(float(value(base, full)), math.inf,
                                                     unit(base, full), False)
             for full in names(base) if full.startswith("tyres.")}
    tyres = fits["tyres"]
    return {**fits, "tyres": replace(tyres, parameters={**fixed, **tyres.parameters})}


def has_paper_form(fits: Mapping[str, SubmodelFit]) -> bool:
    """Return whether the tyres have the paper's form: rear stiffness in N/rad."""
    return "tyres" in fits and REAR_STIFFNESS in fits["tyres"].parameters
