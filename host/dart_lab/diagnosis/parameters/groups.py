"""Groups of parameters, and the quantities of each that a mechanic can check."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cache
from types import MappingProxyType

import numpy as np

from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.motor import make_motor
from dart_hal.vehicle.parameters import GRAVITY, SpeedLoop, Vehicle
from dart_hal.vehicle.scale import find_scale
from dart_hal.vehicle.steering import make_steering
from dart_hal.vehicle.tyres import make_tyres

SMALL_SLIP = 0.02  # rad; where a tyre is still linear
SLIPS = np.linspace(0.0, 0.8, 161)  # rad; no recording has a larger slip
THROTTLES = np.linspace(0.0, 1.0, 1001)
USUAL_THROTTLE = 0.25  # typical: 1.3 m/s of the paper's car
Quantity = Callable[[Vehicle], float]
# (unit, function of the vehicle) by its name in the workshop.
Quantities = Mapping[str, tuple[str, Quantity]]


@dataclass(frozen=True, slots=True)
class ParameterGroup:
    """Parameters of one part of the car.

    title: the part; names: parameters of the model, or patterns of them; experiment: the
    drive that distinguishes the group from its confounders.
    """

    title: str
    names: tuple[str, ...]
    quantities: Quantities
    experiment: str

    def select(self, free: Sequence[str]) -> tuple[str, ...]:
        """Return those of some parameters that belong to the group."""
        return tuple(n for n in free if any(fnmatchcase(n, pattern) for pattern in self.names))


def _resistance(speed: float) -> Quantity:
    return lambda p: -float(make_friction(apply_parameter_effects(p).friction)(speed))


def _motor_force(throttle: float, speed: float) -> Quantity:
    return lambda p: float(make_motor(apply_parameter_effects(p).motor)(throttle, speed))


def holding_throttle(speed: float) -> Quantity:
    """Return the throttle at which the motor force equals the friction, straight on.

    Of a speed loop it is the commanded speed [m/s].

    The speed that a throttle holds would be ill-conditioned: where force and friction are nearly
    equal over a range of speeds, 0.01 N changes that speed by 1 m/s.
    """
    def quantity(p: Vehicle) -> float:
        q = apply_parameter_effects(p)
        resistance = -float(make_friction(q.friction)(speed))
        if isinstance(q.motor, SpeedLoop):
            return speed + resistance / float(q.motor.gain)
        force = make_motor(q.motor, np)(THROTTLES, np.full_like(THROTTLES, speed))
        return float(np.interp(resistance, np.maximum.accumulate(force), THROTTLES))

    return quantity


def _loop_value(name: str) -> Quantity:
    return lambda p: float(getattr(apply_parameter_effects(p).motor, name))


def _angle(command: float) -> Quantity:
    return lambda p: math.degrees(float(
        make_steering(apply_parameter_effects(p).steering)(command)))


def _peak_grip(axle: int) -> Quantity:
    def quantity(p: Vehicle) -> float:
        q = apply_parameter_effects(p)
        force = make_tyres(q.tyres, q.body, np)[axle](SLIPS)
        share = q.body.l_r if axle == 0 else q.body.l_f
        return float(np.max(force)) / (q.body.mass * GRAVITY * share / q.body.wheelbase)

    return quantity


def _stiffness(axle: int) -> Quantity:
    def quantity(p: Vehicle) -> float:
        q = apply_parameter_effects(p)
        return float(make_tyres(q.tyres, q.body)[axle](SMALL_SLIP)) / SMALL_SLIP

    return quantity


def _total_delay(channel: str) -> Quantity:
    def quantity(p: Vehicle) -> float:
        d = apply_parameter_effects(p).delay
        return 1000.0 * float(getattr(d, f"{channel}_s") + getattr(d, f"{channel}_lag_s"))

    return quantity


def _size(key: str) -> Quantity:
    return lambda p: float(getattr(apply_parameter_effects(p).body, key))


@cache
def make_groups(speed: float) -> Mapping[str, ParameterGroup]:
    """Return the groups by name.

    speed [m/s]: what 1 m/s is to a car of 1:10. Sizes of the body are fitted
    only if car.toml states their errors: without these, a fit would reduce mass and inertia to
    follow the noise.
    """
    return MappingProxyType({
        "friction": ParameterGroup(
            "friction", ("friction.*",),
            {f"resistance at {speed:.3g} m/s": ("N", _resistance(speed)),
             f"resistance at {2 * speed:.3g} m/s": ("N", _resistance(2.0 * speed))},
            "Coast down straight on from several speeds, throttle 0: friction alone acts."),
        "motor": ParameterGroup(
            "motor", ("motor.[deg]",),
            {"pull at throttle 0.25, standing": ("N", _motor_force(USUAL_THROTTLE, 0.0)),
             f"pull at throttle 0.25, {2 * speed:.3g} m/s": (
                 "N", _motor_force(USUAL_THROTTLE, 2.0 * speed))},
            "Steps of the throttle from standstill to several levels, straight on: the first "
            "acceleration is the motor's."),
        "speed loop": ParameterGroup(
            "speed loop of the motor", ("motor.gain", "motor.max_force"),
            {"force per m/s below the command": ("N s/m", _loop_value("gain")),
             "largest force": ("N", _loop_value("max_force"))},
            "Steps of the commanded speed, straight on, small ones for the gain and large ones for "
            "the largest force."),
        "steering map": ParameterGroup(
            "steering map", ("steering.*",),
            {"angle at full lock left": ("deg", _angle(1.0)),
             "angle straight on": ("deg", _angle(0.0)),
             "angle at full lock right": ("deg", _angle(-1.0))},
            "Slow circles (below 1 m/s2 to the side) at several commands, left and right."),
        "steering timing": ParameterGroup(
            "time from steering command to wheel", ("delay.steering*",),
            {"delay and lag": ("ms", _total_delay("steering"))},
            "Steps of the steering at constant speed with commands logged at 100 Hz: at 10 Hz "
            "their age is not known."),
        "throttle timing": ParameterGroup(
            "time from throttle to pull", ("delay.throttle*",),
            {"delay and lag": ("ms", _total_delay("throttle"))},
            "Steps of the throttle straight on with commands logged at 100 Hz."),
        "front tyre": ParameterGroup(
            "front tyres", ("tyres.front*",),
            {"peak side force over load": ("-", _peak_grip(0)),
             "initial cornering stiffness": ("N/rad", _stiffness(0))},
            "Circles of one command with rising speed until the front slides."),
        "rear tyre": ParameterGroup(
            "rear tyres", ("tyres.rear*",),
            {"initial cornering stiffness": ("N/rad", _stiffness(1))},
            f"Steps of the steering at {1.5 * speed:.3g} m/s and more: how far the rear swings "
            "out."),
        "wheelbase": ParameterGroup(
            "wheelbase of car.toml", ("body.wheelbase",),
            {"axle to axle": ("m", _size("wheelbase"))},
            "Measure from axle to axle with a tape, on both sides."),
        "centre of mass": ParameterGroup(
            "centre of mass of car.toml", ("body.l_f", "body.l_r"),
            {"to the front axle": ("m", _size("l_f")), "to the rear axle": ("m", _size("l_r"))},
            "Weigh both axles on kitchen scales, the car level and ready to drive."),
        "mass": ParameterGroup(
            "mass of car.toml", ("body.mass",), {"mass": ("kg", _size("mass"))},
            "Weigh the car on kitchen scales, ready to drive."),
        "yaw inertia": ParameterGroup(
            "yaw inertia of car.toml", ("body.yaw_inertia",),
            {"yaw inertia": ("kg m2", _size("yaw_inertia"))},
            "Hang the car on two strings and time how it swings about the vertical axis."),
    })


GROUPS = make_groups(1.0)


@cache
def merge_groups(speed: float) -> Mapping[frozenset[str], tuple[str, str, Quantities]]:
    """Return name, title and quantities of two confounded groups together, by their names."""
    return MappingProxyType({
        frozenset({"friction", "motor"}): (
            "drive force", "drive force (motor and friction)",
            {f"throttle that holds {speed:.3g} m/s": ("-", holding_throttle(speed)),
             "pull at throttle 0.25, standing": ("N", _motor_force(USUAL_THROTTLE, 0.0))}),
        frozenset({"friction", "speed loop"}): (
            "speed loop and friction", "drive force (speed loop and friction)",
            {f"command that holds {speed:.3g} m/s": ("m/s", holding_throttle(speed)),
             "force per m/s below the command": ("N s/m", _loop_value("gain"))}),
        frozenset({"front tyre", "rear tyre"}): (
            "tyres", "front and rear tyres",
            {"peak side force over load, front": ("-", _peak_grip(0)),
             "cornering stiffness, front over rear": (
                 "-", lambda p: _stiffness(0)(p) / _stiffness(1)(p))}),
        # both commands are in one row, so the unknown age cancels in their difference
        frozenset({"steering timing", "throttle timing"}): (
            "command timing", "time from command to wheel, of the steering or of the throttle",
            {"steering later than throttle": (
                "ms", lambda p: _total_delay("steering")(p) - _total_delay("throttle")(p))})})


MERGED = merge_groups(1.0)


def list_quantities(group: str, vehicle: Vehicle) -> Quantities:
    """Return the quantities of a group, or of two confounded ones, by its name.

    Speeds are to a car of that size what 1 and 2 m/s are to one of 1:10.
    """
    speed = find_scale(vehicle.body).speed
    merged = {name: quantities for name, _, quantities in merge_groups(speed).values()}
    return merged[group] if group in merged else make_groups(speed)[group].quantities
