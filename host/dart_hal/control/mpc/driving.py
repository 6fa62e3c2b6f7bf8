"""Common parts of the trackers that plan: model, limits, first state, reason to end a drive."""

from __future__ import annotations

from dataclasses import replace
from math import tan

import numpy as np

from dart_hal.control.lap import MAX_LONGITUDINAL
from dart_hal.control.mpc.planner import PlanOutcome
from dart_hal.control.plant import Plant, PredictedMotion
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.parameters import Delay, Vehicle

# Time for a plan [s], half of the period.
PLAN_BUDGET = 0.05
# Number of late plans in a row over which the last plan is still as good as the model.
MAX_LATE_PLANS = 3
# Time ahead [s], a stage of the plan: the setpoint is the faster speed of now and then. So the car
# brakes no earlier than planned before a bend, and the delay of the loop costs less speed after it.
SPEED_LOOKAHEAD = 0.1
# Smallest range of throttle above the dead band.
MIN_THROTTLE_RANGE = 0.1


def make_planning_vehicle(plant: Plant) -> Vehicle:
    """Return the car's model with its lags only: the transport delay is predicted, not planned."""
    p = apply_parameter_effects(plant.vehicle)
    delay = plant.delay
    lag = p.delay.throttle_lag_s if delay.lag or delay.transport else 0.0
    return replace(p, delay=Delay(steering_lag_s=delay.lag, throttle_lag_s=lag))


def input_ranges(plant: Plant) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the ranges of throttle, from the dead band on, and of steering, up to the stops."""
    low, high = (plant.command_of(angle) for angle in plant.lock)
    onset = -apply_parameter_effects(plant.vehicle).duty_motor.g
    return (onset, max(plant.max_throttle, onset + MIN_THROTTLE_RANGE)), (low, high)


def brake_range(plant: Plant) -> float:
    """Return the throttle below the dead band with which a plan brakes as hard as a profile may."""
    motor = apply_parameter_effects(plant.vehicle).duty_motor
    return min(plant.brake, MAX_LONGITUDINAL) * plant.vehicle.body.mass / motor.d


def make_first_state(
    plant: Plant, motion: PredictedMotion, l_r: float, tau: float, st: float
) -> FloatArray:
    """Return the state (8,) of a car with a predicted motion, with the slip of the model.

    l_r [m]: from the rear axle to the centre of mass; tau, st: throttle and steering after their
    lags.
    """
    speed = max(motion.speed, 0.0)
    steady = plant.steady
    curvature = steady.curvature(motion.angle, speed)
    omega = curvature * speed
    slip = steady.turn(curvature, speed).slip
    return np.array((motion.x, motion.y, motion.yaw, speed, l_r * omega + speed * tan(slip), omega,
                     tau, st))


def describe_failure(outcome: PlanOutcome, late_plans: int) -> str:
    """Return why a plan ends the drive after ``late_plans`` late ones in a row; "": it does not."""
    if outcome is PlanOutcome.DIVERGED:
        return "the plan diverged"
    if outcome is PlanOutcome.BLOCKED:
        return "obstacles leave no way within the lane"
    return (
        f"no plan within {PLAN_BUDGET:g} s, {late_plans} times in a row"
        if late_plans > MAX_LATE_PLANS
        else ""
    )
