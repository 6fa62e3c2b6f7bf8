"""The brake of the ESC, measured at the end of ``calibrate throttle``.

1. The car drives straight at one speed.
2. A pulse below neutral brakes it, by a quarter or by half of the full brake, or by as much as
   [limits] min_throttle allows.
3. A line through the decelerations: its slope belongs to the brake, the rest to friction. What
   friction changes with the speed is subtracted first, by the paper's friction.

The full brake is extrapolated: it might lock the wheels.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from dart_hal.core.config import CarFiles, Quantity
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import INTERVAL_90, FloatArray, State
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.sets import PAPER

from .sensor_log import SensorLog
from .spin import edge_distances

# m/s from which the car brakes: 3 m of floor from rest to rest, also if nothing brakes.
MAX_START_SPEED = 1.3
# m/s at which braking ends: the speed is 50 ms old, 0.2 m/s at 4 m/s2, and below neutral an ESC
# without a brake drives backward from rest.
END_SPEED = 0.3
# Largest part of the full brake: 2.4 m/s2 of a usual one, a third of the 7 m/s2 that the tyres of
# the real car held sideways.
MAX_PART = 0.5
# Runs at each of two parts: four degrees of freedom beyond the line.
REPEATS = 3
# s after the pulse until only brake and friction act: two PWM frames, delay and lag of the motor.
SETTLING = 0.1
# s of braking at most: from 1.3 to 0.3 m/s by friction alone.
MAX_DURATION = 1.0
# Edges of a run at least, as of a measurement of a speed.
MIN_EDGES = 8
# Relative error of the paper's friction, in what it changes between the speeds of two runs.
FRICTION_STD = 0.3
# 95 % quantile of Student's distribution with 4 degrees of freedom: six runs, two fitted numbers.
STUDENT_95 = 2.132

HoldPulse = Callable[[float, float], list[State]]
"""(seconds, pulse [us]) -> States: holds a pulse along the line; 0 s: for one frame."""


class TooFewEdges(CalibrationFailed):
    """The wheels stop too soon for a measurement of the deceleration."""


def choose_parts(files: CarFiles) -> tuple[float, ...]:
    """Return the part of the full brake of each run; () if [limits] min_throttle forbids it."""
    largest = min(MAX_PART, -files.config.limits.min_throttle)
    return (0.5 * largest, largest) * REPEATS if largest > 0.0 else ()


def brake(hold: HoldPulse, log: SensorLog, files: CarFiles, part: float
          ) -> tuple[float, float]:
    """Brake by a part of the full brake down to END_SPEED.

    Returns (mean speed [m/s], deceleration [m/s2]). Raises TooFewEdges.
    """
    pulse = files.neutral_us - part * files.config.throttle.span_us
    state = hold(0.0, pulse)[-1]
    begin = state.t
    is_measuring = False
    while state.speed > END_SPEED and state.t - begin < MAX_DURATION:
        if not is_measuring and state.t - begin >= SETTLING:
            log.pairs()
            is_measuring = True
        state = hold(0.0, pulse)[-1]
    pairs = log.pairs() if is_measuring else []
    t, x = edge_distances(pairs, files.metres_per_edge.value)
    if len(t) < MIN_EDGES:
        raise TooFewEdges(
            "too few edges while the car brakes", found=f"{len(t)} edges",
            expected=f"at least {MIN_EDGES}",
            likely="the wheels lock, or the ESC has no brake and reverses at once",
            remedy="a floor with grip, or a weaker brake in the settings of the ESC")
    bend, speed, _ = np.polyfit(t - t.mean(), x, 2)
    return float(speed), float(-2.0 * bend)


def fit_brake(parts: Sequence[float], runs: Sequence[tuple[float, float]], files: CarFiles
              ) -> tuple[Quantity, str]:
    """Fit what the full brake adds to the deceleration; return it with a note.

    parts (n,): of the full brake; runs (n,): mean speeds [m/s], decelerations [m/s2]. The Quantity
    [m/s2] is not negative; the note cautions if its interval contains 0: the ESC has no brake.
    """
    x: FloatArray = np.asarray(parts, dtype=float)
    speed, deceleration = np.asarray(runs, dtype=float).T
    friction = make_friction(PAPER.friction)
    slower: FloatArray = np.array([-friction(v) for v in speed]) / PAPER.body.mass
    # Relative to the mean, so that the rest of the line is all of the friction.
    slower -= slower.mean()
    y: FloatArray = deceleration - slower
    slope, offset = np.polyfit(x, y, 1)
    residual = y - offset - slope * x
    spread = math.sqrt(float(residual @ residual) / (len(x) - 2))
    # Student's interval of the slope, as the standard error that gives the same 90 % interval.
    std = STUDENT_95 / INTERVAL_90 * spread / math.sqrt(float(np.sum((x - x.mean()) ** 2)))
    metres = files.metres_per_edge
    std = math.hypot(std, FRICTION_STD * float(np.polyfit(x, slower, 1)[0]),
                     float(slope) * metres.std / metres.value)
    note = (f"friction while braking {offset:.2f} m/s2; the full brake is extrapolated from "
            f"{max(parts):g} of it")
    if slope < INTERVAL_90 * std:
        note = (f"caution: no brake was found ({slope:.2f} +- {std:.2f} m/s2 of the full pulse "
                "below neutral): check the setting of the ESC")
    return Quantity(max(float(slope), 0.0), std, f"{len(x)} times from straight driving"), note
