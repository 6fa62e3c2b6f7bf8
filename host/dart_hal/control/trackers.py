"""Trackers: the steering angle that keeps the rear axle on a path.

Each is called once per command with the present motion. With the identified model and the commands
that do not act yet (``plant``) it predicts the motion at which its command acts, and steers for
that:

    pose now --(transport [+ lag])--> pose then --> angle = curvature ahead + correction

``Pursuit`` corrects along the arc that meets the path at a look-ahead distance; ``Lqr`` (``lqr``)
by a gain that weighs the offset against the rate of the wheels. ``contouring`` plans (``mpc``), and
``curvature_aware`` plans in two layers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from math import pi, remainder
from typing import Any

import numpy as np

from dart_hal.control.curvature_aware.generator import TUNED, PathWeights
from dart_hal.control.curvature_aware.progress import Law
from dart_hal.control.curvature_aware.two_layers import TwoLayers
from dart_hal.control.mpc.iteration import Mpcc
from dart_hal.control.mpc.tracker import Contouring
from dart_hal.control.on_path import PathTracker, Tracker
from dart_hal.control.paths import Path
from dart_hal.control.plant import Plant
from dart_hal.control.pursuit import arc
from dart_hal.core.errors import UsageError
from dart_hal.core.types import MotionEstimate

# Look-ahead distance [m] at rest and per speed [s]: 0.35 m at 1 m/s, 0.5 m at 2 m/s. The offset is
# corrected with 2 (v / L)^2 per s2: a natural frequency of 4.0 1/s at 1 m/s and 5.7 1/s at 2 m/s
# with a damping of 0.7.
MIN_LOOK_AHEAD = 0.20
LOOK_AHEAD_TIME = 0.15
# Time over which a step of the curvature is smoothed [s], so that wheels whose lag of 0.13 s is
# compensated overshoot by 0.4 of it at the most; curvature difference for the slope of the command
# [1/m].
CURVATURE_SMOOTHING_TIME = 0.3
CURVATURE_STEP = 0.02
# Largest angle to the path at which a distant car approaches it [rad].
MAX_APPROACH_ANGLE = 0.6


class Pursuit(PathTracker):
    """Pure pursuit (R. C. Coulter, CMU-RI-TR-92-01, 1992) of the course of the rear axle.

    The curvature of the path is fed forward, so the arc corrects only the rest: on the path the
    correction is zero, and it cuts no corner.
    """

    def steer(self, motion: MotionEstimate) -> float:
        """See ``Tracker``.

        1. Predict the motion at which the command acts.
        2. correction = arc from the car to the target - arc from the path to the target.
        3. Steady steering command for the curvature of the path plus the correction.
        4. Add lag * d(command)/dt, which compensates the lag of the servo for the curvature ahead.
        """
        delay = self.plant.delay
        steady = self.plant.steady
        future, s = self._predict_motion(motion, delay.transport + delay.yaw_delay + delay.lag)
        point = self.path.interpolate(s)
        look_ahead = MIN_LOOK_AHEAD + LOOK_AHEAD_TIME * abs(future.speed)
        target = self.path.interpolate(s + look_ahead)
        course = future.course(self.plant)
        correction = arc(future.x, future.y, course, target.x, target.y) - arc(
            point.x, point.y, point.heading, target.x, target.y)
        curvature, rate = self._smooth_curvature(s - future.speed * delay.lag, future.speed)
        low, middle, high = (
            self.plant.command_of(steady.turn(curvature + correction + d, future.speed).angle)
            for d in (-CURVATURE_STEP, 0.0, CURVATURE_STEP)
        )
        servo = middle + delay.lag * rate * (high - low) / (2.0 * CURVATURE_STEP)
        return self._send_steering(motion, self.plant.angle_of(min(max(servo, -1.0), 1.0)))

    def _smooth_curvature(self, s: float, speed: float) -> tuple[float, float]:
        """Return the curvature of the path [1/m], smoothed, and its rate [1/m/s]."""
        half = 0.5 * CURVATURE_SMOOTHING_TIME * max(speed, 0.1)
        curvatures = self.path.curvatures(s + half * np.linspace(-1.0, 1.0, 9))
        return float(curvatures.mean()), float(
            curvatures[-1] - curvatures[0]
        ) / CURVATURE_SMOOTHING_TIME


class Lqr(PathTracker):
    """Linear-quadratic regulator with preview of the path, about the steady bend ahead."""

    def steer(self, motion: MotionEstimate) -> float:
        """See ``Tracker``.

        angle = steady angle of the previewed curvature - gain (offset, heading error, wheel angle
        error), with the offset limited so that a far car approaches the path at MAX_APPROACH_ANGLE.
        """
        future, s = self._predict_motion(motion, self.plant.delay.transport)
        point = self.path.interpolate(s)
        speed = max(future.speed, 0.0)
        gain, preview, distances = self.plant.gains.interpolate(speed)
        curvature = float(preview @ self.path.curvatures(s + distances))
        steady_turn = self.plant.steady.turn(curvature, speed)
        offset = self.path.offset(future.x, future.y, s)
        max_offset = MAX_APPROACH_ANGLE * gain[1] / gain[0]
        heading_error = remainder(future.yaw - point.heading, 2.0 * pi) + steady_turn.slip
        state = (
            min(max(offset, -max_offset), max_offset),
            heading_error,
            future.angle - steady_turn.angle,
        )
        return self._send_steering(motion, steady_turn.angle - float(gain @ state))


def contouring(path: Path, plant: Plant, *, compiled: bool = False,
               **options: Any) -> Contouring[Mpcc]:
    """Return contouring control; where it cannot continue, the linear-quadratic tracker brakes.

    compiled: plan in generated C, if possible; options of ``Contouring``.
    """
    fallback = Lqr(path, plant)
    if not compiled:
        return Contouring(path, plant, fallback, Mpcc, **options)
    try:
        return Contouring(path, plant, fallback, partial(Mpcc, compiled=True), **options)
    except UsageError as error:
        tracker = Contouring(path, plant, fallback, Mpcc, **options)
        tracker.compile_error = str(error)
        return tracker


def curvature_aware(path: Path, plant: Plant, *, law: Law = Law.CA,
                    path_weights: PathWeights = TUNED, **options: Any) -> Contouring[TwoLayers]:
    """Return contouring control in two layers.

    path_weights: of the path generator, TUNED, or ``PathWeights()`` as published.
    """
    make = partial(TwoLayers, law=law, path_weights=path_weights)
    return Contouring(path, plant, Lqr(path, plant), make, **options)


# Function that makes a tracker.
Make = Callable[[Path, Plant], Tracker]
TRACKERS: dict[str, Make] = {
    "lqr": Lqr, "pursuit": Pursuit, "mpcc": contouring, "ca-mpcc": curvature_aware}


def without_delay(plant: Plant) -> Plant:
    """Return the same plant with no delay, for comparisons without prediction."""
    return replace(plant, delay=replace(plant.delay, transport=0.0, lag=0.0, yaw_delay=0.0))
