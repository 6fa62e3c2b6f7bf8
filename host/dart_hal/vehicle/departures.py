"""How else a force of the catalogue may act in a real car: departures from how it is written.

A force was written by somebody: along the body or along the steered wheel, in proportion to the
angle or to its sine, the same at both axles or not. With dF what the effect adds:

    X = dF_xf + dF_xr + dF_x                                       along the car
    F_xf += e1 X,  F_x -= e1 X                                 at the steered wheels instead
    F_x  += e2 X |delta| / 0.2 rad + e3 X (v_x / 1 m/s - 1)    more with angle, with speed
    F_yf += e4 dF_yf,  F_yr += e5 dF_yr,  M_z += e6 dM_z       at one axle more than the other
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from dart_hal.vehicle.effect import Effect, Forces, Parameter, Signal, Static
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle

ANGLE_SCALE = 0.2  # rad, half of full lock
TYPICAL_SPEED = 1.0  # m/s, of the car of the paper
# e1 to e6.
DEPARTURES = ("front", "angle", "speed", "front_side", "rear_side", "moment")


def with_departures(effect: Effect, typical_speed: float = TYPICAL_SPEED) -> Effect:
    """A force with one more parameter for each departure, 0 where it is as written.

    typical_speed [m/s]: in place of 1 m/s. What it does to a signal besides, as a slope to the
    accelerometer, stays as written.
    """
    more = tuple(Parameter(name, "-", -1.0, 1.0, sizes=(0.1, 0.2, 0.4)) for name in DEPARTURES)
    n = len(effect.parameters)

    def force(p: Vehicle, f: Namespace, *values: Value) -> Callable[[Forces], Forces]:
        assert effect.force is not None
        written = effect.force(p, f, *values[:n])
        front, angle, speed, side_f, side_r, moment = values[n:]

        def hook(q: Forces) -> Forces:
            r = written(q)
            # X, what the effect adds along the car, and the share of it that F_x gets: e2 |delta| /
            # 0.2 rad + e3 (v_x / 1 m/s - 1) - e1.
            along = (r.f_xf - q.f_xf) + (r.f_xr - q.f_xr) + (r.f_x - q.f_x)
            turned = f.fabs(f.atan2(q.sin_d, q.cos_d))
            share = angle * turned / ANGLE_SCALE + speed * (q.v_x / typical_speed - 1.0) - front
            return r._replace(f_xf=r.f_xf + front * along, f_x=r.f_x + share * along,
                              f_yf=r.f_yf + side_f * (r.f_yf - q.f_yf),
                              f_yr=r.f_yr + side_r * (r.f_yr - q.f_yr),
                              m_z=r.m_z + moment * (r.m_z - q.m_z))

        return hook

    signals = {channel: _drop_extra_values(hook, n) for channel, hook in effect.signals.items()}
    return replace(effect, parameters=(*effect.parameters, *more), force=force, signals=signals)


def _drop_extra_values(hook: Signal, n: int) -> Static:
    """The hook, given more values than the ``n`` that it knows."""
    assert isinstance(hook, Static), "no force of the catalogue has a signal with memory"
    return Static(lambda p, f, *values: hook.make(p, f, *values[:n]))
