"""What the trackers that drive by plans have in common: model, limits, first state, why it ends."""

from __future__ import annotations

from dataclasses import replace
from math import tan

import numpy as np

from dart_hal.control.mpc.planner import Outcome
from dart_hal.control.plant import Plant, Where
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.compose import settled
from dart_hal.vehicle.parameters import Delay, Vehicle

# s for a plan, half of what there is; late ones in a row that are still as good as the model.
BUDGET = 0.05
LATEST = 3
# s ahead of which the plan's speed is asked for: what the speed loop takes to answer, and some.
REACH = 0.3
# Of throttle beyond the dead band, the least that a car may be asked for.
MOTOR = 0.1


def vehicle_of(plant: Plant) -> Vehicle:
    """The car's model with its lags alone: transport is predicted, not planned."""
    p = settled(plant.vehicle)
    late = plant.late
    lag = p.delay.throttle_lag_s if late.lag or late.transport else 0.0
    return replace(p, delay=Delay(steering_lag_s=late.lag, throttle_lag_s=lag))


def inputs_of(plant: Plant) -> tuple[tuple[float, float], tuple[float, float]]:
    """Ends of throttle, from the dead band on, and of steering, the stops."""
    low, high = (plant.command_of(angle) for angle in plant.lock)
    onset = -settled(plant.vehicle).motor.g
    return (onset, max(plant.throttle, onset + MOTOR)), (low, high)


def first_state(plant: Plant, where: Where, l_r: float, tau: float, st: float) -> FloatArray:
    """State (8,) of a car at ``where``, with the model's slip there; l_r [m]: from the rear axle
    to the centre of mass; tau, st: throttle and steering behind their lags."""
    speed = max(where.speed, 0.0)
    steady = plant.steady
    bend = steady.bend(where.angle, speed)
    omega = bend * speed
    slip = steady.turn(bend, speed).slip
    return np.array((where.x, where.y, where.yaw, speed, l_r * omega + speed * tan(slip), omega,
                     tau, st))


def why_of(outcome: Outcome, missed: int) -> str:
    """Why a drive ends by a plan, of which ``missed`` in a row were late; "": it goes on."""
    if outcome is Outcome.DIVERGED:
        return "the plan diverged"
    if outcome is Outcome.BLOCKED:
        return "obstacles leave no way within the lane"
    return f"no plan within {BUDGET:g} s, {missed} times in a row" if missed > LATEST else ""
