"""Changes of the residuals by other ways to write a force, see ``vehicle.departures``."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.departures import DEPARTURES, TYPICAL_SPEED, with_departures
from dart_hal.vehicle.effect import ActiveEffect
from dart_hal.vehicle.scale import find_scale
from dart_lab.identification.evidence.residuals import Evidence
from dart_lab.identification.objective import Point

DEPARTURE_STEP = 0.2  # standard deviations of a departure; two-sided difference for its slope

# Shares of a force: by which it may act at the steered wheels (all of it), and by which it may
# differ along a function of the state.
FRONT_WIDTH = 1.0
STATE_WIDTH = 0.5


def force_variants(evidence: Evidence, point: Point, name: str) -> FloatArray:
    """Return the changes (N, d) of the residuals by one standard deviation of each departure.

    (N, 0) for an effect that is no force.
    """
    p = point.vehicle
    timing = point.timing
    active = next(a for a in p.effects if a.name == name)
    if active.effect.force is None:
        return np.zeros((len(point.residual), 0))
    written = with_departures(active.effect, TYPICAL_SPEED * find_scale(p.body).speed)
    widths = [FRONT_WIDTH if d == "front" else STATE_WIDTH for d in DEPARTURES]

    def residual(departures: tuple[float, ...]) -> FloatArray:
        other = ActiveEffect(written, (*active.values, *departures))
        vehicle = replace(p, effects=tuple(other if a is active else a for a in p.effects))
        return point.noise.stack(evidence.residuals(vehicle, timing))[0]

    columns = []
    for i, width in enumerate(widths):
        ends = [residual(tuple(sign * DEPARTURE_STEP * width * (i == j)
                               for j in range(len(widths)))) for sign in (1.0, -1.0)]
        columns.append((ends[0] - ends[1]) / (2.0 * DEPARTURE_STEP))
    return np.stack(columns, axis=1)
