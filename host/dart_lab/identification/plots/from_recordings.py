"""Arrays for the pictures from recordings.

Forces are as near to the raw data as possible: speeds smoothed over half a second and
differentiated. The fits do not use these derivatives.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dart_hal.calibration import curves
from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.recording.dart import Recording, Reference, grid, reference_for, savgol_derivative
from dart_hal.vehicle import PAPER, Body, Steering, Vehicle, make_steering
from dart_lab.identification.filters import slope, smooth
from dart_lab.identification.fit import SubmodelFit
from dart_lab.identification.submodels import fitted_car
from dart_lab.identification.submodels.report import Ledger
from dart_lab.identification.submodels.tyre_forces import tyre_forces

from .complete import has_paper_form
from .evidence import (
    CoastingData,
    DelayData,
    MotorData,
    PlotData,
    SteeringData,
    StepResponse,
    TyreData,
)

# [s] The car has responded to a command of that age.
CONSTANT_TIME = 0.4
# Grid samples of 10 ms from one point to the next, and of the derivative.
MOCAP_SKIP = 10
SMOOTHING_SAMPLES = 31
# Points in one picture.
MAX_POINTS = 6000
# [m/s2] Lateral acceleration of straight driving, and of turns without sliding.
MAX_STRAIGHT_LATERAL = 0.6
MAX_GRIP_LATERAL = 4.0
# [rad] Trial offsets of the slip angle.
SLIP_OFFSETS = np.radians(np.arange(-6.0, 6.05, 0.1))
PLOTTED_LAGS = np.arange(0.0, 0.6, 0.01)


@dataclass(frozen=True, slots=True)
class PlottedMotion:
    """A stretch without gaps, (n,) each at about 10 Hz; force [N] is m dv/dt."""

    name: str
    t: FloatArray
    v: FloatArray
    force: FloatArray
    yaw_rate: FloatArray
    throttle: FloatArray
    steering: FloatArray

    def is_constant(self, command: FloatArray) -> BoolArray:
        """Return whether the command of each row has not changed for CONSTANT_TIME."""
        last = np.concatenate([[self.t[0]], np.where(np.diff(command) != 0.0, self.t[1:], -np.inf)])
        return np.asarray(self.t - np.maximum.accumulate(last) > CONSTANT_TIME)

    @property
    def lateral(self) -> FloatArray:
        """Lateral acceleration [m/s2]."""
        return np.abs(self.v * self.yaw_rate)


def collect_data(recordings: Sequence[Recording], fits: Mapping[str, SubmodelFit],
                 reference: Reference | None = None, base: Vehicle = PAPER) -> PlotData:
    """Collect the data of the sub-models in ``fits``, which ``complete_fits`` has completed."""
    motions = [m for r in recordings for m in _read_motions(r, reference, base.body)]
    found: dict[str, Any] = {}
    if "friction" in fits or "motor" in fits:
        found["friction"] = _collect_coasting(motions)
        found["motor"] = _collect_driving(motions, fits.get("friction"), base)
        found["step"] = _find_step(motions)
    if "steering" in fits:
        found["steering"] = _collect_turning(motions, base.body.wheelbase)
    if "delay" in fits:
        found["delay"] = _correlate_lags(motions, fits, base)
    if has_paper_form(fits):
        found["tyres"] = _collect_slip(recordings, fits, reference, base)
    return PlotData(**found)


def _read_motions(r: Recording, reference: Reference | None, body: Body) -> list[PlottedMotion]:
    known = r.mocap is not None and (reference or reference_for(r)) is not None
    return _from_mocap(r, reference, body) if known else _from_encoder(r, body)


def _from_encoder(r: Recording, body: Body) -> list[PlottedMotion]:
    m = r.messages
    out = []
    if r.encoder in ("dead", "none"):
        return []
    known = np.isfinite(m.yaw_rate) & np.isfinite(m.speed)
    # Split at missing values: the first messages of own runs have no yaw rate.
    label = np.cumsum(np.concatenate([[0], (np.diff(m.segment) != 0) | (np.diff(known) != 0)]))
    for one in np.unique(label[known]):
        rows = np.flatnonzero(label == one)
        if len(rows) >= 10:
            v = smooth(m.speed[rows], 5, 2)
            out.append(PlottedMotion(r.path.name, m.t[rows], v, body.mass * slope(m.t[rows], v),
                                     m.yaw_rate[rows], m.throttle[rows], m.steering[rows]))
    return out


def _from_mocap(r: Recording, reference: Reference | None, body: Body) -> list[PlottedMotion]:
    g = grid(r, reference, body.l_r)
    force = body.mass * (savgol_derivative(g.v_x, SMOOTHING_SAMPLES) - g.omega * g.v_y)
    edges = np.flatnonzero(np.diff(np.concatenate([[1], g.bad.astype(np.int64), [1]])))
    out = []
    for first, end in edges.reshape(-1, 2):
        rows = np.arange(first, end, MOCAP_SKIP)
        if len(rows) >= 10:
            out.append(PlottedMotion(r.path.name, *(np.asarray(c[rows]) for c in (
                g.t, g.v_x, force, g.omega, g.throttle, g.steering))))
    return out


def _thin(parts: Sequence[tuple[FloatArray, ...]]) -> list[FloatArray] | None:
    """Concatenate the columns of all parts, at most MAX_POINTS rows; None without a row."""
    columns = [np.concatenate(c) for c in zip(*parts, strict=True)]
    stride = -(-len(columns[0]) // MAX_POINTS) if columns else 0
    return [c[::stride] for c in columns] if stride else None


def _collect_coasting(motions: Sequence[PlottedMotion]) -> CoastingData | None:
    rows = [(m.throttle == 0.0) & m.is_constant(m.throttle) & (m.v > 0.05)
            & (m.lateral < MAX_STRAIGHT_LATERAL) for m in motions]
    found = _thin([(m.v[k], m.force[k]) for m, k in zip(motions, rows, strict=True)])
    return CoastingData(*found) if found else None


def _collect_driving(motions: Sequence[PlottedMotion], friction: SubmodelFit | None,
                     base: Vehicle) -> MotorData | None:
    p = base.friction
    x = (np.array([p.a, p.b, p.c]) if friction is None
         else np.array([friction.parameters[n].value for n in "abc"]))
    rows = [(m.throttle > 0.05) & m.is_constant(m.throttle) & (m.v > 0.05)
            & (m.lateral < MAX_STRAIGHT_LATERAL) for m in motions]
    found = _thin([(m.throttle[k], m.v[k], m.force[k] - curves.friction(x, m.v[k])[0])
                   for m, k in zip(motions, rows, strict=True)])
    return MotorData(*found) if found else None


def _find_step(motions: Sequence[PlottedMotion]) -> StepResponse | None:
    """Find 12 s around the largest rise of the throttle before straight driving."""
    best = None
    rise = 0.05
    for m in motions:
        change = np.diff(m.throttle)
        for i in np.flatnonzero(change > rise)[np.argsort(-change[change > rise])]:
            use = (m.t > m.t[i] - 2.0) & (m.t < m.t[i] + 10.0)
            straight = np.quantile(m.lateral[use], 0.95) < MAX_STRAIGHT_LATERAL
            if change[i] > rise and straight and m.v[use].max() > 0.5:
                best = (m, use)
                rise = float(change[i])
    if best is None:
        return None
    m, use = best
    return StepResponse(m.t[use] - m.t[use][0], m.throttle[use], m.v[use], m.force[use], m.name)


def _collect_turning(motions: Sequence[PlottedMotion], wheelbase: float) -> SteeringData | None:
    rows = [m.is_constant(m.steering) & (m.v > 0.3) & (m.lateral < MAX_GRIP_LATERAL) for m
            in motions]
    found = _thin([(m.steering[k], np.arctan2(wheelbase * m.yaw_rate[k], m.v[k]))
                   for m, k in zip(motions, rows, strict=True)])
    return SteeringData(*found) if found else None


def _correlate_lags(motions: Sequence[PlottedMotion], fits: Mapping[str, SubmodelFit],
                    base: Vehicle) -> DelayData | None:
    steer = make_steering(_steering_map(fits, base), np)
    moving = [(m, (m.v > 0.3) & (m.lateral < MAX_GRIP_LATERAL)) for m in motions
              if np.ptp(m.steering) > 0.1]
    if sum(int(k.sum()) for _, k in moving) < 50:
        return None
    response = np.concatenate([np.arctan2(base.body.wheelbase * m.yaw_rate[k], m.v[k])
                               for m, k in moving])
    value = []
    for lag in PLOTTED_LAGS:
        command = np.concatenate([steer(np.interp(m.t[k] - lag, m.t, m.steering))
                                  for m, k in moving])
        value.append(np.corrcoef(command, response)[0, 1])
    e = fits["delay"].parameters
    both = e["steering_s"].value + e["steering_lag_s"].value if "steering_lag_s" in e else None
    marks = [(e["steering_s"].value, "fitted delay")]
    marks += [] if both is None else [(both, "fitted delay + lag")]
    # The values of the fit are those for a replay of held rows.
    total = fits["delay"].details.get("command_s")
    marks += [] if total is None else [(total, "from the command itself")]
    return DelayData(PLOTTED_LAGS, np.array(value) / max(value), tuple(marks))


def _steering_map(fits: Mapping[str, SubmodelFit], base: Vehicle) -> Steering:
    """Return the fitted steering map if it is sound, else the base's."""
    fit = fits.get("steering")
    return Steering(**fit.values()) if fit is not None and fit.sound else base.steering


