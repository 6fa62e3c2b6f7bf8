"""Parameters that belong together, and the quantities of them that a mechanic can check."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from dart_hal.vehicle.compose import settled
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.motor import make_motor
from dart_hal.vehicle.parameters import GRAVITY, Vehicle
from dart_hal.vehicle.steering import make_steering
from dart_hal.vehicle.tyres import make_tyres

SLOW_SLIP = 0.02  # rad; where a tyre is still linear
SLIPS = np.linspace(0.0, 0.8, 161)  # rad; beyond it nothing was ever driven
THROTTLES = np.linspace(0.0, 1.0, 1001)
THROTTLE = 0.25  # a usual one: 1.3 m/s of the paper's car
Quantity = Callable[[Vehicle], float]


@dataclass(frozen=True, slots=True)
class Group:
    """title: what of the car it is; names: parameters of the model, or beginnings of them;
    quantities: (unit, function of the vehicle) by what a mechanic would call it;
    experiment: the drive that tells it from its like."""

    title: str
    names: tuple[str, ...]
    quantities: Mapping[str, tuple[str, Quantity]]
    experiment: str

    def of(self, free: Sequence[str]) -> tuple[str, ...]:
        """Those of some parameters that belong to it."""
        return tuple(n for n in free if n.startswith(self.names))


def _resistance(speed: float) -> Quantity:
    return lambda p: -float(make_friction(settled(p).friction)(speed))


def _pull(throttle: float, speed: float) -> Quantity:
    return lambda p: float(make_motor(settled(p).motor)(throttle, speed))


def holding_throttle(speed: float) -> Quantity:
    """Throttle at which the motor pulls as much as friction holds, straight on.

    Not the speed that a throttle holds: where pull and friction are nearly equal over a range of
    speeds, a hundredth of a newton moves that speed by a metre per second.
    """
    def quantity(p: Vehicle) -> float:
        q = settled(p)
        resistance = -float(make_friction(q.friction)(speed))
        pull = make_motor(q.motor, np)(THROTTLES, np.full_like(THROTTLES, speed))
        return float(np.interp(resistance, np.maximum.accumulate(pull), THROTTLES))

    return quantity


def _angle(command: float) -> Quantity:
    return lambda p: math.degrees(float(make_steering(settled(p).steering)(command)))


def _peak(axle: int) -> Quantity:
    def quantity(p: Vehicle) -> float:
        q = settled(p)
        force = make_tyres(q.tyres, q.body, np)[axle](SLIPS)
        share = q.body.l_r if axle == 0 else q.body.l_f
        return float(np.max(force)) / (q.body.mass * GRAVITY * share / q.body.wheelbase)

    return quantity


def _stiffness(axle: int) -> Quantity:
    def quantity(p: Vehicle) -> float:
        q = settled(p)
        return float(make_tyres(q.tyres, q.body)[axle](SLOW_SLIP)) / SLOW_SLIP

    return quantity


def _late(channel: str) -> Quantity:
    def quantity(p: Vehicle) -> float:
        d = settled(p).delay
        return 1000.0 * float(getattr(d, f"{channel}_s") + getattr(d, f"{channel}_lag_s"))

    return quantity


GROUPS: Mapping[str, Group] = MappingProxyType({
    "friction": Group(
        "friction", ("friction.",),
        {"resistance at 1 m/s": ("N", _resistance(1.0)),
         "resistance at 2 m/s": ("N", _resistance(2.0))},
        "Coast down straight on from several speeds, throttle 0: friction alone acts."),
    "motor": Group(
        "motor", ("motor.",),
        {"pull at throttle 0.25, standing": ("N", _pull(THROTTLE, 0.0)),
         "pull at throttle 0.25, 2 m/s": ("N", _pull(THROTTLE, 2.0))},
        "Steps of the throttle from standstill to several levels, straight on: the first "
        "acceleration is the motor's."),
    "steering map": Group(
        "steering map", ("steering.",),
        {"angle at full lock left": ("deg", _angle(1.0)), "angle straight on": ("deg", _angle(0.0)),
         "angle at full lock right": ("deg", _angle(-1.0))},
        "Slow circles (below 1 m/s2 to the side) at several commands, left and right."),
    "steering timing": Group(
        "time from steering command to wheel", ("delay.steering",),
        {"delay and lag": ("ms", _late("steering"))},
        "Steps of the steering at constant speed with commands logged at 100 Hz: at 10 Hz their "
        "age is not known."),
    "throttle timing": Group(
        "time from throttle to pull", ("delay.throttle",),
        {"delay and lag": ("ms", _late("throttle"))},
        "Steps of the throttle straight on with commands logged at 100 Hz."),
    "front tyre": Group(
        "front tyres", ("tyres.front",),
        {"peak side force over load": ("-", _peak(0)),
         "initial cornering stiffness": ("N/rad", _stiffness(0))},
        "Circles of one command with rising speed until the front slides."),
    "rear tyre": Group(
        "rear tyres", ("tyres.rear",),
        {"initial cornering stiffness": ("N/rad", _stiffness(1))},
        "Steps of the steering at 1.5 m/s and more: how far the rear swings out."),
})
"""By name. Mass and inertia never move: a fit shrinks them to mimic noise."""

MERGED: Mapping[frozenset[str], tuple[str, str, Mapping[str, tuple[str, Quantity]]]] = (
    MappingProxyType({
        frozenset({"friction", "motor"}): (
            "drive force", "drive force (motor and friction)",
            {"throttle that holds 1 m/s": ("-", holding_throttle(1.0)),
             "pull at throttle 0.25, standing": ("N", _pull(THROTTLE, 0.0))}),
        frozenset({"front tyre", "rear tyre"}): (
            "tyres", "front and rear tyres",
            {"peak side force over load, front": ("-", _peak(0)),
             "cornering stiffness, front over rear": (
                 "-", lambda p: _stiffness(0)(p) / _stiffness(1)(p))}),
        # one row has the commands of both: its age is the same, their difference has none
        frozenset({"steering timing", "throttle timing"}): (
            "command timing", "time from command to wheel, of the steering or of the throttle",
            {"steering later than throttle": (
                "ms", lambda p: _late("steering")(p) - _late("throttle")(p))})}))
"""What two groups that cannot be told from each other are together: name, title, quantities."""


def quantities_of(group: str) -> Mapping[str, tuple[str, Quantity]]:
    """Of a group, or of two that stand for each other, by its name."""
    merged = {name: quantities for name, _, quantities in MERGED.values()}
    return merged[group] if group in merged else GROUPS[group].quantities
