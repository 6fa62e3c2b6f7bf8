"""Parameters of the vehicle models: frozen, checked, with units and bounds.

Bounds are those of a 1:10 car: wide enough for every car of this class, tight
enough that a wrong unit (degrees for radians, grams for kilograms) is refused.
Slip angles are in rad and positive when the tyre force points to the left;
published tyre values per degree are converted where they are entered.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any

from dart_hal.errors import ConfigError
from dart_hal.vehicle.effect import ActiveEffect

GRAVITY = 9.81
"""m/s2, in every figure of this project."""
GEAR_REVOLUTION = 0.0412918
"""m of way per revolution of the main gear that carries the marks, 2 pi (11/39) 0.0233 m: final
drive and wheel radius of DART."""


def quantity(unit: str, low: float, high: float, **options: Any) -> Any:
    """A dataclass field that carries its unit and the interval it must lie in."""
    return field(metadata={"unit": unit, "low": low, "high": high}, **options)


@dataclass(frozen=True, slots=True)
class Checked:
    """Base of all parameter groups: every number finite and within its bounds."""

    def __post_init__(self) -> None:
        for f in fields(self):
            if "low" in f.metadata:
                self._check(f.name, getattr(self, f.name), f.metadata)

    def _check(self, name: str, value: float, meta: Any) -> None:
        low, high = meta["low"], meta["high"]
        if math.isnan(value) or not low <= value <= high:
            raise ConfigError(
                f"{type(self).__name__}.{name} = {value!r} is out of range",
                found=f"{value!r} {meta['unit']}", expected=f"{low} to {high} {meta['unit']}",
                remedy="check the unit; files hold SI units and radians")


@dataclass(frozen=True, slots=True)
class Body(Checked):
    """Geometry and inertia. ``front_share`` is the front axle's part of the wheel force."""

    wheelbase: float = quantity("m", 0.05, 1.0)
    l_f: float = quantity("m", 0.02, 0.8)
    l_r: float = quantity("m", 0.02, 0.8)
    mass: float = quantity("kg", 0.2, 20.0)
    yaw_inertia: float = quantity("kg m2", 1e-4, 1.0)
    front_share: float = quantity("-", 0.0, 1.0, default=0.5)

    def __post_init__(self) -> None:
        Checked.__post_init__(self)
        if abs(self.l_f + self.l_r - self.wheelbase) > 1e-6:
            raise ConfigError("l_f + l_r is not the wheelbase",
                              found=f"{self.l_f} + {self.l_r} != {self.wheelbase} m")

    @property
    def front_load(self) -> float:
        """Static load of the front axle [N]."""
        return self.mass * GRAVITY * self.l_r / self.wheelbase

    @property
    def rear_load(self) -> float:
        """Static load of the rear axle [N]."""
        return self.mass * GRAVITY * self.l_f / self.wheelbase


@dataclass(frozen=True, slots=True)
class Friction(Checked):
    """F = -(a tanh(b v) + c v + q v |v|)."""

    a: float = quantity("N", 0.0, 20.0)
    b: float = quantity("s/m", 0.1, 200.0)
    c: float = quantity("N s/m", -5.0, 20.0)
    q: float = quantity("N s2/m2", -5.0, 20.0, default=0.0)


@dataclass(frozen=True, slots=True)
class Motor(Checked):
    """F = (d - e v) T(tau) - reverse (d + e v) T(-tau); T = smooth max(0, tau + g)."""

    d: float = quantity("N", 0.0, 200.0)
    e: float = quantity("N s/m", 0.0, 100.0)
    g: float = quantity("-", -0.9, 0.0)
    reverse: float = quantity("-", 0.0, 1.0, default=0.6)


@dataclass(frozen=True, slots=True)
class Steering(Checked):
    """Steering map of the paper: amplitudes [rad] and gains, left and right."""

    k_left: float = quantity("-", 0.05, 10.0)
    a_left_rad: float = quantity("rad", 0.02, 1.4)
    s0: float = quantity("-", -0.5, 0.5)
    a_right_rad: float = quantity("rad", 0.02, 1.4)
    k_right: float = quantity("-", 0.05, 10.0)


@dataclass(frozen=True, slots=True)
class Delay(Checked):
    """Pure delays and first-order lags of the two command channels [s]."""

    steering_s: float = quantity("s", 0.0, 1.0, default=0.0)
    throttle_s: float = quantity("s", 0.0, 1.0, default=0.0)
    steering_lag_s: float = quantity("s", 0.0, 1.0, default=0.0)
    throttle_lag_s: float = quantity("s", 0.0, 1.0, default=0.0)


@dataclass(frozen=True, slots=True)
class PaperTyres(Checked):
    """Front: four-parameter magic formula [N]; rear: linear, ends at ``rear_max``.

    The paper's rear tyre has no end; its data stop at 6.7 deg of slip. A car
    that may spin needs a finite ``rear_max``.
    """

    front_D: float = quantity("N", 0.1, 100.0)  # noqa: N815
    front_C: float = quantity("-", 0.05, 3.0)  # noqa: N815
    front_B: float = quantity("1/rad", 0.5, 200.0)  # noqa: N815
    front_E: float = quantity("-", -20.0, 1.0)  # noqa: N815
    rear_cornering_stiffness: float = quantity("N/rad", 0.5, 500.0)
    rear_max: float = quantity("N", 0.1, math.inf, default=math.inf)


@dataclass(frozen=True, slots=True)
class AxleTyres(Checked):
    """Three-parameter magic formula of both axles; D is a coefficient of the axle load."""

    front_D: float = quantity("-", 0.05, 3.0)  # noqa: N815
    front_C: float = quantity("-", 0.05, 3.0)  # noqa: N815
    front_B: float = quantity("1/rad", 0.5, 200.0)  # noqa: N815
    rear_D: float = quantity("-", 0.05, 3.0)  # noqa: N815
    rear_C: float = quantity("-", 0.05, 3.0)  # noqa: N815
    rear_B: float = quantity("1/rad", 0.5, 200.0)  # noqa: N815


KINDS = ("dynamic", "kinematic")
SLIPS = ("all_speeds", "paper", "upstream")


@dataclass(frozen=True, slots=True)
class Vehicle:
    """One complete parameter set.

    ``kind``: the bicycle that moves it, "dynamic" or "kinematic"; ``slip``: the
    form of its slip angles, see ``tyres.make_slip``; ``effects``: what it has
    beyond the base model, in the order in which it acts.
    """

    name: str
    body: Body
    friction: Friction
    motor: Motor
    steering: Steering
    tyres: PaperTyres | AxleTyres
    delay: Delay = field(default_factory=Delay)
    kind: str = "dynamic"
    slip: str = "all_speeds"
    effects: tuple[ActiveEffect, ...] = ()

    def __post_init__(self) -> None:
        for name, value, known in (("kind", self.kind, KINDS), ("slip", self.slip, SLIPS)):
            if value not in known:
                raise ConfigError(f"Vehicle.{name} = {value!r} is not known",
                                  found=repr(value), expected=" or ".join(known),
                                  remedy="check the spelling in model.toml")
