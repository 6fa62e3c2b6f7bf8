"""The published parameter sets of DART, under the names that ``--model`` takes.

``paper``: the values of the paper's own code (P1), exact. ``paper-printed``:
what its table says (P0). ``upstream-2024``: a later set of the same authors
(P2). They were fitted on different recordings; none of them is the truth of
any car. Source: Lyons, Niesten, Ferranti, "DART: A Compact Platform for
Autonomous Driving Research", IEEE IV 2024, and its MIT-licensed code.
"""

from __future__ import annotations

import math

from dart_hal.errors import UsageError
from dart_hal.vehicle.parameters import (
    AxleTyres,
    Body,
    Delay,
    Friction,
    Motor,
    PaperTyres,
    Steering,
    Vehicle,
)

PER_DEGREE = 180.0 / math.pi
"""The paper's tyre values are per degree of slip angle; files hold them per rad."""

_PAPER_BODY = Body(wheelbase=0.175, l_f=0.46 * 0.175, l_r=0.54 * 0.175, mass=1.67,
                   yaw_inertia=1.67 / 12 * (0.18**2 + 0.12**2))

PAPER = Vehicle(
    name="paper",
    body=_PAPER_BODY,
    friction=Friction(a=1.7194761037826538, b=13.312559127807617, c=0.289848655462265),
    motor=Motor(d=28.887779235839844, e=5.986172199249268, g=-0.15045104920864105),
    steering=Steering(k_left=1.6379064321517944, a_left_rad=0.3301370143890381,
                      s0=0.019644200801849365, a_right_rad=0.37879398465156555,
                      k_right=1.6578725576400757),
    tyres=PaperTyres(front_D=2.9751534461975098, front_C=0.6866822242736816,
                     front_B=0.29280123114585876 * PER_DEGREE, front_E=-3.0720443725585938,
                     rear_cornering_stiffness=0.38921865820884705 * PER_DEGREE),
    delay=Delay(steering_s=0.15),
)

PAPER_PRINTED = Vehicle(
    name="paper-printed",
    body=_PAPER_BODY,
    friction=Friction(a=1.72, b=13.32, c=0.29),
    motor=Motor(d=28.88, e=5.99, g=-0.15),
    steering=Steering(k_left=1.64, a_left_rad=0.33, s0=0.02, a_right_rad=0.38, k_right=1.66),
    tyres=PaperTyres(front_D=2.98, front_C=0.69, front_B=0.29 * PER_DEGREE, front_E=-3.07,
                     rear_cornering_stiffness=0.39 * PER_DEGREE),
    delay=Delay(steering_s=0.15, throttle_s=0.01),
)

_FRONT, _REAR = 0.847, 0.733
"""kg on each axle of the upstream-2024 car, from its scales."""

UPSTREAM_2024 = Vehicle(
    name="upstream-2024",
    body=Body(wheelbase=0.1735, l_f=0.1735 * _REAR / 1.58, l_r=0.1735 * _FRONT / 1.58, mass=1.58,
              yaw_inertia=1.58 / 12 * (0.1735**2 + 0.08**2), front_share=_FRONT / 1.58),
    friction=Friction(a=1.2659882307052612, b=7.666370391845703, c=0.7393041849136353,
                      q=-0.11231517791748047),
    motor=Motor(d=25.35849952697754, e=4.815326690673828, g=-0.16377617418766022),
    steering=Steering(k_left=1.392930030822754, a_left_rad=0.36576229333877563,
                      s0=0.0029959678649902344 - 0.03, a_right_rad=0.5147881507873535,
                      k_right=1.0230425596237183),
    # upstream's slip angles have the opposite sign, and so have its D
    tyres=AxleTyres(front_D=0.8406859636306763, front_C=0.8407371044158936,
                    front_B=8.598039627075195, rear_D=0.8546739816665649,
                    rear_C=0.959108829498291, rear_B=11.54928207397461),
    delay=Delay(steering_lag_s=0.12851488590240479, throttle_lag_s=0.0843319296836853),
    slip="upstream",
)

SETS = {v.name: v for v in (PAPER, PAPER_PRINTED, UPSTREAM_2024)}


def vehicle_set(name: str) -> Vehicle:
    """The shipped set of that name. Raises UsageError, which lists the names."""
    if name not in SETS:
        raise UsageError(f"no parameter set is called {name!r}", expected=", ".join(SETS))
    return SETS[name]
