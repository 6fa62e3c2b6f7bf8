"""Steering samples of steady turns, with speed and yaw rate of the same time.

An encoder reads the mean of the last 0.1 s, a gyro the present value. While the car gains speed,
their ratio shows a turn that is too tight, most at low speed, which looks like tyre slip. So the
gyro is averaged over the encoder's window, and samples that are not steady are excluded. The
mocap has both at the same time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.calibration.samples import (
    MIN_COMMAND_AGE,
    Samples,
    approach,
    samples_of_turn,
    shift_command,
)
from dart_hal.core.errors import RecordingError
from dart_hal.core.types import BoolArray, FloatArray, IntArray
from dart_hal.recording.dart import Recording, Reference
from dart_lab.identification.submodels.report import Ledger
from dart_lab.identification.submodels.speeds import MOCAP_STRIDE, mocap_grid

# [m/s] of a car of 1:10.
MIN_STEADY_SPEED = 0.3
# [m/s2] Slip is not proportional to v^2 beyond it: half of what tyres hold on a slippery floor.
MAX_STEADY_LATERAL = 1.4
# [m/s2] Over 0.4 s.
MAX_STEADY_ACCEL = 0.5
# Samples of 0.1 s to each side of a difference.
STEADY_SPAN = 2


@dataclass(frozen=True, slots=True)
class SteadyMotion:
    """Motion at 10 Hz: t (m,) [s], speed [m/s], yaw rate [rad/s], command; segment; good."""

    t: FloatArray
    speed: FloatArray
    yaw_rate: FloatArray
    command: FloatArray
    segment: IntArray
    good: BoolArray


def read_motion(recording: Recording, reference: Reference | None) -> SteadyMotion | None:
    """Read the motion from the mocap, else from encoder and gyro; None without either."""
    try:
        g = mocap_grid(recording, reference)
    except RecordingError:
        g = None
    if g is not None:
        pick = slice(0, None, MOCAP_STRIDE)
        bad = g.bad[pick]
        # A segment begins at each end of a bad stretch: no difference spans a gap.
        segment = np.concatenate([[0], np.cumsum(bad[1:] != bad[:-1])]).astype(np.int64)
        return SteadyMotion(g.t[pick], g.v_x[pick], g.omega[pick], g.steering[pick], segment, ~bad)
    if recording.encoder != "ok":
        return None
    m = recording.messages
    mean = m.yaw_rate.copy()
    same = np.diff(m.segment) == 0
    mean[1:] = np.where(same, 0.5 * (m.yaw_rate[1:] + m.yaw_rate[:-1]), m.yaw_rate[1:])
    good = np.isfinite(m.speed) & np.isfinite(mean)
    return SteadyMotion(m.t, m.speed, mean, m.steering, m.segment, good)


def steady_samples(recording: Recording, wheelbase: float, reference: Reference | None,
                   ledger: Ledger) -> tuple[Samples, FloatArray] | None:
    """Return (samples, v^2 (n,)) of one recording; None (reason in the ledger) without any."""
    turn = read_motion(recording, reference)
    if turn is None:
        ledger.add(recording.name, 0, len(recording.messages), ["steering: no speed measured"])
        return None
    least = MIN_STEADY_SPEED * recording.scale.speed
    moving = turn.good & (turn.speed > least)
    steady = moving & _is_steady(turn, recording.quantum or 0.0)
    use = steady & (np.abs(turn.speed * turn.yaw_rate) < MAX_STEADY_LATERAL)
    slope = wheelbase * turn.yaw_rate / np.where(moving, turn.speed, 1.0)
    command, earlier = shift_command(turn.t, turn.command, slope, moving)
    direction, age = approach(command, turn.t)
    # The wheels follow a held command after MIN_COMMAND_AGE; others are shifted instead.
    if earlier == 0.0:
        use = use & ((age > MIN_COMMAND_AGE) | (direction == 0.0))
    reasons = [f"steering: {int((steady & ~use).sum())} samples slip or follow a change of "
               f"command, {int((moving & ~steady).sum())} change speed"] if moving.any() else [
        f"steering: nothing above {least:.2g} m/s"]
    if earlier:
        reasons.append(f"steering: commands change all the time, taken {earlier:.2f} s earlier")
    ledger.add(recording.name, int(use.sum()), int((~use).sum()), reasons)
    if not use.any():
        return None
    samples = samples_of_turn(turn.t, command, turn.segment, wheelbase * turn.yaw_rate,
                              turn.speed, use)
    return samples, np.square(turn.speed[use])


def _is_steady(turn: SteadyMotion, quantum: float) -> BoolArray:
    """Return whether the speeds 0.2 s before and after differ by no more than counting does."""
    out = np.zeros(len(turn.t), dtype=bool)
    if len(out) <= 2 * STEADY_SPAN:
        return out
    later = turn.speed[2 * STEADY_SPAN:]
    sooner = turn.speed[:-2 * STEADY_SPAN]
    span = turn.t[2 * STEADY_SPAN:] - turn.t[:-2 * STEADY_SPAN]
    same = turn.segment[2 * STEADY_SPAN:] == turn.segment[:-2 * STEADY_SPAN]
    out[STEADY_SPAN:-STEADY_SPAN] = same & (np.abs(later - sooner) < MAX_STEADY_ACCEL * span
                                            + 0.5 * quantum)
    return out
