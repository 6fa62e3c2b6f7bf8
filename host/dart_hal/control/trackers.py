"""Trackers: the steering angle that keeps the rear axle on a path.

Each is asked once per command, with the motion at that moment. It predicts, by the identified
model and the commands on their way (``plant``), the moment at which its answer acts, and steers
for there:

    pose now --(transport [+ lag])--> pose then --> angle = bend of the path ahead + correction

``Pursuit`` corrects along the arc that meets the path a look-ahead away; ``Lqr`` (``lqr``) by a
gain that weighs the offset against the speed of the wheels. ``contouring`` plans (``mpc``), and
``curvature_aware`` in two layers.
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
from dart_hal.control.on_path import OnPath, Tracker
from dart_hal.control.paths import Path
from dart_hal.control.plant import Plant
from dart_hal.control.pursuit import arc
from dart_hal.core.errors import UsageError
from dart_hal.core.types import MotionEstimate

# m and s: a look-ahead of 0.35 m at 1 m/s, 0.5 at 2. The offset is then corrected with 2 (v /
# L)^2 per s2, a natural frequency of 4.0 1/s at 1 m/s and 5.7 at 2, well damped (0.7).
NEAR = 0.20
PER_SPEED = 0.15
# s over which a step of the path's curvature is drawn out, so that wheels that are led by a lag
# of 0.13 s turn 0.4 too far at the most; 1/m of curvature, for the slope of the command there.
EASE = 0.3
SLOPE = 0.02
# rad to the path at most, at which a car that is far from it comes nearer.
OFF = 0.6


class Pursuit(OnPath):
    """Pure pursuit (R. C. Coulter, CMU-RI-TR-92-01, 1992) of the course of the rear axle.

    The bend of the path itself is fed forward, so that the arc corrects what is left: on the path
    it asks for nothing, and cuts no corner.
    """

    def steer(self, motion: MotionEstimate) -> float:
        """See ``Tracker``."""
        late = self.plant.late
        steady = self.plant.steady
        where, s = self._see(motion, late.transport + late.settles + late.lag)
        spot = self.path.at(s)
        reach = NEAR + PER_SPEED * abs(where.speed)
        target = self.path.at(s + reach)
        course = where.course(self.plant)
        more = arc(where.x, where.y, course, target.x, target.y) - arc(
            spot.x, spot.y, spot.heading, target.x, target.y)
        bend, rate = self._ahead(s - where.speed * late.lag, where.speed)
        low, middle, high = (self.plant.command_of(steady.turn(bend + more + d, where.speed).angle)
                             for d in (-SLOPE, 0.0, SLOPE))
        servo = middle + late.lag * rate * (high - low) / (2.0 * SLOPE)
        return self._command(motion, self.plant.angle_of(min(max(servo, -1.0), 1.0)))

    def _ahead(self, s: float, speed: float) -> tuple[float, float]:
        """Curvature of the path [1/m], drawn out over ``EASE``, and its rate [1/m/s]."""
        half = 0.5 * EASE * max(speed, 0.1)
        bends = self.path.curvatures(s + half * np.linspace(-1.0, 1.0, 9))
        return float(bends.mean()), float(bends[-1] - bends[0]) / EASE


class Lqr(OnPath):
    """Linear-quadratic with preview of the path, about the steady bend ahead."""

    def steer(self, motion: MotionEstimate) -> float:
        """See ``Tracker``."""
        where, s = self._see(motion, self.plant.late.transport)
        spot = self.path.at(s)
        speed = max(where.speed, 0.0)
        gain, preview, reach = self.plant.gains.at(speed)
        ahead = float(preview @ self.path.curvatures(s + reach))
        bend = self.plant.steady.turn(ahead, speed)
        left = self.path.offset(where.x, where.y, s)
        most = OFF * gain[1] / gain[0]
        turned = remainder(where.yaw - spot.heading, 2.0 * pi) + bend.slip
        state = min(max(left, -most), most), turned, where.angle - bend.angle
        return self._command(motion, bend.angle - float(gain @ state))


def contouring(path: Path, plant: Plant, *, compiled: bool = False,
               **options: Any) -> Contouring[Mpcc]:
    """Contouring control, which brakes by the linear-quadratic tracker where it cannot go on;
    compiled: by generated C, where that can be had; options of ``Contouring``."""
    safe = Lqr(path, plant)
    if not compiled:
        return Contouring(path, plant, safe, Mpcc, **options)
    try:
        return Contouring(path, plant, safe, partial(Mpcc, compiled=True), **options)
    except UsageError as why:
        tracker = Contouring(path, plant, safe, Mpcc, **options)
        tracker.in_numpy = str(why)
        return tracker


def curvature_aware(path: Path, plant: Plant, *, law: Law = Law.CA,
                    path_weights: PathWeights = TUNED, **options: Any) -> Contouring[TwoLayers]:
    """The same by the two layers; path_weights of the path generator: TUNED, or ``PathWeights()``
    as published."""
    make = partial(TwoLayers, law=law, path_weights=path_weights)
    return Contouring(path, plant, Lqr(path, plant), make, **options)


# How a tracker is made.
Make = Callable[[Path, Plant], Tracker]
TRACKERS: dict[str, Make] = {
    "lqr": Lqr, "pursuit": Pursuit, "mpcc": contouring, "ca-mpcc": curvature_aware}


def uncompensated(plant: Plant) -> Plant:
    """The same car, as if its wheels turned at once: the control of what prediction is worth."""
    return replace(plant, late=replace(plant.late, transport=0.0, lag=0.0, settles=0.0))
