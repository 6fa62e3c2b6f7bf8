"""The arrays of the pictures out of recordings, each for itself.

What is drawn is as near to the raw data as a force can be: smoothed over half
a second and differentiated. The fits do not use these derivatives.
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
from dart_lab.identification.fit import Fit
from dart_lab.identification.submodels import fitted_car
from dart_lab.identification.submodels.report import Ledger
from dart_lab.identification.submodels.tyre_forces import tyre_forces

from .complete import papers_form
from .evidence import Coasting, Driving, Evidence, Lagging, Slipping, StepResponse, Turning

HELD = 0.4  # s; a command this old has been answered
THIN, SMOOTH = 10, 31  # grid samples of 10 ms
MAX_POINTS = 6000  # points in one picture
STRAIGHT, GRIP = 0.6, 4.0  # m/s2 of lateral acceleration
OFFSETS = np.radians(np.arange(-6.0, 6.05, 0.1))
LAGS = np.arange(0.0, 0.6, 0.01)


@dataclass(frozen=True, slots=True)
class Motion:
    """A stretch without gaps, (n,) each at about 10 Hz; force [N] is m dv/dt."""

    name: str
    t: FloatArray
    v: FloatArray
    force: FloatArray
    yaw_rate: FloatArray
    throttle: FloatArray
    steering: FloatArray

    def held(self, command: FloatArray) -> BoolArray:
        """Rows whose command has not changed for HELD seconds."""
        last = np.concatenate([[self.t[0]], np.where(np.diff(command) != 0.0, self.t[1:], -np.inf)])
        return np.asarray(self.t - np.maximum.accumulate(last) > HELD)

    @property
    def lateral(self) -> FloatArray:
        """Lateral acceleration [m/s2]."""
        return np.abs(self.v * self.yaw_rate)


def evidence_of(recordings: Sequence[Recording], fits: Mapping[str, Fit],
                reference: Reference | None = None, base: Vehicle = PAPER) -> Evidence:
    """What these recordings show of the sub-models in ``fits``, complete as by ``completed``."""
    motions = [m for r in recordings for m in _motions(r, reference, base.body)]
    found: dict[str, Any] = {}
    if "friction" in fits or "motor" in fits:
        found["friction"] = _coasting(motions)
        found["motor"] = _driving(motions, fits.get("friction"), base)
        found["step"] = _step(motions)
    if "steering" in fits:
        found["steering"] = _turning(motions, base.body.wheelbase)
    if "delay" in fits:
        found["delay"] = _lagging(motions, fits, base)
    if papers_form(fits):
        found["tyres"] = _slipping(recordings, fits, reference, base)
    return Evidence(**found)


def _motions(r: Recording, reference: Reference | None, body: Body) -> list[Motion]:
    known = r.mocap is not None and (reference or reference_for(r)) is not None
    return _from_mocap(r, reference, body) if known else _from_encoder(r, body)


def _from_encoder(r: Recording, body: Body) -> list[Motion]:
    m, out = r.messages, []
    if r.encoder in ("dead", "none"):
        return []
    known = np.isfinite(m.yaw_rate) & np.isfinite(m.speed)
    # cut where a value is missing (the first messages of our own runs have no yaw rate)
    label = np.cumsum(np.concatenate([[0], (np.diff(m.segment) != 0) | (np.diff(known) != 0)]))
    for one in np.unique(label[known]):
        rows = np.flatnonzero(label == one)
        if len(rows) >= 10:
            v = smooth(m.speed[rows], 5, 2)
            out.append(Motion(r.path.name, m.t[rows], v, body.mass * slope(m.t[rows], v),
                              m.yaw_rate[rows], m.throttle[rows], m.steering[rows]))
    return out


def _from_mocap(r: Recording, reference: Reference | None, body: Body) -> list[Motion]:
    g = grid(r, reference, body.l_r)
    force = body.mass * (savgol_derivative(g.v_x, SMOOTH) - g.omega * g.v_y)
    edges = np.flatnonzero(np.diff(np.concatenate([[1], g.bad.astype(np.int64), [1]])))
    out = []
    for first, end in edges.reshape(-1, 2):
        rows = np.arange(first, end, THIN)
        if len(rows) >= 10:
            out.append(Motion(r.path.name, *(np.asarray(c[rows]) for c in (
                g.t, g.v_x, force, g.omega, g.throttle, g.steering))))
    return out


def _thinned(parts: Sequence[tuple[FloatArray, ...]]) -> list[FloatArray] | None:
    """Columns of all parts, joined, with at most MAX_POINTS rows; None without a row."""
    columns = [np.concatenate(c) for c in zip(*parts, strict=True)]
    every = -(-len(columns[0]) // MAX_POINTS) if columns else 0
    return [c[::every] for c in columns] if every else None


def _coasting(motions: Sequence[Motion]) -> Coasting | None:
    rows = [(m.throttle == 0.0) & m.held(m.throttle) & (m.v > 0.05) & (m.lateral < STRAIGHT)
            for m in motions]
    found = _thinned([(m.v[k], m.force[k]) for m, k in zip(motions, rows, strict=True)])
    return Coasting(*found) if found else None


def _driving(motions: Sequence[Motion], friction: Fit | None, base: Vehicle) -> Driving | None:
    p = base.friction
    x = (np.array([p.a, p.b, p.c]) if friction is None
         else np.array([friction.parameters[n].value for n in "abc"]))
    rows = [(m.throttle > 0.05) & m.held(m.throttle) & (m.v > 0.05) & (m.lateral < STRAIGHT)
            for m in motions]
    found = _thinned([(m.throttle[k], m.v[k], m.force[k] - curves.friction(x, m.v[k])[0])
                      for m, k in zip(motions, rows, strict=True)])
    return Driving(*found) if found else None


def _step(motions: Sequence[Motion]) -> StepResponse | None:
    """12 s around the greatest rise of throttle that is followed by straight driving."""
    best, rise = None, 0.05
    for m in motions:
        change = np.diff(m.throttle)
        for i in np.flatnonzero(change > rise)[np.argsort(-change[change > rise])]:
            use = (m.t > m.t[i] - 2.0) & (m.t < m.t[i] + 10.0)
            straight = np.quantile(m.lateral[use], 0.95) < STRAIGHT
            if change[i] > rise and straight and m.v[use].max() > 0.5:
                best, rise = (m, use), float(change[i])
    if best is None:
        return None
    m, use = best
    return StepResponse(m.t[use] - m.t[use][0], m.throttle[use], m.v[use], m.force[use], m.name)


def _turning(motions: Sequence[Motion], wheelbase: float) -> Turning | None:
    rows = [m.held(m.steering) & (m.v > 0.3) & (m.lateral < GRIP) for m in motions]
    found = _thinned([(m.steering[k], np.arctan2(wheelbase * m.yaw_rate[k], m.v[k]))
                      for m, k in zip(motions, rows, strict=True)])
    return Turning(*found) if found else None


def _lagging(motions: Sequence[Motion], fits: Mapping[str, Fit], base: Vehicle) -> Lagging | None:
    steer = make_steering(_map(fits, base), np)
    moving = [(m, (m.v > 0.3) & (m.lateral < GRIP)) for m in motions if np.ptp(m.steering) > 0.1]
    if sum(int(k.sum()) for _, k in moving) < 50:
        return None
    response = np.concatenate([np.arctan2(base.body.wheelbase * m.yaw_rate[k], m.v[k])
                               for m, k in moving])
    value = []
    for lag in LAGS:
        command = np.concatenate([steer(np.interp(m.t[k] - lag, m.t, m.steering))
                                  for m, k in moving])
        value.append(np.corrcoef(command, response)[0, 1])
    e = fits["delay"].parameters
    both = e["steering_s"].value + e["steering_lag_s"].value if "steering_lag_s" in e else None
    marks = [(e["steering_s"].value, "fitted delay")]
    marks += [] if both is None else [(both, "fitted delay + lag")]
    # the values of the fit are those for a replay of held rows
    total = fits["delay"].details.get("command_s")
    marks += [] if total is None else [(total, "from the command itself")]
    return Lagging(LAGS, np.array(value) / max(value), tuple(marks))


def _map(fits: Mapping[str, Fit], base: Vehicle) -> Steering:
    """The fitted steering map where there is a sound one, else the base's."""
    fit = fits.get("steering")
    return Steering(**fit.values()) if fit is not None and fit.sound else base.steering


