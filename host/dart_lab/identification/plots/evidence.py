"""What the pictures show: the data of each sub-model as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass

from dart_hal.core.types import FloatArray


@dataclass(frozen=True, slots=True)
class StepResponse:
    """One stretch of straight driving, (n,) each: t [s], throttle behind the gate,
    v [m/s] and force m dv/dt [N]; title: which recording."""

    t: FloatArray
    throttle: FloatArray
    v: FloatArray
    force: FloatArray
    title: str


@dataclass(frozen=True, slots=True)
class Coasting:
    """Force [N] at throttle 0 over speed v [m/s], (n,) each."""

    v: FloatArray
    force: FloatArray


@dataclass(frozen=True, slots=True)
class Driving:
    """Motor force [N] (total less friction) at throttle and speed v [m/s], (n,) each."""

    throttle: FloatArray
    v: FloatArray
    force: FloatArray


@dataclass(frozen=True, slots=True)
class Turning:
    """Road-wheel angle atan(l W / v) [rad] over the command, (n,) each."""

    command: FloatArray
    angle: FloatArray


@dataclass(frozen=True, slots=True)
class Slipping:
    """Slip angle [rad] and lateral force [N] of both axles, (n,) each; label: which data."""

    front_slip: FloatArray
    front_force: FloatArray
    rear_slip: FloatArray
    rear_force: FloatArray
    label: str = "data"


@dataclass(frozen=True, slots=True)
class Lagging:
    """Agreement of the delayed steering command with the yaw rate, (m,) over lag [s].

    value: correlation, 1 at the best; marks: (lag [s], what it is).
    """

    lag: FloatArray
    value: FloatArray
    marks: tuple[tuple[float, str], ...] = ()


@dataclass(frozen=True, slots=True)
class Evidence:
    """What there is to show; None where the recordings hold nothing of it."""

    step: StepResponse | None = None
    friction: Coasting | None = None
    motor: Driving | None = None
    steering: Turning | None = None
    tyres: Slipping | None = None
    delay: Lagging | None = None
