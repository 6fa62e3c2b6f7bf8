"""PWM clock: all pulses are longer or shorter by the same factor.

    pulse = (1 + k) (1500 us + span u)

The effective command is that of the unchanged pulse formula: u + k (u + 1500 us / span).
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Now, Parameter, Static
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle

NEUTRAL_US = 1500.0
SPAN_US = (375.0, 450.0)  # change of the pulse for a command of 1: steering, throttle


def stretch_pulse(k: Value, span: float) -> Callable[[Value, Now], Value]:
    def signal(v: Value, now: Now) -> Value:
        # (1 + k) (neutral + span u) = neutral + span u', solved for the effective command u'.
        return v + k * (v + NEUTRAL_US / span)

    return signal


def steering(p: Vehicle, f: Namespace, k: Value) -> Callable[[Value, Now], Value]:
    return stretch_pulse(k, SPAN_US[0])


def throttle(p: Vehicle, f: Namespace, k: Value) -> Callable[[Value, Now], Value]:
    return stretch_pulse(k, SPAN_US[1])


EFFECT = Effect(
    name="pwm_clock",
    title="receives pulses that are too long or too short",
    signed_titles=(
        "receives pulses that are too short",
        "receives pulses that are too long"),
    physics="The oscillator of the PCA9685 is within 25 MHz +- 4 %.",
    stage="command",
    duty_only=True,
    acts_along=("throttle", "steering_angle"),
    parameters=(Parameter("k", "relative", -0.05, 0.05, sizes=(0.002, 0.005, 0.01),
                          meaning="excess length of the pulses"),),
    confused_with=("steering_trim", "motor_deadband", "motor_gain"),
    experiment=(
        "Straight drives at two throttle levels: trim and dead band move in the ratio 375 to 450. "
        "Or count on the PWM pin (hardware/README.md, PWM clock)."),
    signals={"steering": Static(steering), "throttle": Static(throttle)},
)
