"""Results of procedures, for a terminal, as JSON, and for calibration.toml."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol

import msgspec
import numpy as np

from dart_hal.core.config import Calibration, PaperForm, Quantity, SteeringTable
from dart_hal.core.config.calibration import SteeringCalibration
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.types import Estimate, FloatArray

# Rows of a map on a terminal, so that the result fits on the screen.
MAX_MAP_ROWS = 13


@dataclass(frozen=True, slots=True)
class Summary:
    """A result for a terminal: a table, then lines. Lines with an indent are notes."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[str, ...]


class Result(Protocol):
    """Result of a procedure on one car, a frozen dataclass.

    verb: the procedure's name. duration [s] of the car's time. written: the file, None if nothing
    is written yet. unwritten: why it cannot be written, empty if it can.
    """

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def verb(self) -> str: ...
    @property
    def duration(self) -> float: ...
    @property
    def written(self) -> str | None: ...
    @property
    def unwritten(self) -> str: ...

    def to_json(self) -> dict[str, Any]:
        """The JSON object of ``dart-hal calibrate NAME --json``."""

    def summary(self) -> Summary:
        """Summary for a terminal."""

    def put_into(self, calibration: Calibration) -> Calibration:
        """Return the calibration with the measured values."""

    def provenance(self) -> dict[str, Any]:
        """Origin of the values, written to calibration.toml with the date."""


@dataclass(frozen=True, slots=True)
class SteeringResult:
    """A steering map with standard errors, its paper form, and the backlash.

    command (k,) -1..1 increasing, angle (k,) [rad] increasing: middle of the backlash loop.
    angle_std (k,) [rad]; covariance (k, k) [rad2] or None. pulse_us (k,) or None (recordings other
    than own runs have no pulses). paper_form by name. residual_rms [rad]. backlash [rad]: width of
    the loop, None if not measured. n: samples used. duration [s] of driving. source: URL or list of
    files. samples: fitted (command, angle, direction), for the plot.
    For a terminal: brief, the notes with those of files merged by kind (empty: the notes); dropped,
    the excluded samples; unwritten, why nothing is written. The notes contain all of it.
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

    @property
    def verb(self) -> str:
        """The procedure's name."""
        return "steering"

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

    def summary(self) -> Summary:
        """Some rows of the map, the notes and the fit."""
        chosen = select_rows(len(self.command))
        some = "" if len(chosen) == len(self.command) else (
            f", {len(chosen)} of {len(self.command)} points (--json has all)")
        rows = tuple((f"{self.command[i]:+.3f}",
                      "-" if self.pulse_us is None else f"{self.pulse_us[i]:.1f} us",
                      f"{self.angle[i]:+.4f} rad", f"{self.angle_std[i]:.4f} rad") for i in chosen)
        form = ", ".join(f"{name} {value:.4f}" for name, value in self.paper_form.items())
        backlash = self.backlash
        return Summary(
            f"steering map of {self.car}{some}", ("command", "pulse", "angle", "one sigma"), rows,
            (*indent(self.brief or self.notes), f"five-parameter form: {form}",
             "backlash: not known from these data" if backlash is None else
             f"backlash {backlash.value:.4f} +- {backlash.std:.4f} rad",
             f"residual {self.residual_rms:.5f} rad rms over {self.n} samples",
             *([self.dropped] if self.dropped else [])))

    def put_into(self, calibration: Calibration) -> Calibration:
        """Add map, paper form and backlash. Raises CalibrationFailed for a map of commands."""
        if self.pulse_us is None:
            raise CalibrationFailed("a map without pulses cannot be written",
                                    likely="it was fitted to recordings, which contain only "
                                           "commands",
                                    remedy="run the procedure on the car")
        # With [steering] direction = -1 the pulses fall; in the file they rise.
        order = np.argsort(self.pulse_us)
        table = SteeringTable(pulse_us=tuple(round(float(v), 3) for v in self.pulse_us[order]),
                              angle_rad=tuple(round(float(v), 6) for v in self.angle[order]),
                              std_rad=tuple(round(float(v), 6) for v in self.angle_std[order]))
        form = PaperForm(**{k: round(v, 6) for k, v in self.paper_form.items()})
        backlash = None if self.backlash is None else Quantity(
            self.backlash.value, self.backlash.std, "difference of the two approaches")
        return msgspec.structs.replace(calibration, steering=SteeringCalibration(
            map=table, paper_form=form, backlash=backlash,
            slew_us_s=calibration.steering.slew_us_s, residual_rms_rad=self.residual_rms))

    def provenance(self) -> dict[str, Any]:
        """Source, samples and driving time [s]."""
        return {"source": str(self.source), "n": self.n, "duration_s": round(self.duration, 2)}


def select_rows(points: int) -> list[int]:
    """Select at most MAX_MAP_ROWS indices of 0..points-1, evenly if possible, with both ends."""
    last = points - 1
    least = max(1, -(-last // (MAX_MAP_ROWS - 1)))
    even = [step for step in range(least, 2 * least + 1) if last % step == 0]
    if even:
        return list(range(0, points, even[0]))
    return sorted({round(i * last / (MAX_MAP_ROWS - 1)) for i in range(MAX_MAP_ROWS)})


def indent(notes: Sequence[str]) -> tuple[str, ...]:
    """Notes as lines of a summary."""
    return tuple(f"  {note}" for note in notes)


def number(value: float) -> float | None:
    """Convert to float; None for NaN and infinity, which JSON does not have."""
    return float(value) if math.isfinite(value) else None


def numbers(values: FloatArray) -> list[float | None]:
    return [number(v) for v in values.tolist()]
