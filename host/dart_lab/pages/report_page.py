"""HTML page and JSON object of ``dart-hal report``: one car."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from dart_hal.calibration.measured import unit_of
from dart_hal.car.digest import Digest
from dart_hal.core.config import CarFiles
from dart_hal.core.config.calibration import QUANTITIES
from dart_hal.core.config.history import ValueChange
from dart_hal.core.config.quantity import Quantities, Quantity
from dart_hal.core.types import INTERVAL_90
from dart_lab.report import charts, page
from dart_lab.report.html import Html, el, join, table
from dart_lab.report.numbers import significant, with_error

# Verb of ``dart-hal calibrate`` by table of calibration.toml, or by the name of a quantity.
CALIBRATION_VERBS = {
    "pwm": "clock", "throttle": "esc", "steering": "steering", "encoder": "encoder", "imu": "imu",
    "latency": "latency", "mocap": "mocap", "lidar": "lidar", "steering.slew_us_s": "latency"}
# This lag can only be measured if it is long; a car without a value is complete.
OPTIONAL_QUANTITY = "latency.pulse_to_yaw_lag"
# Joint standard errors above which a change is reported: by chance in 0.3 % of repeats.
MIN_CHANGE_Z = 3.0


def verb_of(name: str) -> str:
    """Return the verb of ``dart-hal calibrate`` that measures a quantity "table.key"."""
    return CALIBRATION_VERBS.get(name) or CALIBRATION_VERBS[name.partition(".")[0]]


@dataclass(frozen=True, slots=True)
class CarReport:
    """A car: its files, digests of its runs (newest first), and what changed in its files."""

    files: CarFiles
    runs: Sequence[Digest]
    calibration: Sequence[ValueChange]
    model: Sequence[ValueChange]
    now: datetime

    def missing(self) -> list[str]:
        """List the quantities that were never measured on this car.

        Those of a motion capture or a lidar are listed only if another of them was measured: not
        every car has these.
        """
        have = self.files.calibration.quantities() if self.files.calibration else {}
        absent = {verb for verb in ("mocap", "lidar") if verb not in map(verb_of, have)}
        out = [name for name in QUANTITIES if name not in have and name != OPTIONAL_QUANTITY
               and verb_of(name) not in absent]
        steering_map = (self.files.calibration is not None
                        and self.files.calibration.steering.map)
        return out if steering_map else ["steering.map", *out]

    def to_do(self) -> list[str]:
        """List what needs attention, with the commands; empty if nothing does."""
        verbs = dict.fromkeys(map(verb_of, self.missing()))
        out = [f"never measured: {', '.join(n for n in self.missing() if verb_of(n) == verb)}; "
               f"dart-hal calibrate {verb}" for verb in verbs]
        if self.files.calibration is not None:
            out += [f"{name}: dart-hal calibrate all" for name in
                    self.files.calibration.warnings(self.now)]
        out += [f"{c.name} moved by {c.z:.1f} standard errors since the version before"
                for c in (*self.calibration, *self.model) if c.z > MIN_CHANGE_Z]
        for run in self.runs:
            if run.lost or run.damaged:
                out.append(f"{run.path}: {run.lost} frames lost, {run.damaged} damaged")
            out += [f"{run.path}: {name} for {seconds:.1f} s" for name, seconds
                    in run.doubts.items()]
        return out

    def describe(self) -> tuple[str, str]:
        """Return the verdict on the car, and a line about its runs."""
        have = len(self.files.calibration.quantities()) if self.files.calibration else 0
        missing = len(self.missing())
        moved = sum(c.z > MIN_CHANGE_Z for c in (*self.calibration, *self.model))
        verdict = (f"{self.files.config.name}: {have} quantities are measured, {missing} are not, "
                   f"{moved} changed by more than {MIN_CHANGE_Z:.0f} standard errors.")
        lost = sum(run.lost + run.damaged for run in self.runs)
        driven = (f"runs: {len(self.runs)}, {significant(sum(r.duration for r in self.runs))} s, "
                  f"{significant(sum(r.distance for r in self.runs))} m, {lost} frames lost or "
                  "damaged")
        return verdict, driven if self.runs else "runs: none"

    def list_run_changes(self) -> list[str]:
        """Describe how files and firmware differ between the last two runs."""
        if len(self.runs) < 2:
            return []
        new, old = self.runs[:2]
        # Files by checksum: another checksum is a change, a name in one run only an addition or
        # removal.
        common = old.files.keys() & new.files.keys()
        out = [f"{name}: {'changed' if name in common else 'added or removed'}"
               for name in sorted(old.files.keys() | new.files.keys())
               if old.files.get(name) != new.files.get(name)]
        if old.firmware != new.firmware:
            out.append(f"firmware: {old.firmware} -> {new.firmware}")
        return out

    def to_json(self, written: Path) -> dict[str, Any]:
        """Return the object of ``dart-hal report --json``."""
        found = self.files.calibration.quantities() if self.files.calibration else {}
        return {"car": self.files.config.name, "page": written,
                "calibrations": {name: {"value": q.value, "std": q.std, "method": q.method}
                                 for name, q in found.items()},
                "measured": self._calibrated_at(), "missing": self.missing(),
                "runs": [run.to_json() for run in self.runs],
                "changed": [{"name": c.name, "before": c.before, "now": c.now, "z": c.z}
                            for c in (*self.calibration, *self.model)],
                "changed_runs": self.list_run_changes(), "to_do": self.to_do()}

    def _calibrated_at(self) -> str | None:
        when = (self.files.calibration.provenance.get("when")
                if self.files.calibration is not None else None)
        return when.isoformat() if isinstance(when, datetime) else None


def write_page(report: CarReport, path: Path, answer: dict[str, Any]) -> Path:
    """Write the page. Errors: OSError."""
    todo = report.to_do()
    lead = "Nothing needs attention." if not todo else "What needs attention:"
    card = page.card(el("p", lead, class_="big"), page.items(todo), good=not todo)
    # The picture first; it has no place next to the list on a phone, where both are stacked.
    steering_map = _map(report)
    top = el("div", steering_map, card, class_="pair") if steering_map else card
    # z, the difference over its standard error, is unknown where a value has no standard error.
    changes = [(c.name, _number(c.before), _number(c.now),
                "-" if math.isnan(c.z) else f"{c.z:.1f}")
               for c in (*report.calibration, *report.model)]
    sections = {
        "calibration": ("Calibrations", _calibration(report)),
        "runs": (f"Last runs ({len(report.runs)})", _runs(report.runs)),
        "changed": ("What changed", join([
            table(("number", "before", "now", "difference [standard errors]"), changes, 1),
            page.items(f"between the last two runs: {line}" for line in report.list_run_changes())])
            if changes or report.list_run_changes() else el("p", "No change is recorded.")),
        "numbers": ("All numbers", page.download(answer, "report.json"))}
    name = report.files.config.name
    return page.write(path, page.page(f"report of {name}", f"The car {name}", top, sections))


def _calibration(report: CarReport) -> Html:
    found = report.files.calibration
    if found is None:
        return el("p", f"{report.files.folder}/calibration.toml does not exist: nothing was "
                       "measured.")
    rows = [(name, _interval(name, q), q.method or "-")
            for name, q in found.quantities().items()]
    when = found.provenance.get("when")
    age = ""
    if isinstance(when, datetime):
        aware = when if when.tzinfo else when.replace(tzinfo=timezone.utc)
        age = f"Last written {aware:%d %B %Y}, {(report.now - aware).days} days ago. "
    return join([el("p", f"{age}File: {report.files.folder}/calibration.toml."),
                 table(("quantity", "value, 90 % interval", "how it was measured"), rows, 1)])


def _map(report: CarReport) -> Html:
    """Draw the steering map with its 90 % interval."""
    found = report.files.calibration.steering.map if report.files.calibration else None
    if found is None:
        return Html()
    angle = np.degrees(found.angle_rad)
    half_width = INTERVAL_90 * np.degrees(found.std_rad)
    return page.figure("Steering map, 90 % interval", charts.draw_lines(
        "steering map", "pulse [us]", "road-wheel angle [deg]",
        [charts.Series(np.array(found.pulse_us), angle, half_width, "after")]))


def _interval(name: str, q: Quantity | Quantities) -> str:
    """Return the value with the half-width of its interval and its unit."""
    if isinstance(q, Quantity):
        return with_error(q.value, INTERVAL_90 * q.std) + unit_of(name)
    return f"{len(q.value)} values"


def _runs(runs: Sequence[Digest]) -> Html:
    if not runs:
        return el("p", "No run was given, and there is no folder ./runs.")
    rows = [(r.path, r.when.replace("T", " ")[:16], f"{r.duration:.1f} s", f"{r.distance:.1f} m",
             f"{r.fastest:.2f} m/s", f"{r.lost} / {r.damaged}",
             "-" if math.isnan(r.period[0]) else " / ".join(f"{1e3 * p:.0f}" for p in r.period),
             ", ".join(f"{name} {s:.1f} s" for name, s in r.doubts.items()) or "-", r.firmware)
            for r in runs]
    return table(("run", "written", "lasts", "drove", "fastest", "lost / damaged",
                  "loop [ms]", "doubts", "firmware"), rows, 2,
                 "loop: time between commands of the program, median / 99 % / longest")


def _number(value: float | None) -> str:
    return "-" if value is None else significant(value, 5)
