"""Steering samples out of recordings: command and the angle atan(l W/v) that answered it.

The paper's rule takes rows with v > 0.8 m/s; where nothing is that fast v >
0.3 m/s, and the notes say so. Our own runs: v > 0.3 m/s below 2 m/s2, where
tyres hardly slip.
"""

from __future__ import annotations

import numpy as np

from dart_hal.calibration.samples import Samples, answered, samples_of_turn
from dart_hal.core.types import FloatArray, IntArray
from dart_hal.recording.dart import RUN, Recording, grid, rolling_reference

from .notes import FileNote

FAST, SLOW = 0.8, 0.3  # m/s
FAST_SHARE = 0.1  # of the moving rows must be fast, else the recording counts as slow
MAX_LATERAL = 4.0  # m/s2; beyond it the tyres slip by degrees, the angle is no steering angle
MAX_LATERAL_RUN = 2.0  # m/s2; of our own runs, which need not compare with published figures
STANDING = "standing or slow"
SLIPPING = "above {} m/s2 of lateral acceleration (tyres slip)"
THIN = 10  # every tenth sample of the 100 Hz grid, as often as a sensor message


def samples_of(recording: Recording, wheelbase: float
               ) -> tuple[Samples, FloatArray, list[FileNote]]:
    """Steering samples of one recording, their v^2 (n,), and what was left out of it."""
    t, speed, yaw_rate, command, segment, said = _motion(recording)
    name = recording.name
    notes = [FileNote(name, text) for text in said]
    moving = np.isfinite(speed) & np.isfinite(yaw_rate) & (speed > SLOW)
    fast = moving & (speed > FAST)
    use = fast
    own = recording.schema == RUN
    if own:
        use = moving
    elif fast.sum() <= FAST_SHARE * moving.sum():
        use = moving
        if moving.any():
            top = float(np.nanmax(speed))
            used = f"so samples above {SLOW} m/s are used instead of above {FAST} m/s"
            notes.append(FileNote(name, f"slow, {used}", f"slow: at most {top:.2f} m/s, {used}",
                                  value=top, value_unit="m/s at most"))
    limit = MAX_LATERAL_RUN if own else MAX_LATERAL
    slipping = use & (np.abs(speed * yaw_rate) > limit)
    if slipping.any():
        n = int(slipping.sum())
        notes.append(FileNote(name, SLIPPING.format(limit), f"{n} sample(s) above {limit} m/s2 of "
                              "lateral acceleration dropped (tyres slip)", n))
        use = use & ~slipping
    notes.append(FileNote(name, STANDING, f"{int(use.sum())} of {len(use)} samples used, the "
                          "others stood, were slower or slipped", int((~use & ~slipping).sum())))
    command, more = answered(t, command, wheelbase * yaw_rate / np.where(use, speed, 1.0), use)
    if more:
        kind = "commands change all the time, taken as much earlier as fits best (delay and lag)"
        notes.append(FileNote(name, kind, f"commands change all the time: taken {more:.2f} s "
                              "earlier, where they fit best (delay and lag of servo and recorder)",
                              value=more, value_unit="s"))
    samples = samples_of_turn(t, command, segment, wheelbase * yaw_rate, speed, use)
    return samples, np.square(speed[use]), notes


def _motion(recording: Recording
            ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, IntArray, list[str]]:
    """(time, speed, yaw rate, command, segment, notes): from the sensors, else from the mocap."""
    m = recording.messages
    if recording.encoder not in ("dead", "none"):
        return m.t, m.speed, m.yaw_rate, m.steering, m.segment, []
    motion = grid(recording, rolling_reference(recording))
    good = ~motion.bad
    rows = np.flatnonzero(good)[::THIN]
    gap = np.concatenate([[0], np.cumsum(np.diff(rows) > 3 * THIN)]) if len(rows) else rows
    why = "encoder dead" if recording.encoder == "dead" else "no encoder and no IMU"
    return (motion.t[rows], motion.v_x[rows], motion.omega[rows], motion.steering[rows],
            gap.astype(np.int64), [f"{why}: speed and yaw rate from the mocap"])
