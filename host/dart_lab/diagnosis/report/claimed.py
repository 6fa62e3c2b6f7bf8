"""Pictures of wrong parameters: old curve, new curve, and measurements.

The measurements are from the test recordings, which no fit has used:

    F_f = (l_r m a_y + I w') / L      F_r = (l_f m a_y - I w') / L       forces on the axles, N
    delta = atan(w L / v_x)           gentle driving, with negligible slip of the tyres
    v_x over throttle                 straight at constant speed

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
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.namespace import ARRAY
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.steering import make_steering
from dart_hal.vehicle.tyres import make_slip, make_tyres
from dart_lab.diagnosis.parameters.groups import holding_throttle
from dart_lab.diagnosis.result import Claim, Diagnosis
from dart_lab.identification.evidence.drive import RecordedDrive
from dart_lab.identification.evidence.onboard import OnboardEvidence
from dart_lab.identification.evidence.readings import measured_motion
from dart_lab.identification.prediction.actuators import actuator_outputs
from dart_lab.report import charts, page, svg
from dart_lab.report.html import Html

from .along import BLOCK_S, MIN_PICTURE_ROWS, WHISKER_ERRORS, Means, means_along

CURVE_POINTS = 61  # of a drawn curve
MIN_SLIP_SPEED = 0.5  # m/s, of a car of 1:10; below it a slip angle is noise
MAX_LATERAL_ACCELERATION = 1.0  # m/s2; above it the tyres slip
MAX_STEADY_ACCELERATION = 0.1  # m/s2 at constant speed
MAX_THROTTLE_CHANGE = 0.01  # within STEADY_SAMPLES before
STEADY_SAMPLES = 60
SMOOTHING_SAMPLES = 21  # of the acceleration
MAX_YAW_ACCELERATION = 2.0  # rad/s2, of a car of 1:10; above it the slip is not quasi-steady
MAX_STRAIGHT_ANGLE = 0.1  # rad at the wheels
NO_SLIP_ANGLES = "no motion capture, so no slip angles: the car's own points are missing"

Points = tuple[FloatArray, FloatArray]
Curve = Callable[[Vehicle, FloatArray], FloatArray]


@dataclass(frozen=True, slots=True)
class ParameterCurve:
    """A picture of one kind of parameters.

    names: prefixes of the parameters that it shows. points(drive, new model): measured (x, y).
    reach: range of x without measurements.
    """

    names: tuple[str, ...]
    title: str
    x_label: str
    y_label: str
    curve: Curve
    points: Callable[[RecordedDrive, Vehicle], Points]
    reach: tuple[float, float]
    needs_mocap: bool = False


def pictures(c: Claim, d: Diagnosis) -> Iterator[Html]:
    """Draw the pictures of one claim; none for a delay, which has no curve."""
    for kind in PICTURES:
        if any(name.startswith(kind.names) for name in c.parameters):
            yield _draw_curve(kind, d)


def _draw_curve(kind: ParameterCurve, d: Diagnosis) -> Html:
    """Draw the old and the new curve with the measurements."""
    blind = kind.needs_mocap and isinstance(d.evidence, OnboardEvidence)
    found = None if blind else _measure_curve(kind, d)
    low, high = kind.reach if found is None else (np.nanmin(found.x), np.nanmax(found.x))
    x = np.linspace(low, high, CURVE_POINTS)
    none = np.full(CURVE_POINTS, math.nan)
    series = [charts.Series(x, kind.curve(p, x), none, style, marked=False)
              for p, style in ((d.stages[0].vehicle, "before"), (d.extended, "after"))]
    if found is not None:
        series.append(charts.Series(found.x, found.mean, WHISKER_ERRORS * found.error, "car",
                                    joined=False))
    note = NO_SLIP_ANGLES if blind else (
        "points: the car on the test recordings, with two standard errors" if found is not None
        else "too little of such driving in the test recordings for the car's own points")
    return page.figure(f"{kind.title}; {note}",
                       charts.draw_lines(kind.title, kind.x_label, kind.y_label, series))


def _measure_curve(kind: ParameterCurve, d: Diagnosis) -> Means | None:
    """Average the measured points of all test recordings; None if there are too few."""
    parts = [(kind.points(drive, d.extended), i) for i, drive in enumerate(d.evidence.drives)]
    x, y = (np.concatenate([p[k] for p, _ in parts]) for k in (0, 1))
    block = np.concatenate([1e5 * i + np.arange(len(p[0])) * SAMPLE // BLOCK_S
                            for p, i in parts]).astype(np.int64)
    good = np.isfinite(x) & np.isfinite(y)
    return means_along(x[good], y[good], block[good]) if good.sum() >= MIN_PICTURE_ROWS else None


def _axle(front: bool) -> tuple[Curve, Callable[[RecordedDrive, Vehicle], Points]]:
    """Side force of an axle over its slip angle: the curve of a model, and measured points."""
    def curve(p: Vehicle, x: FloatArray) -> FloatArray:
        q = apply_parameter_effects(p)
        return np.asarray(make_tyres(q.tyres, q.body, ARRAY)[0 if front else 1](x))

    def points(drive: RecordedDrive, p: Vehicle) -> Points:
        b = apply_parameter_effects(p).body
        m = measured_motion(drive.grid).now
        _, delta = actuator_outputs(p, drive.grid, smooth=True)
        slip = make_slip(b, ARRAY, p.slip)(m.v_x, m.v_y, m.omega, np.cos(delta), np.sin(delta))
        turning = b.yaw_inertia * np.asarray(m.omega_dot)
        # Lateral balance of forces and moments, solved for the force on this axle.
        if front:
            force = (b.l_r * b.mass * np.asarray(m.a_y) + turning) / b.wheelbase / np.cos(delta)
        else:
            force = (b.l_f * b.mass * np.asarray(m.a_y) - turning) / b.wheelbase
        scale = drive.grid.scale
        calm = ((np.asarray(m.v_x) > MIN_SLIP_SPEED * scale.speed)
                & (np.abs(np.asarray(m.omega_dot)) < MAX_YAW_ACCELERATION / scale.length))
        return np.where(calm, np.asarray(slip[0 if front else 1]), np.nan), force

    return curve, points


def _steering_points(drive: RecordedDrive, p: Vehicle) -> Points:
    """Command and measured steering angle while driving gently."""
    g = drive.grid
    q = apply_parameter_effects(p)
    # The command acted later by its delay and lag.
    back = round((q.delay.steering_s + q.delay.steering_lag_s) / SAMPLE)
    command = np.concatenate([np.repeat(g.steering[:1], back), g.steering])[:len(g)]
    angle = np.arctan2(g.omega * q.body.wheelbase, g.v_x)
    gentle = ((g.v_x > MIN_SLIP_SPEED * g.scale.speed)
              & (np.abs(g.v_x * g.omega) < MAX_LATERAL_ACCELERATION))
    return np.where(gentle, command, np.nan), angle


def _steering_curve(p: Vehicle, x: FloatArray) -> FloatArray:
    return np.asarray(make_steering(apply_parameter_effects(p).steering, ARRAY)(x))


def _throttle_points(drive: RecordedDrive, p: Vehicle) -> Points:
    """Speed and throttle while driving straight at constant speed."""
    throttle, delta = actuator_outputs(p, drive.grid, smooth=True)
    v = drive.grid.v_x
    recent = np.lib.stride_tricks.sliding_window_view(
        np.concatenate([np.full(STEADY_SAMPLES, math.inf), throttle]), STEADY_SAMPLES + 1)
    steady = ((v > MIN_SLIP_SPEED * drive.grid.scale.speed) & (np.abs(delta) < MAX_STRAIGHT_ANGLE)
              & (recent.max(axis=1) - recent.min(axis=1) < MAX_THROTTLE_CHANGE)
              & (np.abs(savgol_derivative(v, SMOOTHING_SAMPLES)) < MAX_STEADY_ACCELERATION))
    return np.where(steady, v, np.nan), throttle


def _throttle_curve(p: Vehicle, x: FloatArray) -> FloatArray:
    return np.array([holding_throttle(float(speed))(p) for speed in x])


LEGEND = svg.legend([("before", "model as it was"), ("after", "new model"), ("car", "the car")])

PICTURES = (ParameterCurve(("tyres.front",), "Front tyres", "slip angle [rad]", "side force [N]",
                           *_axle(True), (-0.4, 0.4), needs_mocap=True),
            ParameterCurve(("tyres.rear",), "Rear tyres", "slip angle [rad]", "side force [N]",
                           *_axle(False), (-0.3, 0.3), needs_mocap=True),
            ParameterCurve(("steering.",), "Steering map", "steering command",
                           "angle at the wheels [rad]", _steering_curve, _steering_points, (-1.0,
                                                                                            1.0)),
            ParameterCurve(("motor.", "friction."), "Drive", "speed [m/s]",
                           "throttle that holds it", _throttle_curve, _throttle_points, (0.5, 3.0)))
