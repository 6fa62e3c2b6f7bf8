"""Ring of the encoder: marks that are missing, counted twice or unevenly spaced.

The reading is the number of marks in the last 0.1 s. At u turns of the gear the density of marks,
1 for a perfect ring, is

    rho(u) = 1 + uneven cos(2 pi u) - [1 if u mod 1 < missing]

and the reading is the integral of rho from the begin to the end of the window, per time.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Now, Parameter, Static
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle

ENCODER_WINDOW_S = 0.1
METRES_PER_TURN = 2.0 * math.pi * 11.0 / 39.0 * 0.0233
SPEED_OF_A_TURN = METRES_PER_TURN / ENCODER_WINDOW_S  # m/s; one turn of the gear per window


def read_ring(p: Vehicle, f: Namespace, missing: Value, uneven: Value,
         phase: Value) -> Callable[[Value, Now], Value]:
    def deviation(u: Value) -> Value:
        # integral of rho - 1 from 0 to u
        whole = f.floor(u)
        gap = whole * missing + f.fmax(whole - u, f.fmin(u - whole, missing))
        return uneven * f.sin(2.0 * math.pi * u) / (2.0 * math.pi) - gap

    def signal(v: Value, now: Now) -> Value:
        end = now.turns + phase
        begin = end - v / SPEED_OF_A_TURN  # larger than end in reverse
        # v (1 + change of the integral / turns in the window), written without the quotient 0 / 0
        return v + (deviation(end) - deviation(begin)) * SPEED_OF_A_TURN

    return signal


EFFECT = Effect(
    name="encoder_ring",
    title="has an encoder ring with bad marks",
    physics="A missing mark leaves a gap, a bouncing one counts twice.",
    stage="measurement",
    acts_along=("revolution_angle",),
    parameters=(
        Parameter("missing", "turn", -0.3, 0.5, sizes=(0.05, 0.1, 0.2),
                  meaning="part of a turn without marks"),
        Parameter("uneven", "relative", -0.5, 0.5, sizes=(0.05, 0.1, 0.2),
                  meaning="unevenness of the marks over a turn"),
        Parameter("phase", "turn", -0.5, 0.5, sizes=(0.125, 0.25, 0.5),
                  meaning="place of the closest marks in the turn", per_recording=True,
                  alone=False)),
    confused_with=("encoder_scale",),
    experiment="Roll steadily below 0.4 m/s: the ripple shows each mark.",
    signals={"wheel": Static(read_ring)},
)
