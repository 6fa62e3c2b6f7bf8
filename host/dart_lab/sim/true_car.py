"""The true car: a drawn car with another vehicle, and with effects of the catalogue.

What an effect changes once and for all is changed here: parameters of the
body, the map and the timing of servo and speed controller, the clock of the
PWM chip, the marks of the encoder ring, the place of the IMU on its plate.
Forces stay with the vehicle, whose equations of motion carry them, and what
happens to signals from tick to tick is the business of ``injected``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from dart_hal.core.errors import UsageError
from dart_hal.vehicle import Delay, Vehicle
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.effect import ActiveEffect, PureDelay
from dart_hal.vehicle.effects import add_effects
from dart_hal.vehicle.flat import replace_unchecked
from dart_lab.sim.hidden import HiddenCar
from dart_lab.sim.imu import Vector
from dart_lab.sim.ring import twice_round, worn_ring

TILTS = ("imu_yaw", "imu_pitch", "imu_roll")
AT_THE_PINS = frozenset({"pwm_clock", "encoder_ring", *TILTS})
"""Effects with a part of the car of their own: their equations for signals are not used."""
MOVES = ("body", "friction", "motor", "steering", "delay")
"""Groups of parameters that a car without slip knows; it has no tyres."""


def with_vehicle(car: HiddenCar, p: Vehicle) -> HiddenCar:
    """The car with body, drive, tyres, steering map and timing of another vehicle.

    Electronics and sensors stay those of the seed. Effects of p are left to
    ``with_effects``.
    """
    d = p.delay
    return replace(
        car, vehicle=replace(p, effects=()),
        servo=replace(car.servo, curve=p.steering, delay=d.steering_s, lag=d.steering_lag_s),
        esc=replace(car.esc, delay=d.throttle_s, lag=d.throttle_lag_s))


def with_effects(car: HiddenCar, effects: tuple[ActiveEffect, ...], model: str) -> HiddenCar:
    """The car as it really is; without an effect the car itself.

    model: "dynamic" or "kinematic". Raises UsageError for an effect that a
    simulated car cannot have, with the reason.
    """
    acting = tuple(a for a in effects if a.values != a.effect.nulls)
    if not acting:
        return car
    base = replace(car.vehicle, delay=Delay(), effects=())
    for a in acting:
        _refuse(base, a, model)
    named = add_effects(base, acting)
    p = apply_parameter_effects(named)
    by_name = {a.name: a.values for a in named.effects}
    d, clock = p.delay, by_name.get("pwm_clock", (0.0,))[0]
    car = replace(
        car, vehicle=replace(p, effects=tuple(a for a in p.effects if a.name not in AT_THE_PINS)),
        servo=replace(car.servo, curve=p.steering, delay=car.servo.delay + d.steering_s,
                      lag=car.servo.lag + d.steering_lag_s),
        esc=replace(car.esc, delay=car.esc.delay + d.throttle_s,
                    lag=car.esc.lag + d.throttle_lag_s),
        oscillator_hz=car.oscillator_hz / (1.0 + clock),
        imu=replace(car.imu, tilt=_tilt(by_name)))
    return _with_worn_ring(car, *by_name["encoder_ring"]) if "encoder_ring" in by_name else car


def only_mocap(a: ActiveEffect) -> bool:
    """Whether an effect changes what a motion capture sees, and nothing else."""
    return set(a.effect.signals) == {"pose"}


def _tilt(by_name: Mapping[str, tuple[float, ...]]) -> Vector:
    yaw, pitch, roll = (by_name.get(name, (0.0,))[0] for name in TILTS)
    return yaw, pitch, roll


def _with_worn_ring(car: HiddenCar, missing: float, uneven: float, phase: float) -> HiddenCar:
    """A sensor toggles at each mark, so a turn with an odd number of them is told as two."""
    ring = worn_ring(car.ring_a, missing, uneven, phase)
    if ring.n % 2 == 0:
        return replace(car, ring_a=ring)
    return replace(car, ring_a=twice_round(ring), ring_b=twice_round(car.ring_b),
                   gear_revolution=2.0 * car.gear_revolution)


def _refuse(base: Vehicle, a: ActiveEffect, model: str) -> None:
    """Raises UsageError when a simulated car cannot have the effect."""
    signals = a.effect.signals
    if only_mocap(a):
        raise UsageError(f"a simulated car cannot have {a.name}: sim:// has no motion capture",
                         found=a.name, expected="an effect on the car or on its own sensors",
                         remedy="the light simulation has a motion capture: dart_lab.sim.light, "
                                "docs/how_to/learning.md")
    early = [s for s in signals.values() if isinstance(s, PureDelay) and s.seconds(*a.values) < 0.0]
    if early:
        raise UsageError(f"{a.name} of {a.values[0]} s would need the future",
                         found=f"{a.values[0]} s", expected="0 s or more in a running car",
                         remedy=f"give {a.name} the other sign, or leave it out")
    if model == "kinematic" and not _acts_without_slip(base, a):
        raise UsageError(f"{a.name} changes nothing in a car without slip",
                         found="physics=kinematic", expected="physics=dynamic",
                         remedy="leave physics=kinematic out")


def _acts_without_slip(base: Vehicle, a: ActiveEffect) -> bool:
    if a.effect.force is not None:
        return False
    if a.effect.vehicle is None:
        return True
    after = a.effect.vehicle(base, *a.values)
    # it turns as its wheels say, whatever its inertia of yaw
    after = replace_unchecked(after, {"body": {"yaw_inertia": base.body.yaw_inertia}})
    return any(getattr(base, group) != getattr(after, group) for group in MOVES)
