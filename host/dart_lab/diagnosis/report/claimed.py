"""A parameter that was wrong, as a picture: old curve, new curve, and what the car did.

The car's part is measured on the test recordings, where no fit has been:

    F_f = (l_r m a_y + I w') / L      F_r = (l_f m a_y - I w') / L       forces on the axles, N
    delta = atan(w L / v_x)           gentle driving, where the tyres hardly slip
    v_x over throttle                 straight on, neither faster nor slower

with the accelerations, yaw rate w and slip of the motion capture. Without it there are no slip
angles, and the curves of the tyres have no points.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import savgol_derivative
from dart_hal.vehicle.compose import settled
from dart_hal.vehicle.namespace import ARRAY
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.steering import make_steering
from dart_hal.vehicle.tyres import make_slip, make_tyres
from dart_lab.diagnosis.evidence.drive import RecordedDrive
from dart_lab.diagnosis.evidence.onboard import OnboardEvidence
from dart_lab.diagnosis.evidence.readings import measured_motion
from dart_lab.diagnosis.parameters.groups import holding_throttle
from dart_lab.diagnosis.result import Claim, Diagnosis
from dart_lab.identification.prediction.actuators import actuated
from dart_lab.report import charts, page, svg
from dart_lab.report.html import Html

from .along import FEWEST, STRETCH, WHISKER, Means, means_along

POINTS = 61  # of a drawn curve
MOVING = 0.5  # m/s; slower, a slip angle is noise
GENTLE = 1.0  # m/s2 to the side, up to which the car follows its wheels
STEADY = 0.1  # m/s2; a car that gains or loses less ...
SAME, HELD = 0.01, 60  # ... with a throttle that was the same for so many samples, is at its speed
SMOOTH = 21  # samples of its acceleration
SETTLED = 2.0  # rad/s2; a car that turns faster and faster slips more than by its slip angles alone
STRAIGHT = 0.1  # rad at the wheels
NO_SLIP_ANGLES = "no motion capture, so no slip angles: the car's own points are missing"

Points = tuple[FloatArray, FloatArray]
Curve = Callable[[Vehicle, FloatArray], FloatArray]


@dataclass(frozen=True, slots=True)
class Picture:
    """names: beginnings of the parameters that it shows; points(drive, new model): (x, y);
    reach: of x where nothing was measured."""

    names: tuple[str, ...]
    title: str
    x_label: str
    y_label: str
    curve: Curve
    points: Callable[[RecordedDrive, Vehicle], Points]
    reach: tuple[float, float]
    needs_mocap: bool = False


def pictures(c: Claim, d: Diagnosis) -> Iterator[Html]:
    """Of one claim; none of a delay, which is no curve."""
    for kind in PICTURES:
        if any(name.startswith(kind.names) for name in c.parameters):
            yield _drawn(kind, d)


def _drawn(kind: Picture, d: Diagnosis) -> Html:
    blind = kind.needs_mocap and isinstance(d.evidence, OnboardEvidence)
    found = None if blind else _measured(kind, d)
    low, high = kind.reach if found is None else (np.nanmin(found.x), np.nanmax(found.x))
    x = np.linspace(low, high, POINTS)
    none = np.full(POINTS, math.nan)
    series = [charts.Series(x, kind.curve(p, x), none, style, marked=False)
              for p, style in ((d.stages[0].vehicle, "before"), (d.extended, "after"))]
    if found is not None:
        series.append(charts.Series(found.x, found.mean, WHISKER * found.error, "car",
                                    joined=False))
    note = NO_SLIP_ANGLES if blind else (
        "points: the car on the test recordings, with two standard errors" if found is not None
        else "too little of such driving in the test recordings for the car's own points")
    return page.figure(f"{kind.title}; {note}",
                       charts.lines(kind.title, kind.x_label, kind.y_label, series))


def _measured(kind: Picture, d: Diagnosis) -> Means | None:
    parts = [(kind.points(drive, d.extended), i) for i, drive in enumerate(d.evidence.drives)]
    x, y = (np.concatenate([p[k] for p, _ in parts]) for k in (0, 1))
    stretch = np.concatenate([1e5 * i + np.arange(len(p[0])) * SAMPLE // STRETCH
                              for p, i in parts]).astype(np.int64)
    good = np.isfinite(x) & np.isfinite(y)
    return means_along(x[good], y[good], stretch[good]) if good.sum() >= FEWEST else None


def _axle(front: bool) -> tuple[Curve, Callable[[RecordedDrive, Vehicle], Points]]:
    def curve(p: Vehicle, x: FloatArray) -> FloatArray:
        q = settled(p)
        return np.asarray(make_tyres(q.tyres, q.body, ARRAY)[0 if front else 1](x))

    def points(drive: RecordedDrive, p: Vehicle) -> Points:
        b, m = settled(p).body, measured_motion(drive.grid).now
        _, delta = actuated(p, drive.grid, smooth=True)
        slip = make_slip(b, ARRAY, p.slip)(m.v_x, m.v_y, m.omega, np.cos(delta), np.sin(delta))
        turning = b.yaw_inertia * np.asarray(m.omega_dot)
        if front:
            force = (b.l_r * b.mass * np.asarray(m.a_y) + turning) / b.wheelbase / np.cos(delta)
        else:
            force = (b.l_f * b.mass * np.asarray(m.a_y) - turning) / b.wheelbase
        calm = (np.asarray(m.v_x) > MOVING) & (np.abs(np.asarray(m.omega_dot)) < SETTLED)
        return np.where(calm, np.asarray(slip[0 if front else 1]), np.nan), force

    return curve, points


def _steered(drive: RecordedDrive, p: Vehicle) -> Points:
    g, q = drive.grid, settled(p)
    back = round((q.delay.steering_s + q.delay.steering_lag_s) / SAMPLE)
    command = np.concatenate([np.repeat(g.steering[:1], back), g.steering])[:len(g)]
    angle = np.arctan2(g.omega * q.body.wheelbase, g.v_x)
    gentle = (g.v_x > MOVING) & (np.abs(g.v_x * g.omega) < GENTLE)
    return np.where(gentle, command, np.nan), angle


def _angle(p: Vehicle, x: FloatArray) -> FloatArray:
    return np.asarray(make_steering(settled(p).steering, ARRAY)(x))


def _rolling(drive: RecordedDrive, p: Vehicle) -> Points:
    throttle, delta = actuated(p, drive.grid, smooth=True)
    v = drive.grid.v_x
    recent = np.lib.stride_tricks.sliding_window_view(
        np.concatenate([np.full(HELD, math.inf), throttle]), HELD + 1)
    steady = ((v > MOVING) & (np.abs(delta) < STRAIGHT)
              & (recent.max(axis=1) - recent.min(axis=1) < SAME)
              & (np.abs(savgol_derivative(v, SMOOTH)) < STEADY))
    return np.where(steady, v, np.nan), throttle


def _throttle(p: Vehicle, x: FloatArray) -> FloatArray:
    return np.array([holding_throttle(float(speed))(p) for speed in x])


KEY = svg.legend([("before", "model as it was"), ("after", "new model"), ("car", "the car")])

PICTURES = (
    Picture(("tyres.front",), "Front tyres", "slip angle [rad]", "side force [N]", *_axle(True),
            (-0.4, 0.4), needs_mocap=True),
    Picture(("tyres.rear",), "Rear tyres", "slip angle [rad]", "side force [N]", *_axle(False),
            (-0.3, 0.3), needs_mocap=True),
    Picture(("steering.",), "Steering map", "steering command", "angle at the wheels [rad]",
            _angle, _steered, (-1.0, 1.0)),
    Picture(("motor.", "friction."), "Drive", "speed [m/s]", "throttle that holds it", _throttle,
            _rolling, (0.5, 3.0)))
