"""Sign of the steering command, compared with the turns: + is to the left."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dart_hal.core.errors import RecordingError
from dart_hal.core.types import FloatArray

from .marker import marker_grid
from .model import Note, Recording

MIN_SIGN_SPEED = 0.3  # m/s, of a car of 1:10
# Smallest command that is used; a smaller one may be a trim.
MIN_STEERING = 0.1
# Delays from a command to the turn [s] that are tried.
STEERING_LAGS = tuple(np.arange(0.0, 0.36, 0.05).tolist())
# Correlation below which the sign is wrong. A car that follows its command has 0.7 to 1, one that
# slides or is pushed about 0.
MAX_REVERSED_CORRELATION = -0.6
# Samples of 0.01 s, and messages of 0.1 s.
MIN_TURNING_SAMPLES = 200
MIN_TURNING_MESSAGES = 20


def steering_note(recording: Recording) -> list[Note]:
    """Return a caution if the car turns to the other side than commanded, else nothing."""
    found = correlate_steering(recording)
    if found is None or found > MAX_REVERSED_CORRELATION:
        return []
    return [Note("caution: the car turns to the other side than commanded "
                 f"(correlation {found:.2f}): + is to the left; turn the column over (multiply "
                 "'steering' by -1)", kind="steering_reversed")]


def refuse_reversed_steering(recordings: Sequence[Recording]) -> None:
    """Raise RecordingError if a recording turns to the other side than its commands.

    A fit would find amplitudes at their bounds, and wrong tyres.
    """
    reversed_ones = [r.name for r in recordings
                     if any(note.kind == "steering_reversed" for note in r.notes)]
    if reversed_ones:
        raise RecordingError(
            f"the car turns to the other side than the steering command in {len(reversed_ones)} "
            f"of {len(recordings)} recordings", found=", ".join(reversed_ones[:5]),
            read=", ".join(reversed_ones[:5]), expected="a positive command to turn left",
            remedy="multiply the column 'steering' by -1; in the map of an import: value of "
                   "[steering] needs sign = -1")


def correlate_steering(recording: Recording) -> float | None:
    """Return the largest correlation of command and curvature over the lags; None: few turns.

    The correlation sum(x y) / sqrt(sum(x^2) sum(y^2)) is about zero and not about the mean, so
    that a constant circle counts, too.
    """
    try:
        t, command, curvature, least = _turns(recording)
    except RecordingError:  # less than 0.25 s of motion capture
        return None
    best = None
    for lag in STEERING_LAGS:
        earlier = np.interp(t - lag, t, command)
        use = (np.abs(earlier) > MIN_STEERING) & np.isfinite(curvature)
        if int(use.sum()) < least:
            continue
        x = earlier[use]
        y = curvature[use]
        size = float(np.sqrt((x @ x) * (y @ y)))
        found = float(x @ y) / size if size > 0.0 else 0.0
        best = found if best is None or abs(found) > abs(best) else best
    return best


def _turns(recording: Recording) -> tuple[FloatArray, FloatArray, FloatArray, int]:
    """Return time, command, curvature [1/m] (NaN: not driving), and the least number of rows."""
    m = recording.messages
    if recording.mocap is not None:
        g = marker_grid(recording)
        speed = np.hypot(g.dx, g.dy)
        rate = g.omega
        t = g.t
        command = g.steering
        good = ~g.bad
        forward = np.interp(t, m.arrival, m.throttle) >= 0.0
        least = MIN_TURNING_SAMPLES
    else:
        speed = m.speed
        rate = m.yaw_rate
        t = m.t
        command = m.steering
        good = np.ones(len(t), dtype=np.bool_)
        forward = m.throttle >= 0.0
        least = MIN_TURNING_MESSAGES
    with np.errstate(invalid="ignore"):
        use = good & forward & (speed > MIN_SIGN_SPEED * recording.scale.speed)
    curvature = np.where(use, rate / np.where(use, speed, 1.0), np.nan)
    return t, command, curvature, least
