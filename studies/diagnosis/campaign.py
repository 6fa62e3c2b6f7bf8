"""Hide every cause in drives of a stranger's car, and see whether the diagnosis finds it.

    make campaign                                  all of it, resumed where it was left
    python -m studies.diagnosis.campaign --only medium null --cases 20 --jobs 2
    python -m studies.diagnosis.campaign --cluster tcp://192.168.1.5:8786

Each case writes two files and asks ``dart_lab.diagnosis.diagnose`` about them,
which gets nothing else. Results are lines of JSON; a case that is there is not
run again. The workers of a cluster start in a checkout:
``python -m distributed.cli.dask_worker ADDRESS --nworkers auto --nthreads 1``.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from dart_hal.core.errors import DartHalError
from dart_hal.core.process.cluster import use_cluster
from dart_hal.core.process.jobs import each
from studies.diagnosis import campaign_show as show
from studies.diagnosis.campaign_cases import (
    BASES,
    GROUPS,
    Case,
    car,
    cases,
    habits,
    model_file,
    thinned,
)
from studies.diagnosis.campaign_score import confusion, grades, rows, score
from studies.diagnosis.stranger_files import Habits, pair

HOME = Path(__file__).resolve().parents[2]
SECONDS = (120.0, 80.0)
"""To learn from, to judge by."""
RESULTS = HOME / "build" / "campaign" / "results.jsonl"
KEEP = ("verdict", "base", "parameters", "causes", "possible", "unexplained", "withdrawn", "notes",
        "error")

Answer = dict[str, Any]


def ask(model: str, train: Path, test: Path, refit: bool, fitted_frames: bool = False,
        **how: Any) -> Answer:
    """What the diagnosis says about files, as its JSON document; how: as for ``diagnose``.

    fitted_frames: fit the marker frame to both files, as for a user who has not measured it.
    """
    from dart_hal.car.runs import read_any
    from dart_hal.vehicle.load import find_model
    from dart_lab.diagnosis import diagnose
    from studies.diagnosis.known_frame import read

    file, vehicle = find_model(model)
    first, second = read_any([train, test])[0] if fitted_frames else map(read, (train, test))
    return diagnose(file, vehicle, [first], [second], refit=refit, **how).to_json()


def write_case(case: Case, folder: Path, seconds: tuple[float, float] = SECONDS
               ) -> tuple[str, Path, Path, Habits]:
    """Write the files of a case; (model, training file, test file, how it was driven)."""
    rng = np.random.default_rng(case.number)
    how, what = habits(case, rng), car(case, rng)
    train, test = pair(folder, what, how, seconds, case.number)
    model, share = "paper", BASES[case.known]
    if share:
        model = str(folder / "stated.toml")
        Path(model).write_text(model_file(share), encoding="utf-8")
    return model, train, test, how


def run(case: Case, seconds: tuple[float, float] = SECONDS,
        asked: Callable[[str, Path, Path, bool], Answer] = ask) -> Answer:
    """One line of the results: the case, the answer, CPU seconds of the diagnosis."""
    with tempfile.TemporaryDirectory() as folder:
        model, train, test, how = write_case(case, Path(folder), seconds)
        start = time.process_time()
        try:
            answer = asked(model, train, test, case.known != "fixed")
        except DartHalError as err:
            answer = {"error": err.what}
        except Exception as err:  # noqa: BLE001 - a crash is a result, not the end of the night
            answer = {"error": f"{type(err).__name__}: {err}"}
        spent = time.process_time() - start
    return {"key": case.key, "group": case.group, "seed": case.seed, "hidden": case.hidden,
            "habits": asdict(how), "seconds": round(spent, 2),
            **{key: answer[key] for key in KEEP if key in answer}}


def results(wanted: Sequence[Case], lengths: tuple[float, float], jobs: int,
            asked: Callable[..., Answer] = ask) -> Iterator[Answer]:
    """Of every case, one after the other; on several cores, or on a cluster."""
    return each(partial(run, seconds=lengths, asked=asked), wanted, jobs, parts=len(wanted))


def done(path: Path) -> dict[str, Answer]:
    """Results of earlier runs, by key."""
    if not path.is_file():
        return {}
    lines = path.read_text(encoding="utf-8").splitlines()
    return {r["key"]: r for r in map(json.loads, lines)}


def scored(found: Iterable[Answer]) -> list[tuple[Case, Any, float]]:
    """(case, score, seconds) of lines."""
    out = []
    for line in found:
        case = Case(line["group"], line["seed"], tuple((n, k) for n, k in line["hidden"]))
        out.append((case, score(case, line), line["seconds"]))
    return out


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing, print the tables, draw the picture."""
    o = _parser().parse_args(arguments)
    if o.fresh:
        o.out.unlink(missing_ok=True)
    wanted = cases(o.only, o.effects, o.first_seed)
    wanted = thinned(wanted, o.cases) if o.cases else wanted
    before = done(o.out)
    missing = [c for c in wanted if c.key not in before]
    o.out.parent.mkdir(parents=True, exist_ok=True)
    console = Console(stderr=True)
    bar = Progress(TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(),
                   TimeRemainingColumn(), console=console)
    with use_cluster(o.cluster), bar, o.out.open("a", encoding="utf-8") as file:
        task = bar.add_task("hiding and seeking", total=len(missing))
        asked = partial(ask, fitted_frames=o.fitted_frames)
        for line in results(missing, tuple(o.seconds), o.jobs, asked):
            file.write(json.dumps(line) + "\n")
            file.flush()
            before[line["key"]] = line
            bar.update(task, advance=1, description=line["key"])
    return _report([before[c.key] for c in wanted], o)


