"""How the names move when a threshold of the diagnosis is half or double what it is.

    python tests/hidden/policy_sensitivity.py                   all of it, resumed where it was left
    python tests/hidden/policy_sensitivity.py --cases 2 --out few.jsonl

A case is diagnosed once with thresholds that note whether half or double of them would have
decided a single comparison otherwise. Only where one would have is it diagnosed again, for else
every step is the same. What is no plain comparison (ALWAYS) is diagnosed again in any case.
"""

from __future__ import annotations

import argparse
import json
import operator
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

import numpy as np
from campaign import HOME, KEEP, SECONDS, Answer, ask, done, run
from campaign_cases import GROUPS, Case, cases, thinned
from campaign_score import score
from rich.progress import track

from dart_hal.diagnose.policy import USUAL, Policy

ROWS = ("fixed", "null fixed", "pair fixed", "pair")
FACTORS = (0.5, 2.0)
ALWAYS = ("false_alarm", "blocks.seconds", "noise.robust")
COMPARED = ("naming.close", "naming.least_size", "grade.confident", "confounders.clear",
            "conclusion.spurious")
FALSE_ALARM = 0.01  # the default of ``diagnose``
RESULTS = HOME / "build" / "campaign" / "policy_sensitivity.jsonl"
TABLE = HOME / "docs" / "results" / "policy_sensitivity.md"


class Watched(float):
    """A threshold, or what is computed of it, that notes which other values decide otherwise.

    others: what it would be at each of FACTORS; noted: indices of those that once mattered.
    """

    __array_ufunc__ = None  # numpy leaves arithmetic and comparisons to this class
    others: tuple[float, ...]
    noted: set[int]

    @classmethod
    def of(cls, value: float, others: Sequence[float], noted: set[int]) -> Watched:
        self = cls(value)
        self.others, self.noted = tuple(others), noted
        return self

    def _computed(self, by: Callable[[float], float]) -> Watched:
        return Watched.of(by(float(self)), [by(o) for o in self.others], self.noted)

    def _compared(self, by: Callable[[float], Any]) -> Any:
        decided = by(float(self))
        self.noted |= {i for i, o in enumerate(self.others) if np.any(by(o) != decided)}
        return decided


def _watching(name: str) -> Callable[[Watched, Any], Any]:
    """A method of ``Watched`` in place of that of float."""
    plain = getattr(operator, name.replace("__r", "__"))
    swapped = name.startswith("__r")

    def method(self: Watched, other: Any) -> Any:
        def by(value: float) -> Any:
            return plain(other, value) if swapped else plain(value, other)

        compares = name in ("__lt__", "__le__", "__gt__", "__ge__")
        return self._compared(by) if compares else self._computed(by)

    return method


for _name in ("lt", "le", "gt", "ge", "add", "radd", "sub", "rsub", "mul", "rmul", "truediv"):
    setattr(Watched, f"__{_name}__", _watching(f"__{_name}__"))


def changed(policy: Policy, name: str, value: float) -> Policy:
    """The policy with one threshold, ``group.field``, at another value."""
    group, key = name.split(".")
    return replace(policy, **{group: replace(getattr(policy, group), **{key: value})})


def usual(name: str) -> float:
    """The value of a threshold."""
    return FALSE_ALARM if name == "false_alarm" else operator.attrgetter(name)(USUAL)


def altered(name: str, factor: float) -> dict[str, Any]:
    """Arguments of ``diagnose`` with one threshold half or double."""
    value = factor * usual(name)
    if name == "false_alarm":
        return {"false_alarm": value}
    return {"policy": changed(USUAL, name, value)}


def examine(case: Case, seconds: tuple[float, float]) -> Answer:
    """One line of the results: as ``campaign.run``, and the answers that a threshold may change."""
    others: dict[str, Answer] = {}

    def asked(*files: Any) -> Answer:
        policy, noted = USUAL, {name: set(range(len(FACTORS))) for name in ALWAYS}
        for name in COMPARED:
            value = usual(name)
            noted[name] = set()
            policy = changed(policy, name, Watched.of(value, [f * value for f in FACTORS],
                                                      noted[name]))
        answer = ask(*files, policy=policy)
        for name, matter in noted.items():
            for i in sorted(matter):
                found = ask(*files, **altered(name, FACTORS[i]))
                others[f"{name} x {FACTORS[i]:g}"] = {k: found[k] for k in KEEP if k in found}
        return answer

    return {**run(case, seconds, asked), "changed": others}


