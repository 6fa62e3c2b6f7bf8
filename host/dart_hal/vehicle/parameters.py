"""Parameters of the vehicle models: frozen, checked, with units and bounds.

Bounds admit every car from 1:43 to 1:1. A wrong unit (grams for kilograms,
degrees for radians) is refused by what no car can be: its mass against its
length, its inertia against its mass. Bounds of forces are stated for a car of
REFERENCE_MASS and scale with the mass where a fit moves within them.
Slip angles are in rad and positive when the tyre force points to the left;
published tyre values per degree are converted where they are entered.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any

from dart_hal.core.errors import ConfigError, UsageError
from dart_hal.vehicle.effect import ActiveEffect
from dart_hal.vehicle.scale import REFERENCE_MASS

GRAVITY = 9.81  # m/s2, in every figure of this project
# m driven per revolution of the main gear with the encoder marks: 2 pi (11/39) 0.0233 m with the
# final drive and the wheel radius of DART.
GEAR_REVOLUTION = 0.0412918
MASS_RANGE = 1000.0  # largest ratio of a car's mass to REFERENCE_MASS, and its inverse
# kg/m3, mass over the cube of the wheelbase. A 1:43 car has 190, DART 310, a kart 130, a road car
# 76, so the limits have a factor of about 10 to both sides. Grams for kilograms are a factor of
# 1000.
MIN_DENSITY = 10.0
MAX_DENSITY = 3000.0
# Yaw inertia over m l_f l_r: 0.5 for most cars, 1 with all mass at the axles.
MIN_SHAPE = 0.05
MAX_SHAPE = 20.0


def quantity(unit: str, low: float, high: float, meaning: str, **options: Any) -> Any:
    """A dataclass field that carries its unit, the interval it must lie in, and its meaning."""
    return field(metadata={"unit": unit, "low": low, "high": high, "meaning": meaning}, **options)


def force(unit: str, low: float, high: float, meaning: str, **options: Any) -> Any:
    """A field as of ``quantity`` whose interval is that of a car of REFERENCE_MASS."""
    return field(metadata={"unit": unit, "low": low, "high": high, "meaning": meaning,
                           "of_mass": True}, **options)


def scaled_bounds(meta: Any, mass: float) -> tuple[float, float]:
    """Interval of a field by its metadata, for a car of that mass [kg]."""
    if "of_mass" not in meta:
        return float(meta["low"]), float(meta["high"])
    larger = max(mass / REFERENCE_MASS, 1.0)
    smaller = min(mass / REFERENCE_MASS, 1.0)
    low, high = float(meta["low"]), float(meta["high"])
    return low * (smaller if low > 0.0 else larger), high * larger


@dataclass(frozen=True, slots=True)
class BoundedParameters:
    """Base of all parameter groups: every number finite and within its bounds."""

    def __post_init__(self) -> None:
        for f in fields(self):
            if "low" in f.metadata:
                self._check(f.name, getattr(self, f.name), f.metadata)

    def _check(self, name: str, value: float, meta: Any) -> None:
        low, high = meta["low"], meta["high"]
        if "of_mass" in meta:
            low, high = low / MASS_RANGE if low > 0.0 else low * MASS_RANGE, high * MASS_RANGE
        if math.isnan(value) or not low <= value <= high:
            raise ConfigError(
                f"{type(self).__name__}.{name} = {value!r} is out of range",
                found=f"{value!r} {meta['unit']}", expected=f"{low} to {high} {meta['unit']}",
                remedy="check the unit; files hold SI units and radians")


@dataclass(frozen=True, slots=True)
class Body(BoundedParameters):
    """Geometry and inertia. ``front_share`` is the front axle's part of the wheel force."""

    wheelbase: float = quantity("m", 0.03, 5.0, "axle to axle")
    l_f: float = quantity("m", 0.005, 4.0, "centre of mass to the front axle")
    l_r: float = quantity("m", 0.005, 4.0, "centre of mass to the rear axle")
    mass: float = quantity("kg", 0.01, 5000.0, "of the car, ready to drive")
    yaw_inertia: float = quantity("kg m2", 1e-7, 20_000.0,
                                  "about the vertical axis through the centre of mass")
    front_share: float = quantity("-", 0.0, 1.0,
                                  "share of the wheel force at the front "
                                  "axle: 0 rear, 1 front, 0.5 all-wheel drive", default=0.5)

    def __post_init__(self) -> None:
        BoundedParameters.__post_init__(self)
        if abs(self.l_f + self.l_r - self.wheelbase) > 1e-6:
            raise ConfigError("l_f + l_r is not the wheelbase",
                              found=f"{self.l_f} + {self.l_r} != {self.wheelbase} m")
        self._check_ratio("mass", "kg", self.mass / self.wheelbase**3, MIN_DENSITY, MAX_DENSITY,
                          "kg per cubic metre of wheelbase")
        self._check_ratio("yaw_inertia", "kg m2", self.yaw_inertia / (
            self.mass * self.l_f * self.l_r), MIN_SHAPE, MAX_SHAPE, "times m l_f l_r")

    def _check_ratio(self, name: str, unit: str, ratio: float, low: float, high: float,
                     what: str) -> None:
        if not low <= ratio <= high:
            raise ConfigError(
                f"Body.{name} = {getattr(self, name)!r} {unit} is out of range for a car of this "
                "size",
                found=f"{ratio:.3g} {what}", expected=f"{low:g} to {high:g} {what}",
                remedy="check the units of wheelbase, mass and inertia; files hold SI units")

    @property
    def front_load(self) -> float:
        """Static load of the front axle [N]."""
        return self.mass * GRAVITY * self.l_r / self.wheelbase

    @property
    def rear_load(self) -> float:
        """Static load of the rear axle [N]."""
        return self.mass * GRAVITY * self.l_f / self.wheelbase


