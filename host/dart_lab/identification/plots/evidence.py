"""Data of the pictures: one class of plain arrays for each sub-model."""

from __future__ import annotations

from dataclasses import dataclass

from dart_hal.core.types import FloatArray


@dataclass(frozen=True, slots=True)
class StepResponse:
    """Straight driving, (n,) each: t [s], throttle, v [m/s], force m dv/dt [N].

    throttle: behind the gate; title: name of the recording.
    """

    t: FloatArray
    throttle: FloatArray
    v: FloatArray
    force: FloatArray
    title: str


@dataclass(frozen=True, slots=True)
class CoastingData:
    """Force [N] at throttle 0 over speed v [m/s], (n,) each."""

    v: FloatArray
    force: FloatArray


@dataclass(frozen=True, slots=True)
class MotorData:
    """Motor force [N] (total less friction) at throttle and speed v [m/s], (n,) each."""

    throttle: FloatArray
    v: FloatArray
    force: FloatArray


@dataclass(frozen=True, slots=True)
class SteeringData:
    """Road-wheel angle atan(l W / v) [rad] over the command, (n,) each."""

    command: FloatArray
    angle: FloatArray


@dataclass(frozen=True, slots=True)
class TyreData:
    """Slip angle [rad] and lateral force [N] of both axles, (n,) each; label: for the legend."""

    front_slip: FloatArray
    front_force: FloatArray
    rear_slip: FloatArray
    rear_force: FloatArray
    label: str = "data"


@dataclass(frozen=True, slots=True)
class DelayData:
    """Correlation of the delayed steering command with the yaw rate over lag (m,) [s].

    value (m,): 1 at the best; marks: (lag [s], label).
    """

    lag: FloatArray
    value: FloatArray
    marks: tuple[tuple[float, str], ...] = ()


@dataclass(frozen=True, slots=True)
class PlotData:
    """Data of all pictures; None without data."""

    step: StepResponse | None = None
    friction: CoastingData | None = None
    motor: MotorData | None = None
    steering: SteeringData | None = None
    tyres: TyreData | None = None
    delay: DelayData | None = None