def examined(wanted: Sequence[Case], seconds: tuple[float, float], jobs: int) -> Iterator[Answer]:
    """Of every case, as they are done."""
    from joblib import Parallel, delayed

    yield from Parallel(n_jobs=jobs, return_as="generator_unordered", pre_dispatch=2 * jobs)(
        delayed(examine)(case, seconds) for case in wanted)


def drawn(group: str, n: int, first: int) -> list[Case]:
    """n cases of a group, from a seed on."""
    found = cases([group], first=first)
    while len(found) < n:
        found += cases([group], first=first + len(found))
    return thinned(found, n)


def share(cases_of_row: Sequence[tuple[Case, Answer]], variant: str) -> str:
    """"right/wrong" of one row at one value of a threshold."""
    outcome = [score(case, line["changed"].get(variant, line)).outcome
               for case, line in cases_of_row]
    return "/".join(f"{outcome.count(o) / len(outcome):.2f}" for o in ("right", "wrong"))


def table(of: Sequence[tuple[Case, Answer]]) -> str:
    """A Markdown page."""
    by_row = {row: [x for x in of if x[0].group == row] for row in ROWS}
    by_row = {row: found for row, found in by_row.items() if found}
    head = [f"{row} ({len(found)}): {share(found, '')}" for row, found in by_row.items()]
    lines = ["# What half and double of a threshold do", "",
             f"Figures of {date.today():%B %Y}.", "",
             "Share right / share wrong of campaign rows (`tests/hidden/policy_sensitivity.py`),",
             "one threshold of `dart_hal.diagnose.policy` at half -> double; in the head as it is.",
             "*decides*: cases in which half or double changes any step at all.", "",
             f"| threshold | usual | decides | {' | '.join(head)} |",
             "|---|---:|---:|" + "---|" * len(head)]
    for name in (*ALWAYS, *COMPARED):
        variants = [f"{name} x {f:g}" for f in FACTORS]
        n = sum(any(v in line["changed"] for v in variants) for _, line in of)
        cells = [" -> ".join(share(found, v) for v in variants) for found in by_row.values()]
        lines.append(f"| `{name}` | {usual(name):g} | {n} of {len(of)} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing, write the table."""
    p = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    p.add_argument("--only", nargs="+", choices=list(GROUPS), default=list(ROWS), metavar="ROW")
    p.add_argument("--cases", type=int, default=24, metavar="N", help="of each row")
    p.add_argument("--first-seed", type=int, default=100, metavar="N")
    p.add_argument("--seconds", type=float, nargs=2, default=SECONDS, metavar=("TRAIN", "TEST"))
    p.add_argument("--jobs", type=int, default=2, help="cores")
    p.add_argument("--out", type=Path, default=RESULTS, help="lines of JSON, resumed")
    p.add_argument("--table", type=Path, default=TABLE, help="Markdown page to write")
    o = p.parse_args(arguments)
    wanted = [c for row in o.only for c in drawn(row, o.cases, o.first_seed)]
    before = done(o.out)
    missing = [c for c in wanted if c.key not in before]
    o.out.parent.mkdir(parents=True, exist_ok=True)
    with o.out.open("a", encoding="utf-8") as file:
        for line in track(examined(missing, tuple(o.seconds), o.jobs), "half and double",
                          total=len(missing)):
            file.write(json.dumps(line) + "\n")
            file.flush()
            before[line["key"]] = line
    o.table.write_text(table([(c, before[c.key]) for c in wanted]), encoding="utf-8")
    print(f"{len(wanted)} cases, {sum(before[c.key]['seconds'] for c in wanted):.0f} s of CPU: "
          f"{o.table}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
