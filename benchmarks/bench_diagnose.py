"""Time of a whole diagnosis, from the command line: start, reading, search, gains.

A minute takes one core; many recordings take all there are.

    python benchmarks/bench_diagnose.py
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from bench_evaluate import EXCERPT, folder
from figures import Figure

from dart_hal.core.process.jobs import cores

MINUTE = ("91_free_driving_16_sept_2024",)
"""One recording of about a minute; its end is held out."""
DAYS = (("80_", "81_throttle", "steering_identification_25", "circles_27_sept_2024_fast"),
        ("91_free", "60_racetrack"))
"""Folders to learn from, and other days to judge by."""

COMPILED = {**{k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"},
            "PYTHONPYCACHEPREFIX": str(Path(tempfile.gettempdir()) / "dart-hal-bench-pyc")}
"""As an installed package runs: its modules are compiled once, not at every start."""


def run_diagnosis(*arguments: str) -> tuple[dict[str, Any], float, float]:
    """(answer of ``dart-hal diagnose``, CPU time [s], time [s])."""
    began, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
    run = subprocess.run([sys.executable, "-m", "dart_hal.cli.main", "diagnose", "--model", "paper",
                          *arguments, "--json"], check=True, capture_output=True, text=True,
                         env=COMPILED)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    answer: dict[str, Any] = json.loads(run.stdout)
    return (answer, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
            time.monotonic() - began)


def figures(scale: float = 1.0) -> list[Figure]:
    """CPU time for a minute and for many minutes, and the error on days left out."""
    root = folder()
    one = next(iter(sorted((root / MINUTE[0]).iterdir())))
    run_diagnosis("--train", str(one), "--no-refit")  # compiles what is not there yet
    out = []
    for title, extra, high in (("as it is", ("--no-refit",), 5.0), ("refitted first", (), None)):
        answer, cpu, _ = run_diagnosis("--train", str(one), *extra)
        out.append(Figure(f"diagnose: a minute of recording, {title}, CPU", cpu, "s", high=high,
                          note=f"{answer['verdict']}, {len(answer['causes'])} cause(s)"))
    if root != EXCERPT and scale >= 1.0:
        out += days(root)
    return out


def days(root: Path) -> list[Figure]:
    """Everything of some days against others."""
    train, test = ([str(f) for f in sorted(root.iterdir()) if f.name.startswith(part)]
                   for part in DAYS)
    answer, cpu, took = run_diagnosis("--train", *train, "--test", *test)
    pooled = answer["extended"]["errors"]["1.0"]["pooled"]
    note = ", ".join(c["effect"] for c in answer["causes"])
    return [Figure(f"diagnose: eleven recordings, on {cores()} core(s)", took, "s", high=180.0,
                   note=f"{cpu:.0f} s of CPU; {note}"),
            *(Figure(f"diagnose: {channel} at 1 s on days left out", pooled[channel], unit,
                     note=f"CTRV {answer['ctrv']['1.0']['pooled'][channel]:.3g}, paper "
                          f"{answer['base']['errors']['1.0']['pooled'][channel]:.3g}")
              for channel, unit in (("vx", "m/s"), ("yaw_rate", "rad/s"), ("position", "m"),
                                    ("yaw_deg", "deg")))]


if __name__ == "__main__":
    for f in figures():
        print(f"{f.name:58} {f.measured:>12}  {f.target:>8}  {f.note}")
