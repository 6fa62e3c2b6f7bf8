"""Pulses of our own runs: each holds the car.toml whose centre and span made them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from dart_hal.core.config import parse_config
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import RUN, Recording
from dart_hal.recording.run import RunReader


@dataclass(frozen=True, slots=True)
class Servo:
    """car: its name if all runs are of one; pulse: command (n,) -> us, None if not
    known; wheelbase [m] of that car."""

    car: str | None = None
    pulse: Callable[[FloatArray], FloatArray] | None = None
    wheelbase: float | None = None
    notes: tuple[str, ...] = ()


def servo_of(recordings: Sequence[Recording]) -> Servo:
    """What the car.toml in the runs says; nothing unless all recordings are runs.

    Errors: RecordingError, ConfigError for a run whose car.toml cannot be read.
    """
    if any(r.schema != RUN for r in recordings):
        return Servo()
    texts = [RunReader(r.path).files.get("car.toml") for r in recordings]
    configs = [parse_config(text, f"car.toml in {r.path}", recorded=True)
               for r, text in zip(recordings, texts, strict=True) if text]
    if len(configs) < len(recordings):
        return Servo(notes=("no pulses: a run holds no car.toml",))
    names = sorted({c.name for c in configs})
    if len(names) > 1:
        return Servo(notes=(f"caution: one map out of runs of several cars: {', '.join(names)}",))
    if len({(c.steering.center_us, c.steering.span_us, c.steering.direction)
            for c in configs}) > 1:
        return Servo(names[0], wheelbase=configs[0].geometry.wheelbase,
                     notes=("no pulses: [steering] center_us, span_us or direction changed "
                            "between the runs",))
    steering = configs[0].steering
    centre, span = steering.center_us, steering.direction * steering.span_us

    def pulse(command: FloatArray) -> FloatArray:
        return centre + span * command

    return Servo(names[0], pulse, configs[0].geometry.wheelbase)
