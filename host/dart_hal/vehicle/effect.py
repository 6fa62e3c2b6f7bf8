"""What an effect is: one physical cause that a base model lacks, with its place in the car.

An effect has parameters with a null value at which it changes nothing, to the
last bit, and hooks at the places where it enters. Hooks are written over a
namespace like every other equation here: one definition serves simulator,
diagnosis and extended model.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, NamedTuple

from dart_hal.vehicle.namespace import Value
from dart_hal.vehicle.scale import Scale

EFFECT_STAGES = ("command", "actuator", "force", "motion", "measurement")
# Signals that an effect may change: commands behind gate, delay and lag (-1..1); road-wheel angle
# [rad]; speed of the wheels' circumference [m/s]; yaw rate [rad/s]; (a_x, a_y) [m/s2] at the IMU;
# (x, y, yaw) of the mocap marker [m, rad].
SIGNAL_CHANNELS = ("throttle", "steering", "angle", "wheel", "gyro", "accel", "pose")


# Share of the interval of a parameter; a fit that ends closer to an end is at that bound.
BOUND_MARGIN = 1e-3


class Forces(NamedTuple):
    """What acts on the car at one instant; a force hook returns it changed.

    eta [rad], v_x, v_y [m/s], omega [rad/s]; cos_d, sin_d of the road-wheel
    angle; alpha_f, alpha_r [rad]; f_xf, f_xr: drive and friction at the axles
    along the wheel, f_yf, f_yr: lateral, in the axle's own frame [N]; f_x, f_y
    [N], m_z [N m]: what acts on the body besides, in body axes, 0 at first.
    """

    eta: Value
    v_x: Value
    v_y: Value
    omega: Value
    cos_d: Value
    sin_d: Value
    alpha_f: Value
    alpha_r: Value
    f_xf: Value
    f_xr: Value
    f_yf: Value
    f_yr: Value
    f_x: Value
    f_y: Value
    m_z: Value


class Now(NamedTuple):
    """What a signal hook may know besides the signal itself.

    t [s] since the start of the recording; v_x, v_y [m/s], omega [rad/s], yaw
    [rad]; a_x, a_y [m/s2] in body axes, omega_dot [rad/s2]; drive: force at the
    wheels [N]; turns: revolutions of the encoder's gear; voltage [V] of the battery, None where it
    is not measured.
    """

    t: Value = 0.0
    v_x: Value = 0.0
    v_y: Value = 0.0
    omega: Value = 0.0
    yaw: Value = 0.0
    a_x: Value = 0.0
    a_y: Value = 0.0
    omega_dot: Value = 0.0
    drive: Value = 0.0
    turns: Value = 0.0
    voltage: Value = None


@dataclass(frozen=True, slots=True)
class Static:
    """``make(p, f, *values) -> (signal, now) -> signal``: no memory."""

    make: Callable[..., Callable[[Any, Now], Any]]


@dataclass(frozen=True, slots=True)
class Stateful:
    """``make(p, f, dt, *values) -> (first, step)``: a signal with memory, every dt [s].

    first(signal) -> state, a tuple; step(signal, now, *state) -> (signal, *state).
    blind: step does not look at now. slack(dt, *values): a state that has caught up with
    its signal goes on following it as long as that changes by no more from sample to sample.
    play(*values): the state, which is the signal behind it, stays where it is as long as the signal
    is no further from it, and else is pushed along at that distance.
    """

    make: Callable[..., tuple[Callable[..., tuple[Any, ...]], Callable[..., tuple[Any, ...]]]]
    blind: bool = False
    slack: Callable[..., float] | None = None
    play: Callable[..., float] | None = None


@dataclass(frozen=True, slots=True)
class PureDelay:
    """``seconds(*values) -> s``: the signal is delayed by this time."""

    seconds: Callable[..., Value]


Signal = Static | Stateful | PureDelay


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of an effect: unit, null value, interval and three typical sizes.

    sizes: small, medium and large departure from null, of either sign where the
    interval allows; ``per_recording``: a property of a drive, not of the car;
    ``alone``: a departure from null is an effect by itself (a phase is not);
    ``tops``: the loss may have several local minima along it (a tyre slides in one more curve), so
    the search uses a dense grid of sizes; ``physical``: what a car
    can have, where that is less than the interval [low, high] in which a fit may move; meaning:
    the physical quantity as a noun phrase, for reports. All sizes are those of the car of
    REFERENCE_WHEELBASE and REFERENCE_MASS; scales_as: unit by which they scale with a car, if that
    is not ``unit``.
    """

    name: str
    unit: str
    low: float
    high: float
    sizes: tuple[float, float, float]
    null: float = 0.0
    per_recording: bool = False
    alone: bool = True
    tops: bool = False
    physical: tuple[float, float] | None = None
    meaning: str = ""
    scales_as: str = ""

    def at_scale(self, scale: Scale) -> Parameter:
        """Return the parameter with the interval and the sizes of a car of that scale.

        Forces and lengths scale. Times, rates and angles alone are those of servos, sensors and
        clocks, and do not.
        """
        unit = self.scales_as or self.unit
        factor = scale.factor(unit) if re.search(r"\b[Nm]", unit) else 1.0
        if factor == 1.0:
            return self
        small, medium, large = (factor * size for size in self.sizes)
        physical = self.physical and (factor * self.physical[0], factor * self.physical[1])
        return replace(self, low=factor * self.low, high=factor * self.high,
                       sizes=(small, medium, large), null=factor * self.null, physical=physical)

    @property
    def physical_range(self) -> tuple[float, float]:
        """Smallest and largest value that a car can have."""
        return self.physical or (self.low, self.high)

    def impossible(self, value: float) -> str:
        """Why no car has this value: it is on an end of the interval of a fit, or no car has it.

        Empty for any value that is possible. The phase of something (not ``alone``) turns around
        and has no end.
        """
        if not self.alone:
            return ""
        near = BOUND_MARGIN * (self.high - self.low)
        low, high = self.physical_range
        unit = "" if self.unit in ("-", "relative") else f" {self.unit}"
        for end in (self.low, self.high):
            if abs(value - end) <= near and abs(end - self.null) > near:
                return (f"{self.name} = {value:.3g}{unit} is on the end of the interval "
                        f"{self.low:g} to {self.high:g}{unit} in which a fit may move it")
        if not low <= value <= high:
            return (f"{self.name} = {value:.3g}{unit} is outside its physical range "
                    f"{low:g} to {high:g}{unit}")
        return ""


