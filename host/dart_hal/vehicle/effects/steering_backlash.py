"""Steering backlash: play between servo and wheels.

    angle = clip(angle before, target - k/2, target + k/2)      target: angle of the linkage
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Now, Parameter, Stateful
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle


def play(p: Vehicle, f: Namespace, dt: Value, k: Value) -> tuple[
        Callable[[Value], tuple[Value]], Callable[[Value, Now, Value], tuple[Value, Value]]]:
    half = 0.5 * k

    def step(v: Value, now: Now, last: Value) -> tuple[Value, Value]:
        # The wheels stay until the linkage reaches either end of the play, and move with it then.
        out = f.fmax(v - half, f.fmin(v + half, last))
        return out, out

    return lambda v: (v,), step


def half_width(k: float) -> float:
    """Return the largest difference of wheels and linkage [rad]."""
    return 0.5 * k


EFFECT = Effect(
    name="steering_backlash",
    title="has play in its steering",
    physics=(
        "Linkage and servo gears leave the wheels free within a small angle."),
    stage="actuator",
    acts_along=("steering_angle", "steering_rate"),
    parameters=(Parameter("k", "rad", 0.0, 0.3, sizes=(0.02, 0.05, 0.10),
                          meaning="play of the road wheels from end to end"),),
    confused_with=("steering_trim", "steering_gain", "pwm_quantisation", "steering_delay",
                   "steering_dead_zone"),
    experiment="Slow circles of one command from both sides: backlash gives two radii, a trim one.",
    signals={"angle": Stateful(play, blind=True, play=half_width)},
)