@dataclass(frozen=True, slots=True)
class Friction(BoundedParameters):
    """F = -(a tanh(b v) + c v + q v |v|)."""

    a: float = force("N", 0.0, 20.0, "dry friction")
    b: float = quantity("s/m", 0.1, 200.0, "steepness of the sign of the speed in dry friction")
    c: float = force("N s/m", -5.0, 20.0, "viscous friction")
    q: float = force("N s2/m2", -5.0, 20.0, "quadratic drag", default=0.0)


@dataclass(frozen=True, slots=True)
class Motor(BoundedParameters):
    """F = (d - e v) T(tau) - reverse (d + e v) T(-tau); T = smooth max(0, tau + g)."""

    d: float = force("N", 0.0, 200.0, "force per throttle at rest")
    e: float = force("N s/m", 0.0, 100.0, "loss of that force per speed, by the back EMF")
    g: float = quantity("-", -0.9, 0.0, "dead band: throttle at which the motor starts, negative")
    reverse: float = quantity("-", 0.0, 1.0, "force in reverse over that forward", default=0.6)


@dataclass(frozen=True, slots=True)
class SpeedLoop(BoundedParameters):
    """F = clip(gain (u - v), -max_force, max_force); u: commanded speed [m/s].

    The bounds keep gain / mass below 120 1/s, which is stable in every integration step.
    """

    gain: float = force("N s/m", 0.1, 200.0, "force per m/s below the commanded speed")
    max_force: float = force("N", 0.1, 200.0, "largest force of the motor, either way")


@dataclass(frozen=True, slots=True)
class Steering(BoundedParameters):
    """Steering map of the paper: amplitudes [rad] and gains, left and right."""

    k_left: float = quantity("-", 0.05, 10.0, "gain of a command to the left")
    a_left_rad: float = quantity("rad", 0.02, 1.4, "limit of the angle to the left")
    s0: float = quantity("-", -0.5, 0.5, "command added before the map: trim")
    a_right_rad: float = quantity("rad", 0.02, 1.4, "limit of the angle to the right")
    k_right: float = quantity("-", 0.05, 10.0, "gain of a command to the right")


@dataclass(frozen=True, slots=True)
class Delay(BoundedParameters):
    """Pure delays and first-order lags of the two command channels [s]."""

    steering_s: float = quantity("s", 0.0, 1.0,
                                 "pure delay from a steering command to the wheels", default=0.0)
    throttle_s: float = quantity("s", 0.0, 1.0,
                                 "pure delay from a throttle command to the force", default=0.0)
    steering_lag_s: float = quantity("s", 0.0, 1.0,
                                     "time constant of the "
                                     "first-order lag of the steering", default=0.0)
    throttle_lag_s: float = quantity("s", 0.0, 1.0,
                                     "time constant of the "
                                     "first-order lag of the throttle", default=0.0)


