"""The paper's sub-models on its own folders: CPU time of all, compared with the paper's optimiser.

    python benchmarks/bench_identify.py
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from pathlib import Path

from adam import SETTINGS, Run, adam, torch_or_none
from figures import Figure

from dart_lab.identification.paper import fit_as_paper
from dart_lab.identification.paper.problem import CurveProblem, solve

HOME = Path(__file__).resolve().parents[1]
EXCERPT = HOME / "tests" / "recorded" / "data"


def recordings() -> Path:
    """The full set where it is present, else the excerpt: it holds these folders whole."""
    places = [os.environ.get("DART_DATA"), HOME.parent / "shared" / "data" / "dart", EXCERPT]
    return next(Path(p) for p in places if p and Path(p).is_dir())


def command_cpu(root: Path) -> float:
    """CPU time [s] of ``dart-hal identify all --as-paper``: start, imports, reading, fits."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-m", "dart_hal.cli.main", "identify", "all", "--as-paper",
                    str(root), "--json"], check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def compare(problem: CurveProblem, torch: object, rounds: int) -> tuple[float, float, Run, float]:
    """(CPU of least squares, CPU of ADAM, its last run, our loss), in turns, the best of each."""
    ours, theirs = [], []
    for _ in range(rounds):
        fit = solve(problem)
        run = adam(problem, torch)  # type: ignore[arg-type]
        ours.append(fit.cpu_s)
        theirs.append(run.cpu_s)
    return min(ours), min(theirs), run, fit.loss


def figures(scale: float = 1.0) -> list[Figure]:
    """All rows; fewer rounds below a ``scale`` of 1."""
    root, rounds = recordings(), max(1, round(3 * scale))
    torch = torch_or_none()
    with_what = "numpy with our Jacobians, torch is not installed" if torch is None else (
        f"torch {torch.__version__}, one thread")
    rows = [Figure("identify all --as-paper: CPU with start and reading",
                   min(command_cpu(root) for _ in range(rounds)), "s", high=2.0)]
    problems = fit_as_paper(root).problems
    adam(problems["friction"], torch)  # the first step of torch sets it up
    sum_ours = sum_theirs = 0.0
    for name in SETTINGS:
        ours, theirs, run, loss = compare(problems[name], torch, rounds)
        sum_ours, sum_theirs = sum_ours + ours, sum_theirs + theirs
        rows.append(Figure(f"ADAM / least squares, {name}", theirs / ours, "x",
                           note=f"{1e3 * theirs:.0f} / {1e3 * ours:.1f} ms, loss {run.loss:.6g} / "
                                f"{loss:.6g}"))
    rows.append(Figure("ADAM / least squares, all", sum_theirs / sum_ours, "x",
                       low=None if torch is None else 20.0, note=with_what))
    return rows


if __name__ == "__main__":
    for figure in figures():
        print(f"{figure.name:52} {figure.measured:>10}  {figure.target:>6}  {figure.note}")