@dataclass(frozen=True, slots=True, eq=False)
class Effect:
    """One entry of the catalogue.

    title: completes "the car ..." in a report; signed_titles: the same for a first parameter below
    and above its null, where the two differ; duty_only: has no meaning for a speed loop;
    physics: one paragraph; stage: one of STAGES;
    acts_along: variables of a drive that it depends on, for pictures; confused_with: effects of
    similar traces; experiment: the drive that separates them. Hooks: ``vehicle(p, *values) -> p``
    changes parameters of the base model, ``force(p, f, *values)`` gives a ``Forces -> Forces``,
    ``signals`` by channel.
    """

    name: str
    title: str
    physics: str
    stage: str
    parameters: tuple[Parameter, ...]
    confused_with: tuple[str, ...]
    experiment: str
    vehicle: Callable[..., Any] | None = None
    force: Callable[..., Callable[[Forces], Forces]] | None = None
    signals: Mapping[str, Signal] = field(default_factory=dict)
    signed_titles: tuple[str, ...] = ()
    duty_only: bool = False
    acts_along: tuple[str, ...] = ()

    @property
    def nulls(self) -> tuple[float, ...]:
        """Values at which it changes nothing."""
        return tuple(parameter.null for parameter in self.parameters)


@lru_cache(maxsize=1024)
def effect_at_scale(effect: Effect, scale: Scale) -> Effect:
    """Return the effect with the intervals and sizes of a car of that scale."""
    parameters = tuple(q.at_scale(scale) for q in effect.parameters)
    return effect if parameters == effect.parameters else replace(effect, parameters=parameters)


@dataclass(frozen=True, slots=True)
class ActiveEffect:
    """An effect of a particular car: values in the order of its parameters."""

    effect: Effect
    values: tuple[Value, ...]

    @property
    def name(self) -> str:
        return self.effect.name
