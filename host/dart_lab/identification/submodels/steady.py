"""Steering samples of steady turns: speed and yaw rate of one and the same time.

An encoder reads the mean of the last 0.1 s, a gyro this moment: while the car
gains speed their ratio shows a tighter turn than there is, most at low speed,
which looks like tyre slip. So the gyro is averaged over the encoder's window,
and what is not steady is left out. The mocap has both at one time.
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
from dart_lab.identification.submodels.speeds import EVERY, mocap_grid

SLOW = 0.3  # m/s
MAX_LATERAL = 2.0  # m/s2; beyond it slip is no longer proportional to v^2
MAX_CHANGE = 0.5  # m/s2 over 0.4 s; faster is not steady
SPAN = 2  # samples of 0.1 s to each side


@dataclass(frozen=True, slots=True)
class Turn:
    """Simultaneous t (m,) s, speed m/s, yaw rate rad/s, command; segment; good."""

    t: FloatArray
    speed: FloatArray
    yaw_rate: FloatArray
    command: FloatArray
    segment: IntArray
    good: BoolArray


def turn_of(recording: Recording, reference: Reference | None) -> Turn | None:
    """Motion at 10 Hz from the mocap, else encoder and gyro; None without either."""
    try:
        g = mocap_grid(recording, reference)
    except RecordingError:
        g = None
    if g is not None:
        pick = slice(0, None, EVERY)
        bad = g.bad[pick]
        # each end of a bad stretch begins a segment: no difference reaches across a gap
        segment = np.concatenate([[0], np.cumsum(bad[1:] != bad[:-1])]).astype(np.int64)
        return Turn(g.t[pick], g.v_x[pick], g.omega[pick], g.steering[pick], segment, ~bad)
    if recording.encoder != "ok":
        return None
    m = recording.messages
    mean = m.yaw_rate.copy()
    same = np.diff(m.segment) == 0
    mean[1:] = np.where(same, 0.5 * (m.yaw_rate[1:] + m.yaw_rate[:-1]), m.yaw_rate[1:])
    good = np.isfinite(m.speed) & np.isfinite(mean)
    return Turn(m.t, m.speed, mean, m.steering, m.segment, good)


def steady_samples(recording: Recording, wheelbase: float, reference: Reference | None,
                   ledger: Ledger) -> tuple[Samples, FloatArray] | None:
    """(samples, their v^2 (n,)) of one recording, None when nothing can be used."""
    turn = turn_of(recording, reference)
    if turn is None:
        ledger.add(recording.name, 0, len(recording.messages), ["steering: no speed measured"])
        return None
    moving = turn.good & (turn.speed > SLOW)
    steady = moving & _steady(turn, recording.quantum or 0.0)
    use = steady & (np.abs(turn.speed * turn.yaw_rate) < MAX_LATERAL)
    slope = wheelbase * turn.yaw_rate / np.where(moving, turn.speed, 1.0)
    command, earlier = shift_command(turn.t, turn.command, slope, moving)
    direction, age = approach(command, turn.t)
    if earlier == 0.0:
        use = use & ((age > MIN_COMMAND_AGE) | (direction == 0.0))
    said = [f"steering: {int((steady & ~use).sum())} samples slip or follow a change of command, "
            f"{int((moving & ~steady).sum())} change speed"] if moving.any() else [
        f"steering: nothing above {SLOW} m/s"]
    if earlier:
        said.append(f"steering: commands change all the time, taken {earlier:.2f} s earlier")
    ledger.add(recording.name, int(use.sum()), int((~use).sum()), said)
    if not use.any():
        return None
    samples = samples_of_turn(turn.t, command, turn.segment, wheelbase * turn.yaw_rate,
                              turn.speed, use)
    return samples, np.square(turn.speed[use])


def _steady(turn: Turn, quantum: float) -> BoolArray:
    """Where the speed 0.2 s before and after differs by no more than counting does."""
    out = np.zeros(len(turn.t), dtype=bool)
    if len(out) <= 2 * SPAN:
        return out
    later, sooner = turn.speed[2 * SPAN:], turn.speed[:-2 * SPAN]
    span = turn.t[2 * SPAN:] - turn.t[:-2 * SPAN]
    same = turn.segment[2 * SPAN:] == turn.segment[:-2 * SPAN]
    out[SPAN:-SPAN] = same & (np.abs(later - sooner) < MAX_CHANGE * span + 0.5 * quantum)
    return out
