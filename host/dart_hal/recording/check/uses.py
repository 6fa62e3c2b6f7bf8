"""Uses of a recording: rows that each fit of the vehicle model could use.

The limits are low on purpose: a recording above them can contribute, but need not suffice alone.
The fits estimate their own standard errors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray

from .facts import RecordingFacts
from .motion import MAX_SLIP_SHARE, MIN_MOVING_SPEED, START_SPEED, RecordedMotion

PURPOSES = ("friction", "motor", "steering", "delay", "tyres", "evaluation")
# Speeds [m/s] here are those of a car of 1:10.
MIN_ROLLING_SPEED = 0.1
MAX_STRAIGHT_STEERING = 0.2  # of full steering; more than that and cornering drag counts
# Speeds for the steering map [m/s]. At low speed the noise of the gyro dominates the angle
# atan(l W / v), so slow messages count only if there are too few fast ones.
MIN_STEERED_SPEED = 0.8
MIN_SLOW_STEERED_SPEED = 0.3
MIN_COASTING_MESSAGES = 10
# s of coasting, and of straight driving, that a fit needs in all its recordings together.
MIN_STRAIGHT_S = 3.0
MIN_DRIVEN_MESSAGES = 30
MIN_TURNED_MESSAGES = 50
MIN_CORNERED_SAMPLES = 300
# Requirements of the fit of the delay: samples, speed [m/s], steering changes and their spread.
MIN_DELAY_MESSAGES = 30
MIN_DELAY_SPEED = 0.3
MIN_STEERING_CHANGES = 3
MIN_STEERING_SPREAD = 0.03
# Commands that differ by less are one level.
COMMAND_LEVEL_STEP = 0.02
# Lateral acceleration [m/s2] above which tyre slip is measurable.
MIN_LATERAL_ACCELERATION = 1.0


@dataclass(frozen=True, slots=True)
class Use:
    """n usable ``unit``s ("messages", "samples" of 0.01 s, "windows"), and why."""

    good: bool
    n: int
    unit: str
    why: str


def uses(m: RecordedMotion, f: RecordingFacts) -> dict[str, Use]:
    """Return the use for each purpose, in the order of ``PURPOSES``."""
    a = m.recording.messages
    scale = m.recording.scale
    speed, source = _speed(m)
    relative = speed / scale.speed
    if m.mostly_bad:
        no = Use(False, 0, "messages", f"{1.0 - float(m.good.mean()):.0%} of the motion is marked "
                 "bad")
        return dict.fromkeys(PURPOSES, no)
    if m.slip >= MAX_SLIP_SHARE:
        no = Use(False, 0, "messages", "the wheels slip: their speed is not the car's")
        return {**dict.fromkeys(PURPOSES[:4], no), "tyres": _tyres(m),
                "evaluation": _evaluation(m, f)}
    straight = np.abs(a.steering) <= MAX_STRAIGHT_STEERING
    coast = straight & (a.throttle == 0.0) & (relative > MIN_ROLLING_SPEED)
    driven = straight & (a.throttle > 0.0) & (relative > MIN_MOVING_SPEED)
    turn = _turn_rate(m)
    enough = int((relative > MIN_STEERED_SPEED).sum()) >= MIN_TURNED_MESSAGES
    fast = relative > (MIN_STEERED_SPEED if enough else MIN_SLOW_STEERED_SPEED)
    steered = fast & np.isfinite(turn)
    return {
        "friction": _friction(coast, source, f.step),
        "motor": _motor(driven, a.throttle, source, f.step),
        "steering": _steering(steered, a.steering, source, f.step,
                              MIN_SLOW_STEERED_SPEED * scale.speed),
        "delay": _delay((relative > MIN_DELAY_SPEED) & np.isfinite(turn), a.steering,
                        MIN_DELAY_SPEED * scale.speed),
        "tyres": _tyres(m),
        "evaluation": _evaluation(m, f),
    }


def _speed(m: RecordedMotion) -> tuple[FloatArray, str]:
    """Return the speed at the messages (m,) and its sensor; zeros without a sensor."""
    a = m.recording.messages
    if m.recording.encoder in ("ok", "zero") and np.isfinite(a.speed).any():
        return np.nan_to_num(a.speed), "encoder"
    if m.grid is None:
        return np.zeros(len(a)), "none"
    return _at_messages(m, m.grid.v_x), "mocap"


def _turn_rate(m: RecordedMotion) -> FloatArray:
    a = m.recording.messages
    if np.isfinite(a.yaw_rate).any() or m.grid is None:
        return a.yaw_rate
    return _at_messages(m, m.grid.omega)


def _at_messages(m: RecordedMotion, values: FloatArray) -> FloatArray:
    """Interpolate grid values (n,) at the arrival of the messages (m,); bad ones count as 0."""
    assert m.grid is not None
    usable = np.where(m.grid.bad, 0.0, values)
    return np.asarray(np.interp(m.recording.messages.arrival, m.grid.t, usable))


def _friction(rows: BoolArray, source: str, step: float) -> Use:
    n = int(rows.sum())
    good = n >= MIN_COASTING_MESSAGES
    return Use(good, n, "messages", f"coasting straight{_shortfall(n, step)}, speed from the "
               f"{source}" if good else
               f"coasts straight for {_seconds(n, step)} only (speed: {source})")


def _motor(rows: BoolArray, throttle: FloatArray, source: str, step: float) -> Use:
    n = int(rows.sum())
    levels = _levels(throttle[rows])
    good = n >= MIN_DRIVEN_MESSAGES
    return Use(good, n, "messages", f"{levels} throttle level(s) driven straight"
               f"{_shortfall(n, step)}, speed from the {source}" if good else
               f"drives straight for {_seconds(n, step)} only")


def _steering(rows: BoolArray, steering: FloatArray, source: str, step: float, least: float
              ) -> Use:
    """Return the use for the steering map; least [m/s]: speed of the rows."""
    n = int(rows.sum())
    levels = _levels(steering[rows])
    if n < MIN_TURNED_MESSAGES:
        return Use(False, n, "messages",
                   f"above {least:.2g} m/s for {_seconds(n, step)} only")
    if levels < 3:
        return Use(False, n, "messages", f"{levels} steering level(s): a map needs several")
    left = bool((steering[rows] > 0.3).any())
    right = bool((steering[rows] < -0.3).any())
    side = ("both sides" if left and right else "left only" if left else "right only" if right
            else "near straight only")
    return Use(left or right, n, "messages", f"{levels} levels, {side}, speed from the {source}")


def _delay(rows: BoolArray, steering: FloatArray, least: float) -> Use:
    """Return the use for the delay; least [m/s]: speed of the rows."""
    n = int(rows.sum())
    driven = steering[rows]
    changes = int((np.diff(driven) != 0.0).sum())
    if n < MIN_DELAY_MESSAGES:
        return Use(False, n, "messages",
                   f"fewer than {MIN_DELAY_MESSAGES} messages above {least:.2g} m/s")
    if changes < MIN_STEERING_CHANGES or float(np.std(driven)) < MIN_STEERING_SPREAD:
        return Use(False, n, "messages", "the steering hardly changes while the car drives")
    return Use(True, n, "messages", f"{changes} steering changes above {least:.2g} m/s")


def _tyres(m: RecordedMotion) -> Use:
    if m.grid is None:
        return Use(False, 0, "samples", "no motion capture: side slip is not measured")
    if m.reference is None:
        return Use(False, 0, "samples", "the marker frame is not known")
    lateral = m.grid.v_x * m.grid.omega
    rows = m.good & (np.abs(lateral) > MIN_LATERAL_ACCELERATION)
    n = int(rows.sum())
    if n < MIN_CORNERED_SAMPLES:
        return Use(False, n, "samples",
                   f"cornering above {MIN_LATERAL_ACCELERATION:g} m/s2 for "
                   f"{_seconds(n, 0.01)} only")
    left = int((lateral[rows] > 0).sum())
    right = int((lateral[rows] < 0).sum())
    sides = ("both sides" if min(left, right) >= MIN_CORNERED_SAMPLES / 3 else
             f"{'left' if left > right else 'right'} only: D and C cannot be separated")
    most = float(np.percentile(np.abs(lateral[rows]), 99))
    return Use(True, n, "samples", f"up to {most:.1f} m/s2, {sides}")


def _evaluation(m: RecordedMotion, f: RecordingFacts) -> Use:
    if f.mocap is None:
        return Use(False, 0, "windows", "no motion capture to compare with")
    n = f.mocap.windows
    if m.reference is None:
        return Use(False, n, "windows", "the marker frame is not known")
    return Use(n > 0, n, "windows", "of 2 s" if n else
               f"no 2 s of clean driving above {START_SPEED * m.recording.scale.speed:.2g} m/s")


def _shortfall(n: int, step: float) -> str:
    """Return words for a recording that a fit cannot use alone, or ""."""
    return ("" if n * step >= MIN_STRAIGHT_S else f" for {_seconds(n, step)} (a fit needs "
            f"{MIN_STRAIGHT_S:.0f} s, of all its recordings together)")


def _seconds(n: int, step: float) -> str:
    return f"{n * step:.1f} s" if n else "0 s"


def _levels(values: FloatArray) -> int:
    """Count the levels of a command, in steps of COMMAND_LEVEL_STEP."""
    return len(np.unique(np.round(values / COMMAND_LEVEL_STEP))) if len(values) else 0
