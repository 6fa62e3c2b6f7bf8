"""What is on the page of a car, and what its answer for machines is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from dart_hal.car.digest import Digest
from dart_hal.core.config import CarFiles
from dart_hal.core.config.calibration import QUANTITIES
from dart_hal.core.config.history import ValueChange
from dart_hal.core.config.quantity import Quantities, Quantity
from dart_hal.core.types import INTERVAL_90
from dart_lab.report import charts, page
from dart_lab.report.html import Html, el, join, table
from dart_lab.report.numbers import significant

VERBS = {"pwm": "clock", "throttle": "esc", "steering": "steering", "encoder": "encoder",
         "imu": "imu", "latency": "latency", "mocap": "mocap", "lidar": "lidar",
         "steering.slew_us_s": "latency"}
"""Of ``dart-hal calibrate``, by table of calibration.toml, or by name."""
SELDOM = "latency.pulse_to_yaw_lag"
"""Shows where it is long alone, so that nobody is asked for it."""
CLEAR = 3.0  # common standard errors: a change that is no chance


def verb_of(name: str) -> str:
    """Of ``dart-hal calibrate``, that measures a quantity "table.key"."""
    return VERBS.get(name) or VERBS[name.partition(".")[0]]


@dataclass(frozen=True, slots=True)
class About:
    """A car: its files, digests of its runs (newest first), and what changed in its files."""

    files: CarFiles
    runs: Sequence[Digest]
    calibration: Sequence[ValueChange]
    model: Sequence[ValueChange]
    now: datetime

    def missing(self) -> list[str]:
        """What a verb measures and was never measured on this car; of a motion capture and a lidar,
        which not all have, only where some is."""
        have = self.files.calibration.quantities() if self.files.calibration else {}
        absent = {verb for verb in ("mocap", "lidar") if verb not in map(verb_of, have)}
        out = [name for name in QUANTITIES if name not in have and name != SELDOM
               and verb_of(name) not in absent]
        mapped = self.files.calibration is not None and self.files.calibration.steering.map
        return out if mapped else ["steering.map", *out]

    def to_do(self) -> list[str]:
        """What stands out, and what to type; nothing where all is well."""
        verbs = dict.fromkeys(map(verb_of, self.missing()))
        out = [f"never measured: {', '.join(n for n in self.missing() if verb_of(n) == verb)}; "
               f"dart-hal calibrate {verb}" for verb in verbs]
        if self.files.calibration is not None:
            out += [f"{name}: dart-hal calibrate all" for name in
                    self.files.calibration.warnings(self.now)]
        out += [f"{c.name} moved by {c.z:.1f} standard errors since the version before"
                for c in (*self.calibration, *self.model) if c.z > CLEAR]
        for run in self.runs:
            if run.lost or run.damaged:
                out.append(f"{run.path}: {run.lost} frames lost, {run.damaged} damaged")
            out += [f"{run.path}: {name} for {seconds:.1f} s" for name, seconds
                    in run.doubts.items()]
        return out

    def changed(self) -> list[str]:
        """What differs between the last two runs, in words."""
        if len(self.runs) < 2:
            return []
        new, old = self.runs[:2]
        out = [f"{name}: {'changed' if name in old.files and name in new.files else 'came or went'}"
               for name in sorted(old.files.keys() | new.files.keys())
               if old.files.get(name) != new.files.get(name)]
        if old.firmware != new.firmware:
            out.append(f"firmware: {old.firmware} -> {new.firmware}")
        return out

    def to_json(self, written: Path) -> dict[str, Any]:
        """The object of ``dart-hal report --json``."""
        found = self.files.calibration.quantities() if self.files.calibration else {}
        return {"car": self.files.config.name, "page": written,
                "calibrations": {name: {"value": q.value, "std": q.std, "method": q.method}
                                 for name, q in found.items()},
                "measured": self._when(), "missing": self.missing(),
                "runs": [run.to_json() for run in self.runs],
                "changed": [{"name": c.name, "before": c.before, "now": c.now, "z": c.z}
                            for c in (*self.calibration, *self.model)],
                "changed_runs": self.changed(), "to_do": self.to_do()}

    def _when(self) -> str | None:
        when = (self.files.calibration.provenance.get("when")
                if self.files.calibration is not None else None)
        return when.isoformat() if isinstance(when, datetime) else None


def write_page(about: About, path: Path, answer: dict[str, Any]) -> Path:
    """Write the page. Errors: OSError."""
    todo = about.to_do()
    lead = "Nothing stands out." if not todo else "What stands out:"
    card = page.card(el("p", lead, class_="big"), page.items(todo), good=not todo)
    changes = [(c.name, _number(c.before), _number(c.now),
                "-" if math.isnan(c.z) else f"{c.z:.1f}")
               for c in (*about.calibration, *about.model)]
    sections = {
        "calibration": ("Calibrations", _calibration(about)),
        "runs": (f"Last runs ({len(about.runs)})", _runs(about.runs)),
        "changed": ("What changed", join([
            table(("number", "before", "now", "standard errors apart"), changes, 1),
            page.items(f"between the last two runs: {line}" for line in about.changed())])
            if changes or about.changed() else el("p", "Nothing, as far as is recorded.")),
        "numbers": ("All numbers", page.download(answer, "report.json"))}
    name = about.files.config.name
    return page.write(path, page.page(f"report of {name}", f"The car {name}", card, sections))


def _calibration(about: About) -> Html:
    found = about.files.calibration
    if found is None:
        return el("p", f"{about.files.folder}/calibration.toml is not there: nothing was measured.")
    rows = [(name, *_interval(q), q.method or "-") for name, q in found.quantities().items()]
    when = found.provenance.get("when")
    age = ""
    if isinstance(when, datetime):
        aware = when if when.tzinfo else when.replace(tzinfo=timezone.utc)
        age = f"Last written {aware:%d %B %Y}, {(about.now - aware).days} days ago. "
    return join([el("p", f"{age}File: {about.files.folder}/calibration.toml."), _map(about),
                 table(("quantity", "value", "90 % interval", "how it was measured"), rows, 1)])


def _map(about: About) -> Html:
    """The steering map with its 90 % interval."""
    found = about.files.calibration.steering.map if about.files.calibration else None
    if found is None:
        return Html()
    angle, reach = np.degrees(found.angle_rad), INTERVAL_90 * np.degrees(found.std_rad)
    return page.figure("Steering map, 90 % interval", charts.lines(
        "steering map", "pulse [us]", "road-wheel angle [deg]",
        [charts.Series(np.array(found.pulse_us), angle, reach, "after")]))


def _interval(q: Quantity | Quantities) -> tuple[str, str]:
    if isinstance(q, Quantity):
        return significant(q.value, 5), f"+- {significant(INTERVAL_90 * q.std, 2)}"
    return f"{len(q.value)} values", "-"


def _runs(runs: Sequence[Digest]) -> Html:
    if not runs:
        return el("p", "None was given, and there is no folder runs here.")
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
