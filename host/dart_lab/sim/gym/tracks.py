"""The closest point on a closed path for one car or many."""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.control.paths import Path
from dart_hal.vehicle.namespace import Value
from dart_lab.sim.light.ops import Ops

# Newton steps to the closest point: from a distance of 0.3 m the error is below 0.1 mm.
NEWTON_STEPS = 3
# Largest change of arc length in a Newton step [m], so that it never jumps to another part of the
# path.
MAX_STEP = 0.5


def make_point(track: Path, ops: Ops) -> Callable[[Value], tuple[Value, Value, Value, Value]]:
    """Make ``point(s)``: (x, y, heading, curvature) at arc length s [m] of any lap."""
    x, y, heading, curvature = (ops.table(v.tolist()) for v in (
        track.x, track.y, track.heading, track.curvature))
    n = len(track.x)
    per = 1.0 / track.spacing
    h = track.spacing
    cos = ops.f.cos
    sin = ops.f.sin
    whole = ops.whole

    def point(s: Value) -> tuple[Value, Value, Value, Value]:
        # From the nearest point of the grid along an arc of its curvature.
        k = whole(s * per + 0.5)
        d = s - k * h
        i = k % n
        yaw = heading[i]
        bend = curvature[i]
        middle = yaw + 0.5 * bend * d
        return x[i] + d * cos(middle), y[i] + d * sin(middle), yaw + bend * d, bend

    return point


def make_locate(track: Path,
                ops: Ops) -> Callable[[Value, Value, Value], tuple[Value, Value, Value]]:
    """Make ``locate(x, y, start) -> (s, offset, heading)`` of the closest point.

    The search starts at arc length ``start`` [m] and remains near it, so a path may cross itself,
    and s grows over laps. offset [m] is positive to the left.
    """
    point = make_point(track, ops)
    f = ops.f

    def locate(x: Value, y: Value, start: Value) -> tuple[Value, Value, Value]:
        s = start
        for _ in range(NEWTON_STEPS):
            px, py, yaw, bend = point(s)
            c = f.cos(yaw)
            d = f.sin(yaw)
            along = (x - px) * c + (y - py) * d
            left = (y - py) * c - (x - px) * d
            # Newton step for the foot of the perpendicular: d(along)/ds = -(1 - bend left).
            s = s + f.fmax(-MAX_STEP, f.fmin(MAX_STEP, along / f.fmax(0.3, 1.0 - bend * left)))
        px, py, yaw, _ = point(s)
        return s, (y - py) * f.cos(yaw) - (x - px) * f.sin(yaw), yaw

    return locate
