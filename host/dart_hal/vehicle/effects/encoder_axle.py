"""Which axles turn the encoder.

In the model the encoder measures the speed of the centre of mass along the car. A shaft that
drives both axles turns with the mean of both, and in a turn the front axle moves faster:

    reading = v + k (sqrt(v_x^2 + (v_y + l_f omega)^2) - |v_x|)      k: share of the front axle
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Now, Parameter, Static
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle

ROOT_OFFSET = 1e-12  # (m/s)^2; keeps the derivative of the root finite at rest


def read_both_axles(p: Vehicle, f: Namespace, k: Value) -> Callable[[Value, Now], Value]:
    l_f = p.body.l_f

    def signal(v: Value, now: Now) -> Value:
        # The front axle has the speed of the centre of mass, and l_f omega to the side.
        across = now.v_y + l_f * now.omega
        front = f.sqrt(now.v_x * now.v_x + across * across + ROOT_OFFSET)
        return v + k * (front - f.fabs(now.v_x))

    return signal


EFFECT = Effect(
    name="encoder_axle",
    title="has an encoder that the front axle turns as well",
    physics="With all wheels driven it turns with the mean of both axles.",
    stage="measurement",
    acts_along=("steering_angle", "yaw_rate"),
    parameters=(Parameter("k", "share", -1.0, 1.5, sizes=(0.1, 0.25, 0.5),
                          meaning="share of the front axle in the speed that the encoder reads",
                          physical=(0.0, 1.0)),),
    confused_with=("encoder_scale", "encoder_slip"),
    experiment="Slow circles at full lock and a straight: the front axle acts only in circles.",
    signals={"wheel": Static(read_both_axles)},
)
