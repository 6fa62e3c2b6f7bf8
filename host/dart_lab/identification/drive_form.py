"""What the throttle of recordings and models is: a duty cycle, or the speed of a speed loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

import msgspec
import numpy as np

from dart_hal.core.config import ModelFile
from dart_hal.core.errors import RecordingError, UsageError
from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Recording
from dart_hal.recording.dart.marker import marker_grid
from dart_hal.vehicle.load import vehicle_of
from dart_hal.vehicle.motor import make_drive
from dart_hal.vehicle.namespace import ARRAY
from dart_hal.vehicle.parameters import SpeedLoop, Vehicle, scaled_bounds

DRIVES = {"duty": "a duty cycle -1..1", "speed": "a commanded speed [m/s]"}
WINDOW = 100  # samples of a window of the start values: 1 s
RATES = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)  # 1/s; gain over mass
ACCELERATIONS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)  # m/s2; max_force over mass
EQUAL = 0.05  # of the smallest error: pairs of start values that differ by less are equally good


def drive_of(recordings: Sequence[Recording]) -> str:
    """Return the common drive of recordings, "duty" or "speed".

    Raises UsageError for a mixture, or a drive that no model has.
    """
    found = sorted({r.drive for r in recordings})
    unknown = [drive for drive in found if drive not in DRIVES]
    if unknown or len(found) > 1:
        raise UsageError(
            "these recordings do not have one form of drive", found=", ".join(found),
            expected=" or ".join(DRIVES),
            remedy="use recordings of duty commands and of speed commands in separate calls")
    return found[0] if found else "duty"


def check_drive(recordings: Sequence[Recording], p: Vehicle) -> None:
    """Refuse recordings whose throttle is not what the model takes. Raises UsageError."""
    drive = drive_of(recordings)
    if recordings and drive != p.drive:
        raise UsageError(
            f"the throttle of these recordings is {DRIVES[drive]}, but the model {p.name} takes "
            f"{DRIVES[p.drive]}",
            found=f"drive \"{drive}\" in {recordings[0].name}, forms.motor = \"{p.drive}\" in "
                  "the model",
            expected=f"a model with forms.motor = \"{drive}\"",
            remedy="dart-hal identify all --joint FILES fits a model of the recordings' form"
                   if drive == "speed" else "use a model with a motor of d, e and g, such as paper")


def check_duty(recordings: Sequence[Recording], base: Vehicle, submodels: Sequence[str]) -> None:
    """Refuse sub-models that need a duty cycle. Raises UsageError.

    They take the friction from coasting at throttle 0, where a speed loop brakes.
    """
    needed = [name for name in submodels if name in ("friction", "motor", "delay")]
    if not needed or (drive_of(recordings) == "duty" and base.drive == "duty"):
        return
    raise UsageError(
        f"{', '.join(needed)} cannot be fitted one by one with a speed loop",
        found=f"drive \"{drive_of(recordings)}\" of the recordings, forms.motor = "
              f"\"{base.drive}\" of {base.name}",
        expected="recordings and base model of duty",
        remedy="dart-hal identify all --joint FILES fits gain and max_force with all the rest")


def with_drive_of(base: ModelFile, recordings: Sequence[Recording],
                  submodels: Sequence[str]) -> ModelFile:
    """Return the base with the motor form of the recordings, as the start of a joint fit.

    A duty base gets a speed loop with start values of the recordings if the motor is fitted; body,
    tyres and all else stay. Raises UsageError for any other difference.
    """
    p = vehicle_of(base)
    if not (p.drive == "duty" and drive_of(recordings) == "speed" and "motor" in submodels):
        check_drive(recordings, p)
        return base
    loop = estimate_speed_loop(recordings, p)
    covariance = {name: table for name, table in base.covariance.items()
                  if not any(n.startswith("motor.") for n in table.names)}
    return msgspec.structs.replace(
        base, forms={**base.forms, "motor": "speed"}, covariance=covariance,
        motor={"gain": loop.gain, "max_force": loop.max_force})


def estimate_speed_loop(recordings: Sequence[Recording], p: Vehicle) -> SpeedLoop:
    """Estimate gain and max_force roughly: start values of a fit, within their bounds.

    1. Take windows of 1 s of the marker's speed and of the commanded speed.
    2. Simulate the speed alone, m v' = force + friction, for each pair of RATES and ACCELERATIONS.
    3. Of the pairs whose mean error at the ends of the windows is within 5 % of the smallest,
       return the geometric mean: the centre of what the recordings admit.
    """
    parts = [np.empty((2, WINDOW, 0)), *(_speed_windows(r) for r in recordings if r.mocap)]
    speed, command = np.concatenate(parts, axis=2)
    pairs = p.body.mass * np.array([(rate, a) for rate in RATES for a in ACCELERATIONS])
    errors = np.array([np.mean(np.abs(_simulate(_within_bounds(pair, p), p, speed[0], command)
                                      - speed[-1])) if speed.size else 0.0 for pair in pairs])
    best = pairs[errors <= (1.0 + EQUAL) * errors.min()]
    return _within_bounds(np.exp(np.log(best).mean(axis=0)), p)


def _within_bounds(pair: FloatArray, p: Vehicle) -> SpeedLoop:
    """Return a loop of (gain, max_force), clipped to the bounds of a car of this mass."""
    limits = [scaled_bounds(f.metadata, p.body.mass) for f in fields(SpeedLoop)]
    gain, max_force = (float(np.clip(number, *limit))
                       for number, limit in zip(pair, limits, strict=True))
    return SpeedLoop(gain, max_force)


def _simulate(loop: SpeedLoop, p: Vehicle, speed: FloatArray, command: FloatArray) -> FloatArray:
    """Return speeds (n,) at the end of windows from speeds (n,) and commands (WINDOW, n)."""
    drive = make_drive(loop, p.friction, ARRAY)
    v = speed
    for u in command[:-1]:
        v = v + SAMPLE / p.body.mass * drive(u, v)
    return v


def _speed_windows(recording: Recording) -> FloatArray:
    """Return speed and commanded speed [m/s] of windows, (2, WINDOW, n)."""
    try:
        m = marker_grid(recording)
    except RecordingError:
        return np.empty((2, WINDOW, 0))
    series = np.stack([np.hypot(m.dx, m.dy), m.throttle])
    bad = np.concatenate([[0], np.cumsum(m.bad)])
    first = np.arange(0, max(len(m.bad) - WINDOW, 0), WINDOW // 4)
    first = first[bad[first + WINDOW] == bad[first]]
    return np.asarray(series[:, first + np.arange(WINDOW)[:, None]])
