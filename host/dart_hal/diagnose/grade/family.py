"""How else a force of the catalogue may act in a real car: departures from how it is written.

A force that is named was written by somebody: along the body or along the steered wheel, in
proportion to the angle or to its sine, the same at both axles or not. With dF what the effect adds:

    X = dF_xf + dF_xr + dF_x                                       along the car
    F_xf += e1 X,  F_x -= e1 X                                 at the steered wheels instead
    F_x  += e2 X |delta| / 0.2 rad + e3 X (v_x / 1 m/s - 1)    more with angle, with speed
    F_yf += e4 dF_yf,  F_yr += e5 dF_yr,  M_z += e6 dM_z       at one axle more than the other
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dart_hal.types import FloatArray
from dart_hal.vehicle.effect import ActiveEffect, Effect, Forces, Parameter
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle

from ..evidence.residuals import Evidence
from ..search.fit import Point

ANGLE, SPEED = 0.2, 1.0  # rad, m/s: half of full lock, and a usual speed
STEP = 0.2  # of a departure, for its slope
WIDTHS = {"front": 1.0, "angle": 0.5, "speed": 0.5, "front side": 0.5, "rear side": 0.5,
          "moment": 0.5}
"""Standard deviation of each departure, as a share of the force: all of it may be at the front."""


def variants(evidence: Evidence, point: Point, name: str) -> FloatArray:
    """(N, d) changes of the residuals by one standard deviation of each departure of a force.

    (N, 0) for an effect that is no force.
    """
    p, timing = point.vehicle, point.timing
    active = next(a for a in p.effects if a.name == name)
    if active.effect.force is None:
        return np.zeros((len(point.residual), 0))
    written = _with_departures(active.effect)

    def residual(departures: tuple[float, ...]) -> FloatArray:
        other = ActiveEffect(written, (*active.values, *departures))
        vehicle = replace(p, effects=tuple(other if a is active else a for a in p.effects))
        return point.noise.stacked(evidence.residuals(vehicle, timing))[0]

    columns = []
    for i, width in enumerate(WIDTHS.values()):
        ends = [residual(tuple(sign * STEP * width * (i == j) for j in range(len(WIDTHS))))
                for sign in (1.0, -1.0)]
        columns.append((ends[0] - ends[1]) / (2.0 * STEP))
    return np.stack(columns, axis=1)


def _with_departures(effect: Effect) -> Effect:
    """The effect with one more parameter for each departure, 0 where it is as written."""
    more = tuple(Parameter(name.replace(" ", "_"), "-", -1.0, 1.0, sizes=(0.1, 0.2, 0.4))
                 for name in WIDTHS)
    n = len(effect.parameters)

    def force(p: Vehicle, f: Namespace, *values: Value) -> Callable[[Forces], Forces]:
        assert effect.force is not None
        written = effect.force(p, f, *values[:n])
        front, angle, speed, side_f, side_r, moment = values[n:]

        def hook(q: Forces) -> Forces:
            r = written(q)
            along = (r.f_xf - q.f_xf) + (r.f_xr - q.f_xr) + (r.f_x - q.f_x)
            turned = f.fabs(f.atan2(q.sin_d, q.cos_d))
            share = angle * turned / ANGLE + speed * (q.v_x / SPEED - 1.0) - front
            return r._replace(f_xf=r.f_xf + front * along, f_x=r.f_x + share * along,
                              f_yf=r.f_yf + side_f * (r.f_yf - q.f_yf),
                              f_yr=r.f_yr + side_r * (r.f_yr - q.f_yr),
                              m_z=r.m_z + moment * (r.m_z - q.m_z))

        return hook

    return replace(effect, parameters=(*effect.parameters, *more), force=force)
