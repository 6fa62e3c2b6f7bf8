"""Which axles turn the encoder.

The model reads the speed of the centre of mass along the car. A drive shaft
between two axles turns with both, and in a turn the front one goes further:

    reading = v + k (hypot(v_x, v_y + l_f omega) - v_x), k: share of the front axle
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Now, Parameter, Static
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle

STANDING = 1e-12  # (m/s)^2; keeps the root smooth where nothing moves


def both(p: Vehicle, f: Namespace, k: Value) -> Callable[[Value, Now], Value]:
    l_f = p.body.l_f

    def signal(v: Value, now: Now) -> Value:
        across = now.v_y + l_f * now.omega
        front = f.sqrt(now.v_x * now.v_x + across * across + STANDING)
        return v + k * (front - f.fabs(now.v_x))

    return signal


EFFECT = Effect(
    name="encoder_axle",
    title="has an encoder that the front axle turns as well",
    physics=(
        "With four driven wheels the shaft under the encoder turns with the mean of both "
        "axles. The steered wheels run on a larger circle, so the tighter the turn, the more it "
        "reads."),
    stage="measurement",
    acts_along=("steering_angle", "yaw_rate"),
    parameters=(Parameter("k", "share", -1.0, 1.5, sizes=(0.1, 0.25, 0.5),
                          meaning="share of the front axle in the speed that the encoder reads",
                          physical=(0.0, 1.0)),),
    confused_with=("encoder_scale", "encoder_slip"),
    experiment=(
        "Slow circles at full lock to both sides beside a straight of the same speed: a scale "
        "is the same everywhere, the front axle reads more in circles alone."),
    signals={"wheel": Static(both)},
)
