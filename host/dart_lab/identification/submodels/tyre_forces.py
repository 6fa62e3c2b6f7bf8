"""Slip angles and lateral tyre forces of one recording by exact inverse dynamics.

Velocities are derivatives of the pose by the grid's kernel, accelerations are derivatives of these
by the same kernel. So the measured force has passed through the kernel twice: slip angles are
computed from smoothed velocities and a smoothed steering angle, and the model's force for them is
smoothed again before the comparison. The remaining difference is the tyre.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.core.errors import RecordingError
from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.recording.dart import Grid, Recording, Reference, grid, savgol_derivative
from dart_hal.vehicle import Vehicle, make_slip, make_steering
from dart_hal.vehicle.fitting.covariance import split_into_blocks
from dart_hal.vehicle.inverse import make_inverse_dynamics
from dart_hal.vehicle.scale import find_scale
from dart_lab.identification.prediction.commands import steering_of
from dart_lab.identification.submodels.report import Ledger
from dart_lab.identification.submodels.speeds import (
    BLOCK_LENGTH,
    MOCAP_KERNEL,
    SLOW_MOCAP_KERNEL,
    Kernel,
)

# [m/s] Slip angles below it are noise.
MIN_SLIP_SPEED = 0.5
# [m/s2] 5 % of the samples must exceed it. Else the slip is mocap noise, and noise in the slip
# angle makes a tyre look soft.
MIN_LATERAL = 1.5
# [rad] A spin is not on the tyre curve.
MAX_FRONT_SLIP = 0.5
# Samples of the grid from one force to the next: about the span of the kernel.
FORCE_STRIDE = 10


@dataclass(frozen=True, slots=True)
class TyreForces:
    """Slip angles and lateral forces of one recording.

    alpha_f, alpha_r (n,) [rad] on the whole grid; rows (k,): samples that are used; force_f,
    force_r (k,) [N] at these, in the frames of the tyres; kernel (j,): weights; block (k,);
    lateral (k,) [m/s2]; force_scale: forces of the car over those of 1:10.
    """

    name: str
    alpha_f: FloatArray
    alpha_r: FloatArray
    rows: IntArray
    force_f: FloatArray
    force_r: FloatArray
    kernel: FloatArray
    block: IntArray
    lateral: FloatArray
    force_scale: float = 1.0

    def smooth(self, force: FloatArray) -> FloatArray:
        """Smooth a force (n,) on the grid by the derivative's kernel; return it at ``rows``."""
        return np.asarray(np.convolve(force, self.kernel, mode="same")[self.rows])


def tyre_forces(recording: Recording, reference: Reference | None, car: Vehicle,
                ledger: Ledger) -> TyreForces | None:
    """Compute slip and forces; None (reason in the ledger) without mocap or a usable sample."""
    if recording.mocap is None:
        ledger.add(recording.name, 0, len(recording.messages),
                   ["tyres: no motion capture, so no side slip"])
        return None
    try:
        g = grid(recording, reference, car.body.l_r)
    except RecordingError as err:
        ledger.add(recording.name, 0, len(recording.messages), [f"tyres: {err.what}"])
        return None
    slow = float(np.median(np.diff(recording.mocap.t))) > 0.03
    kernel = smoothing_weights(SLOW_MOCAP_KERNEL if slow else MOCAP_KERNEL)
    delta = _angle(recording, g, car, kernel)
    alpha_f, alpha_r = make_slip(car.body, np)(g.v_x, g.v_y, g.omega, np.cos(delta),
                                               np.sin(delta))
    least = MIN_SLIP_SPEED * g.scale.speed
    good = (~g.bad) & (g.v_x > least) & (np.abs(alpha_f) < MAX_FRONT_SLIP)
    edge = len(kernel)
    good[:edge] = good[-edge:] = False
    rows = np.flatnonzero(good)
    rows = rows[rows % FORCE_STRIDE == 0]
    excited = len(rows) and np.quantile(np.abs(g.omega * g.v_x)[rows], 0.95) > MIN_LATERAL
    if not excited:
        rows = rows[:0]
    ledger.add(recording.name, len(rows), len(g) // FORCE_STRIDE - len(rows),
               [] if len(rows) else [f"tyres: hardly anything above {least:.2g} m/s and "
                                     f"{MIN_LATERAL} m/s2"])
    if not len(rows):
        return None
    front, rear, lateral = _forces(g, delta, car, kernel, 25 if slow else 15)
    group = np.concatenate([[0], np.cumsum(np.diff(rows) > 5 * FORCE_STRIDE)]).astype(np.int64)
    return TyreForces(recording.name, np.asarray(alpha_f), np.asarray(alpha_r), rows,
                      front[rows], rear[rows], kernel,
                      split_into_blocks(g.t[rows], group, BLOCK_LENGTH), lateral[rows],
                      find_scale(car.body).force)


def smoothing_weights(kernel: Kernel) -> FloatArray:
    """Return weights (j,) of the rate in a derivative's window: sum 1, odd length, centred."""
    covered = np.cumsum((kernel.weight * SAMPLE)[::-1])[::-1][1:]
    return np.asarray(0.5 * (np.append(covered, 0.0) + np.append(0.0, covered)))


def _angle(recording: Recording, g: Grid, car: Vehicle, kernel: FloatArray) -> FloatArray:
    """Return the road-wheel angle (n,), delayed, lagged and smoothed like the velocities."""
    command = steering_of(recording, recording.messages.arrival)
    at_wheels = command.on_grid(float(g.t[0]) - 0.5 * SAMPLE, len(g),
                                car.delay.steering_s + command.hold, car.delay.steering_lag_s)
    delta = np.asarray(make_steering(car.steering, np)(at_wheels))
    return np.convolve(delta, kernel, mode="same")


def _forces(g: Grid, delta: FloatArray, car: Vehicle, kernel: FloatArray, points: int
            ) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Solve the 3 x 3 system of the 4WD bicycle for (F_yf, F_yr, a_y) (n,)."""
    # a = dv/dt - omega x v; the product is smoothed because the derivative is.
    a_x = savgol_derivative(g.v_x, points) - np.convolve(g.omega * g.v_y, kernel, mode="same")
    a_y = savgol_derivative(g.v_y, points) + np.convolve(g.omega * g.v_x, kernel, mode="same")
    forces = make_inverse_dynamics(car, np)
    _, front, rear = forces(a_x, a_y, savgol_derivative(g.omega, points), delta)
    return front, rear, a_y


def is_rear_slip_small(part: TyreForces, limit: float) -> BoolArray:
    """Return whether (k,) the rear slip lies within +-limit [rad]."""
    return np.asarray(np.abs(part.alpha_r[part.rows]) < limit)
