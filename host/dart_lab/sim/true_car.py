"""The true car: a drawn car with another vehicle, and with effects of the catalogue.

Constant changes are applied here: parameters of the body, map and timing of servo and speed
controller, clock of the PWM chip, marks of the encoder ring, tilt of the IMU. Forces remain effects
of the vehicle, whose equations of motion have them. Changes of signals at every tick are in
``injected``.
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
from dart_lab.sim.ring import double_ring, wear_ring

TILT_EFFECTS = ("imu_yaw", "imu_pitch", "imu_roll")
# Effects that change a part of the simulated car; their equations for signals are not used.
HARDWARE_EFFECTS = frozenset({"pwm_clock", "encoder_ring", *TILT_EFFECTS})
# Groups of parameters of a car without slip, which has no tyres.
KINEMATIC_GROUPS = ("body", "friction", "motor", "steering", "delay")


def replace_vehicle(car: HiddenCar, p: Vehicle) -> HiddenCar:
    """Return the car with body, drive, tyres, steering map and timing of another vehicle.

    Electronics and sensors remain those of the seed. Effects of p need ``apply_effects``.
    """
    d = p.delay
    return replace(
        car, vehicle=replace(p, effects=()),
        servo=replace(car.servo, curve=p.steering, delay=d.steering_s, lag=d.steering_lag_s),
        esc=replace(car.esc, delay=d.throttle_s, lag=d.throttle_lag_s))


def apply_effects(car: HiddenCar, effects: tuple[ActiveEffect, ...], model: str) -> HiddenCar:
    """Return the car with its effects.

    model: "dynamic" or "kinematic". Raises UsageError, with the reason, for an effect that a
    simulated car cannot have.
    """
    acting = tuple(a for a in effects if a.values != a.effect.nulls)
    if not acting:
        return car
    base = replace(car.vehicle, delay=Delay(), effects=())
    for a in acting:
        _check_effect(base, a, model)
    named = add_effects(base, acting)
    p = apply_parameter_effects(named)
    by_name = {a.name: a.values for a in named.effects}
    d = p.delay
    clock = by_name.get("pwm_clock", (0.0,))[0]
    car = replace(
        car, vehicle=replace(p, effects=tuple(
            a for a in p.effects if a.name not in HARDWARE_EFFECTS)),
        servo=replace(car.servo, curve=p.steering, delay=car.servo.delay + d.steering_s,
                      lag=car.servo.lag + d.steering_lag_s),
        esc=replace(car.esc, delay=car.esc.delay + d.throttle_s,
                    lag=car.esc.lag + d.throttle_lag_s),
        oscillator_hz=car.oscillator_hz / (1.0 + clock),
        imu=replace(car.imu, tilt=_plate_tilt(by_name)))
    return _wear_ring_a(car, *by_name["encoder_ring"]) if "encoder_ring" in by_name else car


def affects_mocap_only(a: ActiveEffect) -> bool:
    """Return whether an effect changes only the poses of a motion capture."""
    return set(a.effect.signals) == {"pose"}


def _plate_tilt(by_name: Mapping[str, tuple[float, ...]]) -> Vector:
    yaw, pitch, roll = (by_name.get(name, (0.0,))[0] for name in TILT_EFFECTS)
    return yaw, pitch, roll


def _wear_ring_a(car: HiddenCar, missing: float, uneven: float, phase: float) -> HiddenCar:
    """Apply ``encoder_ring``; a ring with an odd number of marks is represented by two turns,
    because the sensor toggles at each mark."""
    ring = wear_ring(car.ring_a, missing, uneven, phase)
    if ring.n % 2 == 0:
        return replace(car, ring_a=ring)
    return replace(car, ring_a=double_ring(ring), ring_b=double_ring(car.ring_b),
                   gear_revolution=2.0 * car.gear_revolution)


def _check_effect(base: Vehicle, a: ActiveEffect, model: str) -> None:
    """Raise UsageError if a simulated car cannot have the effect."""
    signals = a.effect.signals
    if affects_mocap_only(a):
        raise UsageError(f"a simulated car cannot have {a.name}: sim:// has no motion capture",
                         found=a.name, expected="an effect on the car or on its own sensors",
                         remedy="the light simulation has a motion capture: dart_lab.sim.light, "
                                "docs/how_to/learning.md")
    early = [s for s in signals.values() if isinstance(s, PureDelay) and s.seconds(*a.values) < 0.0]
    if early:
        raise UsageError(f"{a.name} of {a.values[0]} s would need the future",
                         found=f"{a.values[0]} s", expected="0 s or more in a running car",
                         remedy=f"give {a.name} the other sign, or omit it")
    if model == "kinematic" and not _acts_without_slip(base, a):
        raise UsageError(f"{a.name} changes nothing in a car without slip",
                         found="physics=kinematic", expected="physics=dynamic",
                         remedy="omit physics=kinematic")


def _acts_without_slip(base: Vehicle, a: ActiveEffect) -> bool:
    if a.effect.force is not None:
        return False
    if a.effect.vehicle is None:
        return True
    after = a.effect.vehicle(base, *a.values)
    # Its yaw rate follows from the road wheels, independent of the yaw inertia.
    after = replace_unchecked(after, {"body": {"yaw_inertia": base.body.yaw_inertia}})
    return any(getattr(base, group) != getattr(after, group) for group in KINEMATIC_GROUPS)