def _slipping(recordings: Sequence[Recording], fits: Mapping[str, Fit],
              reference: Reference | None, base: Vehicle) -> Slipping | None:
    """The forces that the tyre fit sees, at slip angles freed of each recording's offsets."""
    car, ledger, tyres = fitted_car(base, fits), Ledger(), fits["tyres"]
    parts = [tyre_forces(recording, reference, car, ledger) for recording in recordings]
    found = _thinned([(_placed(p.seen(p.alpha_f), p.force_f, _front(tyres)), p.force_f,
                       _placed(p.seen(p.alpha_r), p.force_r, _rear(tyres)), p.force_r)
                      for p in parts if p is not None])
    if found is None:
        return None
    front, front_force, rear, rear_force = found
    return Slipping(front, front_force, rear, rear_force, "data, slip offset of each recording out")


def _placed(slip: FloatArray, force: FloatArray, curve: Callable[[FloatArray], FloatArray]
            ) -> FloatArray:
    """slip (n,) moved by the one offset at which the force lies nearest to the curve."""
    error = [float(np.mean((curve(slip + by) - force)**2)) for by in OFFSETS]
    return np.asarray(slip + OFFSETS[int(np.argmin(error))])


def _front(fit: Fit) -> Callable[[FloatArray], FloatArray]:
    x = np.array([fit.parameters[f"front_{n}"].value for n in "DCBE"])
    return lambda alpha: curves.pacejka(x, alpha)[0]


def _rear(fit: Fit) -> Callable[[FloatArray], FloatArray]:
    stiffness = fit.parameters["rear_cornering_stiffness"].value
    return lambda alpha: np.asarray(stiffness * alpha)
