"""Estimate the error that a model without any fault would have 1 s ahead on the test recordings.

Even the true model has errors: the car is disturbed, poses are measured and smoothed, and no log
has the instant at which a command changed. The estimate never uses the RMS of the errors, so that
rare errors (gusts, lost commands) exceed it. In window i and channel c

    e_ic = u_ic + m_ic

with e the error in the table of errors, u the same error as the diagnosis computes it (commands at
the time of their message and at the age that suits the recordings, predictions smoothed as the
poses are), and m the difference, which any model has.

1. Subtract from u the part that a function of the driving state predicts on held-out stretches.
   This part is a fault of the model.
2. Fit the distribution p of the ages of commands and the standard deviations s to u(a), the error
   if commands are older by a, see ``fit_ages``.
3. The variance of u is v_c = s_c^2 + mean_i sum_a p_a (u_ic(a) - u_ic)^2.
4. floor_c^2 = v_c + M_c + 2 r_c sqrt(v_c M_c), with M_c the mean square of m and r_c the
   correlation of m with u, clipped at CLIP standard deviations.

The floor of the position combines those of its errors along and across the car.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from dart_hal.core.timing import PWM_FRAME, SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evaluation.prediction import CHANNELS, measured
from dart_lab.identification.evidence.drive import READ_OUTS
from dart_lab.identification.evidence.noise import replace_diverged
from dart_lab.identification.evidence.residuals import MOTION, Evidence
from dart_lab.identification.evidence.space import MAX_COMMAND_AGE, MessageTiming
from dart_lab.identification.prediction.windows import HORIZONS

from .gains import HORIZON_INDEX, RecordingSet, compute_case_differences
from .parameters.unseen import AGE_TOLERANCE_S
from .unexplained.command_ages import AGE_STEP, fit_ages, interpolate_ages
from .unexplained.driven import remove_driven

# Read-out of the residuals at the horizon of the floor.
FLOOR_READ_OUT = READ_OUTS.index(round(HORIZONS[HORIZON_INDEX] / SAMPLE))
# 10 s of driving. A window starts every 0.25 s and its last command determines its error, so of 40
# about 20 are independent: a standard deviation is then known to 16 %.
MIN_WINDOWS = 40
CLIP = 2.0  # standard deviations; 95 % of normal errors are within


def estimate_noise_floor(recordings: RecordingSet, vehicle: Vehicle, timing: MessageTiming,
                         logged: Vehicle) -> dict[str, float]:
    """Estimate the RMS error of a faultless model 1 s ahead, by channel of ``evaluate``.

    vehicle, timing: the last fit, at the timing that suits these recordings; logged: the vehicle
    for predictions from their logs. Empty without motion capture, where the state at the start of
    a window is not measured, and with fewer than MIN_WINDOWS windows.
    """
    if (recordings.prepared is None or not recordings.evidence.has_mocap
            or recordings.prepared.windows < MIN_WINDOWS):
        return {}
    cases = recordings.prepared.cases
    l_r = recordings.evidence.l_r
    # u: errors in the windows of the evaluation, as the diagnosis computes them
    evidence = recordings.evaluation_windows()
    first = FLOOR_READ_OUT * len(MOTION)
    yaw = measured(cases, (0,))[0, 2]

    def compute_errors(age: float) -> FloatArray:
        """Return errors (n, 6), as CHANNELS, with commands older by an age [s]."""
        other = replace(timing, command_age=timing.command_age + age, age_spread=0.0)
        motion = evidence.residuals(vehicle, other).motion[:, first:first + len(MOTION)]
        pose = evidence.pose_errors(vehicle, other, READ_OUTS[FLOOR_READ_OUT])
        return replace_diverged(np.hstack([motion, _along_and_across(pose, yaw)]))

    # e: errors as the evaluation computes them
    difference = compute_case_differences(logged, cases, l_r)[HORIZON_INDEX].T
    stated = replace_diverged(np.hstack([
        difference[:, 3:], _along_and_across(difference[:, :3], yaw)]))
    u = compute_errors(0.0)
    # 1. the fault
    rest = remove_driven(evidence, vehicle, u, READ_OUTS[FLOOR_READ_OUT])
    fault = u - rest + np.median(rest, axis=0)
    # 2. to 4. Commands act on velocities at once and on the pose later, so each half has its ages.
    by_age = np.stack([compute_errors(a) for a in possible_ages(evidence, timing)])
    half = len(MOTION)
    motion, pose = (floor_of_errors(u[:, some], by_age[:, :, some], fault[:, some],
                                    (stated - u)[:, some])
                    for some in (slice(half), slice(half, None)))
    floors = [*motion, math.hypot(pose[0], pose[1]), pose[2]]
    return {name: float(floor) for name, floor in zip(CHANNELS, floors, strict=True)}


def _along_and_across(pose: FloatArray, yaw: FloatArray) -> FloatArray:
    """Return errors along and across the car at its start [m] and of the yaw [deg], (n, 3).

    pose (n, 3): errors of x, y [m] and yaw [rad]; yaw (n,): at the start.
    """
    x, y, turn = pose.T
    return np.stack([np.cos(yaw) * x + np.sin(yaw) * y, np.cos(yaw) * y - np.sin(yaw) * x,
                     np.degrees(turn)], axis=1)


def possible_ages(evidence: Evidence, timing: MessageTiming) -> FloatArray:
    """Return ages (k,) [s] by which a command may be older than their fitted mean.

    With stamps they reach half a PWM frame to either side, else from 0 to MAX_COMMAND_AGE. Commands
    that are synchronous with their messages, with a mean near 0, have one age.
    """
    if evidence.commands_stamped:
        low = -0.5 * PWM_FRAME
        high = 0.5 * PWM_FRAME
    elif timing.command_age <= AGE_TOLERANCE_S:
        return np.zeros(1)
    else:
        low = -AGE_TOLERANCE_S - timing.command_age
        high = MAX_COMMAND_AGE + AGE_TOLERANCE_S - timing.command_age
    return np.linspace(low, high, 1 + math.ceil((high - low) / AGE_STEP - 1e-9))


def floor_of_errors(errors: FloatArray, by_age: FloatArray, fault: FloatArray,
                    method: FloatArray) -> FloatArray:
    """Compute the floor (c,) of n windows in c channels, see the steps in the module's docstring.

    errors (n, c): u; by_age (k, n, c): u with commands older by each of k ages, evenly spaced;
    fault (n, c): the part of u that the driving predicts; method (n, c): m.
    """
    grid = interpolate_ages(by_age)
    fit = fit_ages(grid - fault)
    spread = np.einsum("k,knc->nc", fit.probability, (grid - errors)**2)
    variance = fit.std**2 + spread.mean(axis=0)
    limit = CLIP * np.sqrt(fit.std**2 + spread)
    clipped = np.clip(errors - fault, -limit, limit)
    added = np.mean(method**2, axis=0)
    scale = np.sqrt(np.mean(clipped**2, axis=0) * added)
    correlation = np.mean(clipped * method, axis=0) / np.maximum(scale, 1e-12)
    return np.asarray(np.sqrt(variance + added + 2.0 * correlation * np.sqrt(variance * added)))
