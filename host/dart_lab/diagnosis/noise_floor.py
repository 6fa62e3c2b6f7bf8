"""Estimate the error that a model without any fault would have 1 s ahead on the test recordings.

Even the true model errs: the car is disturbed, poses are measured and smoothed, and no log says at
which instant a command changed. The estimate never uses the RMS of the errors themselves, so that
errors which come now and then (gusts, lost commands) exceed it. In window i and channel c

    e_ic = u_ic + m_ic

with e the error as the table of errors states it, u the same error as the diagnosis compares it
(commands at the time of their message and at the age that suits the recordings, predictions
smoothed as the poses are), and m the difference, which any model has.

1. Subtract from u what a function of the driving predicts on held-out stretches: it is a fault.
2. Fit the distribution p of the ages of commands and the standard deviations s to u(a), the error
   if commands are older by a, see ``fit_ages``.
3. The variance of u is v_c = s_c^2 + mean_i sum_a p_a (u_ic(a) - u_ic)^2.
4. floor_c^2 = v_c + M_c + 2 r_c sqrt(v_c M_c), with M_c the mean square of m and r_c the
   correlation of m with u, clipped at CLIP standard deviations.

The floor of the position joins those of its errors along and across the car.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from dart_hal.core.timing import PWM_FRAME, SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evaluation.prediction import CHANNELS, measured
from dart_lab.identification.prediction.windows import HORIZONS

from .evidence.drive import READ_OUTS
from .evidence.noise import replace_diverged
from .evidence.residuals import MOTION, Evidence
from .evidence.space import MAX_COMMAND_AGE, MessageTiming
from .gains import AT, Side, compute_case_differences
from .parameters.unseen import BEYOND
from .policy import UnexplainedPolicy
from .unexplained.command_ages import AGE_STEP, fit_ages, interpolate_ages
from .unexplained.driven import remove_driven

AHEAD = READ_OUTS.index(round(HORIZONS[AT] / SAMPLE))
"""Read-out of the residuals at the horizon of the floor."""
MIN_WINDOWS = 40
"""10 s of driving. One starts every 0.25 s and its last command decides its error, so of 40 about
20 are independent: a standard deviation is then known to 16 %."""
CLIP = 2.0
"""Standard deviations; 95 % of normal errors are within."""


def estimate_noise_floor(side: Side, vehicle: Vehicle, timing: MessageTiming, logged: Vehicle,
                         policy: UnexplainedPolicy) -> dict[str, float]:
    """Estimate the RMS error of a faultless model 1 s ahead, by channel of ``evaluate``.

    vehicle, timing: the last fit, at the timing that suits the recordings of this side; logged: the
    vehicle as it predicts from their logs. Empty without motion capture, where the start of a
    window has an error of its own, and with fewer than MIN_WINDOWS windows.
    """
    if (side.prepared is None or not side.evidence.has_mocap
            or side.prepared.windows < MIN_WINDOWS):
        return {}
    cases = side.prepared.cases
    l_r = side.evidence.l_r
    # 1. the same windows, as the diagnosis compares them
    evidence = side.evaluation_windows()
    first = AHEAD * len(MOTION)
    yaw = measured(cases, (0,))[0, 2]

    def compare(age: float) -> FloatArray:
        """Errors (n, 6), as CHANNELS, with commands older by an age [s]."""
        at = replace(timing, command_age=timing.command_age + age, age_spread=0.0)
        motion = evidence.residuals(vehicle, at).motion[:, first:first + len(MOTION)]
        pose = evidence.pose_errors(vehicle, at, READ_OUTS[AHEAD])
        return replace_diverged(np.hstack([motion, _along_and_across(pose, yaw)]))

    # 2. what the evaluation adds
    difference = compute_case_differences(logged, cases, l_r)[AT].T
    stated = replace_diverged(np.hstack([
        difference[:, 3:], _along_and_across(difference[:, :3], yaw)]))
    u = compare(0.0)
    rest = remove_driven(evidence, vehicle, u, READ_OUTS[AHEAD], policy)
    fault = u - rest + np.median(rest, axis=0)
    by_age = np.stack([compare(a) for a in possible_ages(evidence, timing)])
    # 3. commands act on velocities at once and on the pose later, so each half has its own ages
    half = len(MOTION)
    motion, pose = (floor_of_errors(u[:, some], by_age[:, :, some], fault[:, some],
                                    (stated - u)[:, some])
                    for some in (slice(half), slice(half, None)))
    floors = [*motion, math.hypot(pose[0], pose[1]), pose[2]]
    return {name: float(floor) for name, floor in zip(CHANNELS, floors, strict=True)}


def _along_and_across(pose: FloatArray, yaw: FloatArray) -> FloatArray:
    """Errors along and across the car at its start [m] and of the yaw angle [deg], (n, 3).

    pose (n, 3): errors of x, y [m] and yaw [rad]; yaw (n,): at the start.
    """
    x, y, turn = pose.T
    return np.stack([np.cos(yaw) * x + np.sin(yaw) * y, np.cos(yaw) * y - np.sin(yaw) * x,
                     np.degrees(turn)], axis=1)


def possible_ages(evidence: Evidence, timing: MessageTiming) -> FloatArray:
    """Ages (k,) [s] by which a command may be older than their fitted mean.

    Where commands have stamps, half a PWM frame to either side. Else anything from none to
    MAX_COMMAND_AGE, unless they keep step with their messages: the mean is then within its error
    of none.
    """
    if evidence.commands_stamped:
        low, high = -0.5 * PWM_FRAME, 0.5 * PWM_FRAME
    elif timing.command_age <= BEYOND:
        return np.zeros(1)
    else:
        low, high = -BEYOND - timing.command_age, MAX_COMMAND_AGE + BEYOND - timing.command_age
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