def _collect_slip(recordings: Sequence[Recording], fits: Mapping[str, SubmodelFit],
                  reference: Reference | None, base: Vehicle) -> TyreData | None:
    """Collect the forces of the tyre fit, at slip angles without each recording's offsets."""
    car = fitted_car(base, fits)
    ledger = Ledger()
    tyres = fits["tyres"]
    parts = [tyre_forces(recording, reference, car, ledger) for recording in recordings]
    found = _thin([(_align_slip(p.smooth(p.alpha_f), p.force_f, _front_curve(tyres)), p.force_f,
                    _align_slip(p.smooth(p.alpha_r), p.force_r, _rear_curve(tyres)), p.force_r)
                   for p in parts if p is not None])
    if found is None:
        return None
    front, front_force, rear, rear_force = found
    return TyreData(front, front_force, rear, rear_force, "data, slip offset of each recording out")


def _align_slip(slip: FloatArray, force: FloatArray, curve: Callable[[FloatArray], FloatArray]
                ) -> FloatArray:
    """Shift the slip (n,) by the offset with the least square distance of force to curve."""
    error = [float(np.mean((curve(slip + offset) - force)**2)) for offset in SLIP_OFFSETS]
    return np.asarray(slip + SLIP_OFFSETS[int(np.argmin(error))])


def _front_curve(fit: SubmodelFit) -> Callable[[FloatArray], FloatArray]:
    x = np.array([fit.parameters[f"front_{n}"].value for n in "DCBE"])
    return lambda alpha: curves.pacejka(x, alpha)[0]


def _rear_curve(fit: SubmodelFit) -> Callable[[FloatArray], FloatArray]:
    stiffness = fit.parameters["rear_cornering_stiffness"].value
    return lambda alpha: np.asarray(stiffness * alpha)
