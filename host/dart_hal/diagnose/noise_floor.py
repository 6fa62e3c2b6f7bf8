"""Estimate the error that a model without any fault would have 1 s ahead on the test recordings.

Even the true model errs: the car is disturbed, poses are measured and smoothed, and no log says at
which instant a command changed. The estimate never uses the RMS of the errors themselves, so that
errors which come now and then (gusts, lost commands) exceed it. In window i and channel c

    e_ic = u_ic + m_ic

with e the error as the table of errors states it, u the same error as the diagnosis compares it
(commands at the time of their message and at the age that suits the recordings, predictions
smoothed as the poses are), and m the difference, which any model has.

1. Subtract from u what a function of the driving predicts on held-out stretches: it is a fault.
2. Fit the distribution p of the ages of commands and the standard deviations s by maximum
   likelihood (expectation maximisation), with u(a) the error if commands are older by a:

       L = prod_i sum_a p_a prod_c [(1 - E) n(u_ic(a) / s_c) + E / W n(u_ic(a) / (W s_c))] / s_c

   n is the normal density; a share E of the windows may hold an event.
3. The variance of u is v_c = s_c^2 + mean_i sum_a p_a (u_ic(a) - u_ic)^2.
4. floor_c^2 = v_c + M_c + 2 r_c sqrt(v_c M_c), with M_c the mean square of m and r_c the
   correlation of m with u, clipped at CLIP standard deviations.

Errors of position (along and across the car) and yaw angle are integrals, which smoothing hardly
changes: there u is e and m is zero.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from dart_hal.control.drivetrain import FRAME
from dart_hal.evaluate.prediction import CHANNELS, measured
from dart_hal.fitting.robust import scatter
from dart_hal.predict.windows import HORIZONS
from dart_hal.types import SAMPLE, FloatArray
from dart_hal.vehicle.flat import unchecked
from dart_hal.vehicle.parameters import Vehicle

from .evidence.drive import READ_OUTS
from .evidence.residuals import MOTION, Evidence
from .evidence.space import MAX_COMMAND_AGE, Timing
from .gains import AT, Side, compute_case_differences
from .parameters.unseen import BEYOND
from .policy import UnexplainedPolicy
from .unexplained.driven import remove_driven

AHEAD = READ_OUTS.index(round(HORIZONS[AT] / SAMPLE))
"""Read-out of the residuals at the horizon of the floor."""
MIN_WINDOWS = 40
"""10 s of driving. One starts every 0.25 s and its last command decides its error, so of 40 about
20 are independent: a standard deviation is then known to 16 %."""
EVENT_SHARE = 0.1
"""E: windows that an event may disturb ..."""
EVENT_WIDTH = 10.0
"""W: ... and the standard deviation of their errors over that of the others. An error beyond 3.0
standard deviations is then more likely that of an event, (1 - E) n(z) = E / W n(z / W)."""
AGE_STEP = 0.005
"""s between ages at which windows are predicted: velocities of the poses are means over 0.06 s, so
errors are nearly straight from one age to the next ..."""
AGE_PARTS = 2
"""... and are interpolated at so many parts of the step."""
INFORMATIVE = 2.0
"""Log likelihood between best and worst age, above which a window shows how old its command was. A
window in which no command changes does not."""
MIN_INFORMATIVE = 3
"""Such windows; with fewer all ages count alike."""
ROUNDS = 50
"""Of expectation maximisation."""
CLIP = 2.0
"""Standard deviations; 95 % of normal errors are within."""


def estimate_noise_floor(side: Side, vehicle: Vehicle, timing: Timing, logged: Vehicle,
                         policy: UnexplainedPolicy) -> dict[str, float]:
    """Estimate the RMS error of a faultless model 1 s ahead, by channel of ``evaluate``.

    vehicle, timing: the last fit, at the timing that suits the recordings of this side; logged: the
    vehicle as it predicts from their logs. Empty without motion capture, where the start of a
    window has an error of its own, and with fewer than MIN_WINDOWS windows.
    """
    if (side.prepared is None or not side.evidence.exact
            or side.prepared.windows < MIN_WINDOWS):
        return {}
    cases = side.prepared.cases
    l_r = side.evidence.l_r
    # 1. the same windows, as the diagnosis compares them
    starts = {case.sha256: case.windows.start for case in cases}
    evidence = side.evidence.motion_alone([starts[d.recording.sha256]
                                           for d in side.evidence.drives])
    first = AHEAD * len(MOTION)
    yaw = measured(cases, (0,))[0, 2]

    def compare(age: float) -> FloatArray:
        """Errors of v_x, v_y and yaw rate (n, 3) with commands older by an age [s]."""
        at = replace(timing, command_age=timing.command_age + age, spread=0.0)
        return _finite(evidence.residuals(vehicle, at).motion[:, first:first + len(MOTION)])

    def displace(age: float) -> FloatArray:
        """Errors along and across the car [m] and of the yaw angle [deg] (n, 3), the same."""
        d = logged.delay
        p = unchecked(logged, {"delay": {"steering_s": d.steering_s - age,
                                         "throttle_s": d.throttle_s - age}})
        x, y, turn = compute_case_differences(p, cases, l_r)[AT, :3]
        return _finite(np.stack([np.cos(yaw) * x + np.sin(yaw) * y,
                                 np.cos(yaw) * y - np.sin(yaw) * x, np.degrees(turn)], axis=1))

    def find_fault(errors: FloatArray) -> FloatArray:
        """What a function of the driving predicts of errors (n, c), and their median."""
        rest = remove_driven(evidence, vehicle, errors, READ_OUTS[AHEAD], policy)
        return errors - rest + np.median(rest, axis=0)

    ages = possible_ages(evidence, timing)
    stated = _finite(compute_case_differences(logged, cases, l_r)[AT, 3:].T)
    u = compare(0.0)
    motion = floor_of_errors(u, np.stack([compare(a) for a in ages]), find_fault(u), stated - u)
    # an evaluation delays by whole samples
    samples = np.unique(np.round(ages / SAMPLE))
    u = displace(0.0)
    pose = floor_of_errors(u, np.stack([displace(a) for a in samples * SAMPLE]), find_fault(u),
                           np.zeros_like(u))
    floors = [*motion, math.hypot(pose[0], pose[1]), pose[2]]
    return {name: float(floor) for name, floor in zip(CHANNELS, floors, strict=True)}


def possible_ages(evidence: Evidence, timing: Timing) -> FloatArray:
    """Ages (k,) [s] by which a command may be older than their fitted mean.

    Where commands have stamps, half a PWM frame to either side. Else anything from none to
    MAX_COMMAND_AGE, unless they keep step with their messages: the mean is then within its error
    of none.
    """
    if evidence.commands_stamped:
        low, high = -0.5 * FRAME, 0.5 * FRAME
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
    grid = _interpolate(by_age)
    s, p = fit_noise(grid - fault)
    spread = np.einsum("k,knc->nc", p, (grid - errors)**2)
    variance = s**2 + spread.mean(axis=0)
    limit = CLIP * np.sqrt(s**2 + spread)
    clipped = np.clip(errors - fault, -limit, limit)
    added = np.mean(method**2, axis=0)
    scale = np.sqrt(np.mean(clipped**2, axis=0) * added)
    correlation = np.mean(clipped * method, axis=0) / np.maximum(scale, 1e-12)
    return np.asarray(np.sqrt(variance + added + 2.0 * correlation * np.sqrt(variance * added)))


def fit_noise(by_age: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Fit standard deviations (c,) and probabilities of ages (k,) to errors (k, n, c) by age."""
    k, _, channels = by_age.shape
    middle = by_age[k // 2]
    s = np.array([scatter(middle[:, c] - np.median(middle[:, c])) for c in range(channels)]) + 1e-9
    p = np.full(k, 1.0 / k)
    for _ in range(ROUNDS):
        # 1. probability of each age by window, all channels together
        z2 = (by_age / s)**2
        usual = (1.0 - EVENT_SHARE) * np.exp(-0.5 * z2)
        event = EVENT_SHARE / EVENT_WIDTH * np.exp(-0.5 * z2 / EVENT_WIDTH**2)
        log_likelihood = np.log(usual + event + 1e-300).sum(axis=2)
        posterior = np.exp(log_likelihood - log_likelihood.max(axis=0)) * p[:, None] + 1e-300
        posterior /= posterior.sum(axis=0)
        # 2. probabilities of the ages, by windows that depend on them
        informative = np.ptp(log_likelihood, axis=0) > INFORMATIVE
        p = (posterior[:, informative].mean(axis=1) if informative.sum() >= MIN_INFORMATIVE
             else np.full(k, 1.0 / k))
        # 3. standard deviations, by errors that are no event
        weight = posterior[:, :, None] * usual / (usual + event + 1e-300)
        s = np.sqrt(np.sum(weight * by_age**2, axis=(0, 1)) / np.sum(weight, axis=(0, 1))) + 1e-9
    return s, p


def _interpolate(by_age: FloatArray) -> FloatArray:
    """Errors (k, n, c) at AGE_PARTS times as many ages."""
    k = len(by_age)
    if k == 1:
        return by_age
    at = np.linspace(0.0, k - 1.0, AGE_PARTS * (k - 1) + 1)
    before = np.minimum(at.astype(np.int64), k - 2)
    share = (at - before)[:, None, None]
    return np.asarray((1.0 - share) * by_age[before] + share * by_age[before + 1])


def _finite(errors: FloatArray) -> FloatArray:
    """Errors with 1000 for those of a prediction that diverged."""
    return np.nan_to_num(errors, nan=1e3, posinf=1e3, neginf=-1e3)
