"""Open-loop prediction: the published baselines again, and the CPU time of it.

    python benchmarks/bench_evaluate.py [--table]
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from baselines import MODELS, ROWS, Row, off
from figures import Figure, best_cpu

from dart_hal.car.runs import read_any
from dart_hal.core.types import FloatArray
from dart_hal.recording.check import folder_of
from dart_hal.vehicle.sets import PAPER, UPSTREAM_2024
from dart_lab.identification.evaluation import (
    CHANNELS,
    HORIZONS,
    Case,
    errors,
    kinematic,
    measured,
    predict,
    predict_ctrv,
    prepare,
)

HOME = Path(__file__).resolve().parents[1]
EXCERPT = HOME / "tests" / "recorded" / "data"
DEVIATION = 1.0
"""%; agreement to this shows that the evaluation is the same."""


def folder() -> Path:
    """The full set where it is present, else the excerpt: it holds some rows whole."""
    places = [os.environ.get("DART_DATA"), HOME.parent / "shared" / "data" / "dart", EXCERPT]
    return next(Path(p) for p in places if p and Path(p).is_dir())


class Baselines:
    """Errors of constant velocity and of models on the recordings of a folder."""

    def __init__(self, root: Path) -> None:
        found, _ = read_any([root])
        self.recordings = [r for r in found if r.mocap is not None]
        paths = {f"{folder_of(r.path)}/{r.path.name}": str(r.path) for r in self.recordings}
        self.cases: Sequence[Case] = prepare(self.recordings).cases
        self.paths = [paths[c.file] for c in self.cases for _ in range(len(c))]
        truth = measured(self.cases)
        self.errors = [errors(states, truth) for states in (
            predict_ctrv(self.cases), predict(kinematic(PAPER), self.cases),
            predict(PAPER, self.cases))]
        later = prepare(self.recordings, l_r=UPSTREAM_2024.body.l_r).cases
        self.upstream = errors(predict(UPSTREAM_2024, later), measured(later))

    def windows(self, row: Row) -> FloatArray:
        """(windows,): which of all windows belong to a row."""
        return np.array([any(part in path for part in row.parts) for path in self.paths])

    def rmse(self, e: FloatArray, row: Row) -> list[float]:
        """By channel, at the row's horizon."""
        part = e[HORIZONS.index(row.horizon)][:, self.windows(row)]
        return [float(v) for v in np.sqrt((part**2).mean(axis=1))]


def command_cpu(root: Path) -> float:
    """CPU time [s] of ``dart-hal evaluate``: start, imports, reading, prediction, intervals."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-m", "dart_hal.cli.main", "evaluate", "--model", "paper",
                    str(root), "--json"], check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def figures(scale: float = 1.0) -> list[Figure]:
    """Deviation from the published table by model, pooled errors, CPU times."""
    root, rounds = folder(), max(1, round(3 * scale))
    b = Baselines(root)
    whole = root != EXCERPT
    rows = [r for r in ROWS if whole or r.excerpt]
    out = [Figure("evaluate: windows of 2 s", len(b.paths), "", low=4724 if whole else None,
                  high=4724 if whole else None, note=f"{len(b.cases)} recordings")]
    for i, (name, e) in enumerate(zip(MODELS, b.errors, strict=True)):
        worst = max(off(b.rmse(e, r), r.printed[i]) for r in rows)
        pooled = next(r for r in ROWS if r.title == "all")
        out.append(Figure(f"evaluate: {name}, farthest from the published table", 100.0 * worst,
                          "%", high=DEVIATION, note=f"{len(rows)} rows; all at 1 s: "
                          + text(b.rmse(e, pooled))))
    pooled_upstream = b.rmse(b.upstream, next(r for r in ROWS if r.title == "all"))
    out.append(Figure("evaluate: upstream-2024, yaw rate at 1 s", pooled_upstream[2], "rad/s",
                      note=f"all at 1 s: {text(pooled_upstream)}"))
    work: Callable[[], object] = lambda: predict(PAPER, b.cases)  # noqa: E731
    out.append(Figure("evaluate: CPU of all windows, dynamic", best_cpu(work, rounds), "s"))
    out.append(Figure("dart-hal evaluate on everything, CPU",
                      min(command_cpu(root) for _ in range(rounds)), "s", high=20.0,
                      note=f"{len(b.paths)} windows, start and reading included"))
    return out


def text(values: Sequence[float]) -> str:
    """Five figures as the published table prints them."""
    return "/".join(f"{v:.1f}" if c == "yaw_deg" else f"{v:.3f}".removeprefix("0")
                    for v, c in zip(values, CHANNELS, strict=True))


def table() -> list[str]:
    """Lines of Markdown: our figures of every row, and the farthest one from the printed."""
    b = Baselines(folder())
    lines = ["| recordings (windows) | CTRV | kinematic P1 | dynamic P1 | off | upstream-2024 |",
             "|---|---|---|---|---|---|"]
    for row in ROWS:
        n = int(b.windows(row).sum())
        if n != row.windows:
            continue
        found = [b.rmse(e, row) for e in b.errors]
        worst = max(off(f, p) for f, p in zip(found, row.printed, strict=True))
        cells = [*map(text, found), f"{max(worst, 0.0):.1%}", text(b.rmse(b.upstream, row))]
        lines.append(f"| {row.title} ({n}) | {' | '.join(cells)} |")
    return lines


if __name__ == "__main__":
    if "--table" in sys.argv:
        print("\n".join(table()))
    else:
        for f in figures():
            print(f"{f.name:58} {f.measured:>12}  {f.target:>8}  {f.note}")
