"""Mutants: every safety part broken in small ways, and whether a test notices.

    python tests/mutation/mutation_run.py [--subject guard] [--list] [--jobs 2]

Each mutant is applied to a private copy of the checkout. The quick tests of its
subject run until the first failure; a survivor then meets the quick tests of
all packages that use the part, and the slower tests of its subject. Exit status
1 when fewer than 90 % are killed.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue

from copy_of_tree import Copy, MutantVerdict
from equivalent import equivalence
from mutant import Mutant
from subjects import SUBJECTS, Subject

GOAL = 0.90
"""Share of the mutants that must be killed."""


def main(arguments: list[str]) -> int:
    names = [s.name for s in SUBJECTS]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--subject", action="append", choices=names, help="one part alone")
    parser.add_argument("--only", default="", help="only mutants whose FILE:LINE contains this")
    parser.add_argument("--list", action="store_true", help="show the mutants, run nothing")
    parser.add_argument("--quick", action="store_true",
                        help="only the quick tests of the subject, also for survivors")
    parser.add_argument("--jobs", type=int, default=2, help="how many at a time (2)")
    wish = parser.parse_args(arguments)
    tasks = [(s, m) for s in SUBJECTS if s.name in (wish.subject or names)
             for m in s.mutants() if wish.only in m.place]
    if wish.list:
        for subject, mutant in tasks:
            print(f"{subject.name}: {_row(mutant)}{_note(mutant)}")
        return 0
    begin = time.monotonic()
    counted = [(s, m) for s, m in tasks if not equivalence(m)]
    verdicts = judge(counted, wish.jobs, not wish.quick)
    for _, mutant in tasks:
        if equivalence(mutant):
            print(f"not counted  {_row(mutant)}{_note(mutant)}")
    return report(verdicts, time.monotonic() - begin)


def judge(tasks: list[tuple[Subject, Mutant]], jobs: int, widely: bool) -> list[MutantVerdict]:
    """Verdicts in the order of the tasks; each is printed when it falls."""
    with tempfile.TemporaryDirectory(prefix="dart-mutants-") as home:
        copies: SimpleQueue[Copy] = SimpleQueue()
        for k in range(jobs):
            copies.put(Copy(Path(home) / str(k)))

        def one(task: tuple[Subject, Mutant]) -> MutantVerdict:
            copy = copies.get()
            try:
                verdict = copy.judge(*task, widely)
            finally:
                copies.put(copy)
            print(f"{verdict.seconds:6.1f} s  {_row(verdict.mutant)}\n"
                  f"          {_fate(verdict)}", flush=True)
            return verdict

        with ThreadPoolExecutor(jobs) as pool:
            return list(pool.map(one, tasks))


def report(verdicts: list[MutantVerdict], seconds: float) -> int:
    """The table by subject, the survivors, the share; 1 below the goal."""
    counted = [v for v in verdicts if v.counts]
    alive = [v for v in counted if not v.by]
    print(f"\n{'':24} mutants  killed")
    for subject in SUBJECTS:
        mine = [v for v in counted if v.subject == subject.name]
        if mine:
            print(f"{subject.name:24} {len(mine):7}  {sum(bool(v.by) for v in mine):6}")
    for verdict in alive:
        print(f"SURVIVED  {_row(verdict.mutant)}")
    share = 1.0 - len(alive) / max(len(counted), 1)
    print(f"{len(counted)} mutants, {len(counted) - len(alive)} killed: {share:.1%} "
          f"(goal {GOAL:.0%}); {len(verdicts) - len(counted)} did not compile; "
          f"{seconds / 60:.1f} min")
    return 0 if share >= GOAL else 1


def _row(mutant: Mutant) -> str:
    return f"{mutant.place}  {mutant.operator}: {mutant.before}  =>  {mutant.after or '(nothing)'}"


def _note(mutant: Mutant) -> str:
    reason = equivalence(mutant)
    return f"  (equivalent: {reason})" if reason else ""


def _fate(verdict: MutantVerdict) -> str:
    if not verdict.counts:
        return "no mutant: the compiler refuses it"
    return f"killed by {verdict.by}" if verdict.by else "SURVIVED"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