@dataclass(frozen=True, slots=True)
class PaperTyres(BoundedParameters):
    """Front: four-parameter magic formula [N]; rear: linear, ends at ``rear_max``.

    The paper's rear tyre has no end; its data stop at 6.7 deg of slip. A car
    that may spin needs a finite ``rear_max``.
    """

    front_D: float = force("N", 0.1, 100.0, "peak side force, both front wheels")  # noqa: N815
    front_C: float = quantity("-", 0.05, 3.0,  # noqa: N815
                              "shape factor of the front tyres")
    front_B: float = quantity("1/rad", 0.5, 200.0,  # noqa: N815
                              "stiffness of the front tyres: side force "
                              "at small slip is D C B alpha")
    front_E: float = quantity("-", -20.0, 1.0,  # noqa: N815
                              "curvature of the front tyres near their peak")
    rear_cornering_stiffness: float = force("N/rad", 0.5, 500.0,
                                            "side force per slip angle, both rear wheels")
    rear_max: float = force("N", 0.1, math.inf,
                            "largest side force of the rear axle", default=math.inf)


@dataclass(frozen=True, slots=True)
class AxleTyres(BoundedParameters):
    """Three-parameter magic formula of both axles; D is a coefficient of the axle load."""

    front_D: float = quantity("-", 0.05, 3.0,  # noqa: N815
                              "peak side force over the load of the front axle")
    front_C: float = quantity("-", 0.05, 3.0,  # noqa: N815
                              "shape factor of the front tyres")
    front_B: float = quantity("1/rad", 0.5, 200.0,  # noqa: N815
                              "stiffness of the front tyres: side force "
                              "at small slip is D C B alpha")
    rear_D: float = quantity("-", 0.05, 3.0,  # noqa: N815
                             "peak side force over the load of the rear axle")
    rear_C: float = quantity("-", 0.05, 3.0, "shape factor of the rear tyres")  # noqa: N815
    rear_B: float = quantity("1/rad", 0.5, 200.0,  # noqa: N815
                             "stiffness of the rear tyres: D C B per load")


MODEL_KINDS = ("dynamic", "kinematic")
SLIP_FORMS = ("all_speeds", "paper", "upstream")
# What the throttle of a vehicle is, and the parameters of the motor that it commands: a duty cycle
# -1..1 at the ESC, or a speed [m/s] at a controller such as a VESC.
MOTOR_FORMS: dict[str, type[Motor] | type[SpeedLoop]] = {"duty": Motor, "speed": SpeedLoop}


@dataclass(frozen=True, slots=True)
class Vehicle:
    """One complete parameter set.

    ``kind``: the bicycle that moves it, "dynamic" or "kinematic"; ``slip``: the
    form of its slip angles, see ``tyres.make_slip``; ``effects``: what it has
    beyond the base model, in the order in which it acts; ``motor_voltage`` [V]: of the battery, at
    which the parameters of the motor hold, None if that is not known.
    """

    name: str
    body: Body
    friction: Friction
    motor: Motor | SpeedLoop
    steering: Steering
    tyres: PaperTyres | AxleTyres
    delay: Delay = field(default_factory=Delay)
    kind: str = "dynamic"
    slip: str = "all_speeds"
    effects: tuple[ActiveEffect, ...] = ()
    motor_voltage: float | None = None

    def __post_init__(self) -> None:
        for name, value, known in (("kind", self.kind, MODEL_KINDS),
                                   ("slip", self.slip, SLIP_FORMS)):
            if value not in known:
                raise ConfigError(f"Vehicle.{name} = {value!r} is not known",
                                  found=repr(value), expected=" or ".join(known),
                                  remedy="check the spelling in model.toml")
        for applied in self.effects:
            if applied.effect.duty_only and self.drive != "duty":
                raise ConfigError(
                    f"the effect {applied.name} has no meaning for a motor with a speed loop",
                    found=f"{self.name}: forms.motor = \"speed\" with {applied.name}",
                    expected="an effect that also acts on a speed loop",
                    remedy=f"remove {applied.name} from [[effects]]")

    @property
    def drive(self) -> str:
        """Meaning of the throttle: "duty" (-1..1 at the ESC) or "speed" (commanded, m/s)."""
        return "speed" if isinstance(self.motor, SpeedLoop) else "duty"

    @property
    def duty_motor(self) -> Motor:
        """The motor of a duty command. Raises UsageError for a speed loop."""
        return require_duty(self.motor, self.name)


def require_duty(motor: Motor | SpeedLoop, name: str = "") -> Motor:
    """Return the motor if a duty commands it; name: of the model, for the message.

    Raises UsageError for a speed loop.
    """
    if isinstance(motor, SpeedLoop):
        raise UsageError(
            "a speed loop cannot be used here, only a motor of duty",
            found=f"model {name} with forms.motor = \"speed\"".replace("  ", " "),
            expected="a model whose motor has d, e and g",
            remedy="use a model of a duty motor; rollouts, identify all --joint, evaluate and "
                   "diagnose take speed loops")
    return motor
