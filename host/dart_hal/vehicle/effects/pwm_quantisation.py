"""Quantisation: pulses are whole counts of the PWM chip, truncated or rounded.

    u = k floor(command / k + phase)

k: one count in units of the steering command; 375/450 of it for the throttle, whose span in
microseconds is wider. phase: 0 for truncated counts, 0.5 for rounded ones.
"""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.vehicle.effect import Effect, Now, Parameter, Static
from dart_hal.vehicle.namespace import Namespace, Value
from dart_hal.vehicle.parameters import Vehicle

SPAN_US = (375.0, 450.0)  # change of the pulse for a command of 1: steering, throttle
MIN_STEP = 1e-9  # avoids a division by zero at k = 0


def quantise(p: Vehicle, f: Namespace, k: Value,
          phase: Value) -> Callable[[Value, Now], Value]:
    def signal(v: Value, now: Now) -> Value:
        counts = v / f.fmax(k, MIN_STEP) + phase
        return v - k * (counts - f.floor(counts) - phase)  # exactly v for k = 0

    return signal


def throttle(p: Vehicle, f: Namespace, k: Value,
             phase: Value) -> Callable[[Value, Now], Value]:
    return quantise(p, f, k * SPAN_US[0] / SPAN_US[1], phase)


EFFECT = Effect(
    name="pwm_quantisation",
    title="moves steering and motor in steps",
    physics="A PCA9685 at 50 Hz has steps of 4.88 us, 0.013 of the steering command.",
    stage="command",
    duty_only=True,
    acts_along=("steering_angle",),
    parameters=(
        Parameter("k", "-", 0.0, 0.2, sizes=(0.013, 0.026, 0.052),
                  meaning="step of the steering command"),
        Parameter("phase", "step", 0.0, 1.0, sizes=(0.25, 0.5, 0.75),
                  meaning="0 if counts are truncated, 0.5 if they are rounded", alone=False)),
    confused_with=("steering_backlash", "steering_trim", "motor_deadband"),
    experiment="Ramp the steering slowly up and down. Backlash makes a loop, steps do not.",
    signals={"steering": Static(quantise), "throttle": Static(throttle)},
)
