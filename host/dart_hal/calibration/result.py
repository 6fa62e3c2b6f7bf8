"""What ``calibrate steering`` measured, in the shape that machines read."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from dart_hal.core.types import Estimate, FloatArray


@dataclass(frozen=True, slots=True)
class SteeringResult:
    """A steering map with standard errors, its paper form, and the backlash.

    command (k,) -1..1 increasing, angle (k,) rad increasing: middle of the
    backlash loop; angle_std (k,) rad; covariance (k, k) rad2 or None; pulse_us
    (k,) or None (only our own runs hold pulses); paper_form by name; residual_rms
    rad; backlash rad: width of the loop, None when the data cannot tell.
    n samples used; duration s of driving; source: URL or list of files.
    ``samples``: (command, angle, direction) of what was fitted, for the plot.
    For a terminal: ``brief``, the notes with those of files grouped by kind
    (empty: the notes); ``dropped``, what was not used; ``unwritten``, why
    nothing is written. The notes hold all of it.
    """

    car: str
    source: str | tuple[str, ...]
    n: int
    duration: float
    command: FloatArray
    angle: FloatArray
    angle_std: FloatArray
    pulse_us: FloatArray | None
    paper_form: dict[str, float]
    residual_rms: float
    backlash: Estimate | None
    written: str | None = None
    notes: tuple[str, ...] = ()
    covariance: FloatArray | None = None
    samples: tuple[FloatArray, FloatArray, FloatArray] | None = field(default=None, repr=False)
    extra: dict[str, Any] = field(default_factory=dict)
    brief: tuple[str, ...] = ()
    dropped: str = ""
    unwritten: str = ""

    def to_json(self) -> dict[str, Any]:
        """The JSON object of ``calibrate steering``; plain types, null for what is not known."""
        backlash = self.backlash
        return {
            "car": self.car,
            "source": self.source if isinstance(self.source, str) else list(self.source),
            "n": self.n,
            "duration_s": number(self.duration),
            "map": {
                "command": numbers(self.command),
                "pulse_us": None if self.pulse_us is None else numbers(self.pulse_us),
                "angle_rad": numbers(self.angle),
                "angle_std_rad": numbers(self.angle_std),
            },
            "paper_form": {k: number(v) for k, v in self.paper_form.items()},
            "residual_rms_rad": number(self.residual_rms),
            "backlash_rad": {"value": None if backlash is None else number(backlash.value),
                             "std": None if backlash is None else number(backlash.std)},
            "written": self.written,
            "notes": list(self.notes),
            **self.extra,
        }


def number(value: float) -> float | None:
    """JSON has no NaN: null instead."""
    return float(value) if math.isfinite(value) else None


def numbers(values: FloatArray) -> list[float | None]:
    return [number(v) for v in values.tolist()]