def _report(found: Sequence[Answer], o: argparse.Namespace) -> int:
    judged = scored(found)
    summary = rows(judged)
    if o.json:
        print(json.dumps(show.document(summary), indent=1))
    else:
        out = Console(width=None if sys.stdout.isatty() else 120)
        out.print(show.table(summary))
        out.print(show.errors(confusion(judged)))
        out.print(show.reliability(grades((c, line) for (c, *_), line in zip(judged, found,
                                                                             strict=True))))
    crashed = [line["key"] for line in found if "error" in line]
    rich_groups = [g for g in ("small", "medium", "large") if any(c.group == g for c, *_ in judged)]
    if rich_groups and o.picture:
        show.picture(confusion(judged, rich_groups), o.picture)
    short = [r.group for r in summary if r.ok is False]
    judge = sum(r.ok is not None for r in summary)
    print(f"{len(found)} cases; {judge - len(short)} of {judge} targets reached"
          + (f"; short: {', '.join(short)}" if short else "")
          + (f"; without an answer: {', '.join(crashed[:5])}" if crashed else ""), file=sys.stderr)
    return 1 if o.strict and (short or crashed) else 0


def _parser() -> argparse.ArgumentParser:
    p = argparse.ArgumentParser(description="Hide causes in drives and see whether they are found.")
    p.add_argument("--only", nargs="+", choices=list(GROUPS), default=[], metavar="GROUP",
                   help=f"some of: {', '.join(GROUPS)}")
    p.add_argument("--effects", nargs="+", default=[], metavar="NAME", help="some causes only")
    p.add_argument("--cases", type=int, default=0, metavar="N", help="at most N of each group")
    p.add_argument("--first-seed", type=int, default=0, metavar="N",
                   help="other draws than those from 0 on, which the search was built with")
    p.add_argument("--seconds", type=float, nargs=2, default=SECONDS, metavar=("TRAIN", "TEST"))
    p.add_argument("--jobs", type=int, default=2, help="cores")
    p.add_argument("--cluster", metavar="ADDRESS", help="of a dask scheduler, in place of --jobs")
    p.add_argument("--fitted-frames", action="store_true",
                   help="fit the marker frame to the drives instead of stating it")
    p.add_argument("--out", type=Path, default=RESULTS, help="lines of JSON, resumed")
    p.add_argument("--fresh", action="store_true", help="forget earlier results")
    p.add_argument("--picture", type=Path, default=None, help="picture of what was taken for what")
    p.add_argument("--json", action="store_true", help="the table as JSON")
    p.add_argument("--strict", action="store_true", help="exit 1 when a target is missed")
    return p


if __name__ == "__main__":
    sys.exit(main())
