"""How diagnoses change when a threshold of the policy is halved or doubled.

    python -m studies.diagnosis.policy_sensitivity              all of it, resumed where it ended
    python -m studies.diagnosis.policy_sensitivity --cases 1 --out few.jsonl

1. Diagnose each case once, with thresholds that note whether half or double of them would have
   decided a comparison, or changed an array, anywhere.
2. Diagnose a case again with a threshold halved or doubled where that was noted, in at most
   ``--repeats`` cases of each; elsewhere every step is the same.
3. A threshold may reach code that the notes do not follow: in the first ``--checked`` cases the
   diagnosis is repeated whether or not anything was noted.

Thresholds that act after the search are repeated in every case that notes them: the search is made
once, and the conclusion again for each change.

    python -m studies.diagnosis.policy_sensitivity --real    these on the real car, split by day
"""

from __future__ import annotations

import argparse
import copy
import json
import operator
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields, replace
from datetime import date
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.progress import track

from dart_hal.core.process.jobs import each
from dart_hal.recording.dart import Recording
from dart_hal.vehicle.load import find_model
from dart_lab.diagnosis import run as diagnosis_run
from dart_lab.diagnosis.policy import USUAL, Policy
from dart_lab.diagnosis.question import DiagnosisSetup
from dart_lab.diagnosis.result import Diagnosis
from studies.diagnosis.campaign import HOME, KEEP, Answer, ask, done, run
from studies.diagnosis.campaign_cases import GROUPS, Case, cases, thinned
from studies.diagnosis.campaign_score import score

ROWS = {"fixed": 12, "medium": 12, "small": 6, "null": 6, "pair": 12, "far": 4, "near": 4,
        "wrong": 4}
"""Cases of each row: 60."""
SECONDS = (60.0, 40.0)
FACTORS = (0.5, 2.0)
FALSE_ALARM = 0.01  # the default of ``diagnose``
APART = ("suggest", "inputs")
"""Groups that decide nothing of a diagnosis: of the next drive, and of files that are refused."""
CONCLUDING = ("grade", "two_cars", "claims", "unexplained", "conclusion")
"""Groups that act after the search, where recordings have motion capture."""
NOT_FOLLOWED = ("false_alarm", "unexplained.accel", "unexplained.encoder")
"""Thresholds that reach code or arrays in which nothing is noted."""
RESULTS = HOME / "build" / "campaign" / "policy_sensitivity.jsonl"
DATA = Path(os.environ.get("DART_DATA", HOME.parent / "shared" / "data"))
CHANNELS = ("vx", "vy", "yaw_rate", "position", "yaw_deg")
TABLE = HOME / "docs" / "results" / "policy_sensitivity.md"
COMPARISONS = ("lt", "le", "gt", "ge")
ARITHMETIC = ("add", "radd", "sub", "rsub", "mul", "rmul", "truediv", "rtruediv", "pow", "neg")


class Watched(float):
    """A threshold, or what is computed of it, that notes which other values decide otherwise.

    others: what it would be at each of FACTORS; noted: indices of those that once mattered.
    """

    others: tuple[float, ...]
    noted: set[int]

    @classmethod
    def of(cls, value: float, others: Sequence[float], noted: set[int]) -> Watched:
        """A number with what it would be otherwise."""
        self = cls(value)
        self.others, self.noted = tuple(map(float, others)), noted
        return self

    def _follow(self, compute: Callable[[float], Any]) -> Any:
        """Compute with the value and with the others: a number is watched on, all else compared."""
        result = compute(float(self))
        others = [compute(o) for o in self.others]
        if isinstance(result, float):
            return Watched.of(result, others, self.noted)
        self.noted |= {i for i, o in enumerate(others) if not np.array_equal(o, result)}
        return result

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        """Follow a function of numpy; of several watched numbers each in turn."""
        place = next(i for i, x in enumerate(inputs) if x is self)

        def compute(value: float) -> Any:
            return getattr(ufunc, method)(*inputs[:place], value, *inputs[place + 1:], **options)

        return self._follow(compute)


def _method(name: str) -> Callable[..., Any]:
    """A method of ``Watched`` in place of that of float."""
    plain = getattr(float, f"__{name}__")

    def method(self: Watched, *other: Any) -> Any:
        def compute(value: float) -> Any:
            answer = plain(value, *other)
            if answer is NotImplemented and isinstance(other[0], np.ndarray | np.generic):
                return getattr(np.float64, f"__{name}__")(np.float64(value), *other)
            return answer

        if compute(float(self)) is NotImplemented:
            return NotImplemented
        return self._follow(compute)

    return method


for _name in (*COMPARISONS, *ARITHMETIC):
    setattr(Watched, f"__{_name}__", _method(_name))


def list_thresholds() -> list[str]:
    """Names of the numbers of the policy that decide something in a diagnosis."""
    return ["false_alarm", *(f"{group.name}.{one.name}" for group in fields(USUAL)
                             if group.name not in APART
                             for one in fields(getattr(USUAL, group.name)))]


def changed(policy: Policy, name: str, value: float) -> Policy:
    """The policy with one threshold, ``group.field``, at another value."""
    group, key = name.split(".")
    return replace(policy, **{group: replace(getattr(policy, group), **{key: value})})


def usual(name: str) -> Any:
    """The value of a threshold."""
    return FALSE_ALARM if name == "false_alarm" else operator.attrgetter(name)(USUAL)


def altered(name: str, factor: float) -> dict[str, Any]:
    """Arguments of ``diagnose`` with one threshold half or double."""
    value = factor * usual(name)
    if name == "false_alarm":
        return {"false_alarm": value}
    return {"policy": changed(USUAL, name, value)}


def watch(noted: dict[str, set[int]]) -> Policy:
    """The usual policy, with all its numbers watched."""
    policy = USUAL
    for name in noted:
        value = usual(name)
        if is_followed(name):
            policy = changed(policy, name, Watched.of(value, [f * value for f in FACTORS],
                                                      noted[name]))
    return policy


def examine(work: tuple[Case, str, float], seconds: tuple[float, float]) -> list[Answer]:
    """The line of the results of a case with a change that acts in the search."""
    case, name, factor = work
    return [{**run(case, seconds, partial(ask, **altered(name, factor))),
             "key": key_of(case, name, factor)}]


def examine_first(case: Case, seconds: tuple[float, float]) -> list[Answer]:
    """Lines of a case as it is, with what was noted, and with changes that act after the search."""
    noted = {n: set[int]() for n in list_thresholds()}
    found: dict[str, Answer] = {}
    with concluded_again(noted, found):
        line = run(case, seconds, partial(ask, policy=watch(noted)))
    return with_changes(line, noted, found)


def examine_real(data: Path) -> list[Answer]:
    """The same of the real car, recordings split by day."""
    noted = {n: set[int]() for n in list_thresholds()}
    found: dict[str, Answer] = {}
    with concluded_again(noted, found):
        d = diagnosis_run.diagnose(*find_model("paper"), *read_real(data), policy=watch(noted))
    return with_changes({"key": "real", **to_answer(d)}, noted, found)


def with_changes(line: Answer, noted: dict[str, set[int]], found: dict[str, Answer]
                 ) -> list[Answer]:
    """A line with what was noted, and one for each change."""
    about = {key: value for key, value in line.items() if key not in (*KEEP, "errors")}
    return [{**line, "noted": {n: [FACTORS[i] for i in sorted(at)] for n, at in noted.items()}},
            *({**about, **answer, "key": f"{line['key']} {change}"}
              for change, answer in found.items())]


@contextmanager
def replaced(owner: Any, attribute: str, other: Any) -> Iterator[None]:
    """Put something else in the place of an attribute for a while."""
    original = getattr(owner, attribute)
    setattr(owner, attribute, other)
    try:
        yield
    finally:
        setattr(owner, attribute, original)


@contextmanager
def concluded_again(noted: dict[str, set[int]], found: dict[str, Answer]) -> Iterator[None]:
    """Conclude from a search again with each change after it that was noted.

    found: answers by change are added.
    """
    conclude = diagnosis_run.conclude

    def conclude_each(q: DiagnosisSetup, *rest: Any) -> Diagnosis:
        usual_diagnosis = conclude(q, *rest)
        usual_diagnosis.to_json()
        for name in filter(is_concluding, list_thresholds()):
            indices = sorted(noted[name]) if is_followed(name) else range(len(FACTORS))
            for factor in (FACTORS[i] for i in indices):
                try:
                    answer = to_answer(conclude(with_change(q, name, factor), *rest))
                except Exception as err:  # noqa: BLE001 - as in ``campaign.run``
                    answer = {"error": f"{type(err).__name__}: {err}"}
                found[f"{name} x {factor:g}"] = answer
        return usual_diagnosis

    with replaced(diagnosis_run, "conclude", conclude_each):
        yield


def with_change(q: DiagnosisSetup, name: str, factor: float) -> DiagnosisSetup:
    """The input of a conclusion with one threshold half or double."""
    settings = replace(q.settings, **altered(name, factor))
    search = copy.copy(q.search)
    search._settings = settings
    return replace(q, settings=settings, search=search)


def to_answer(d: Diagnosis) -> Answer:
    """What is compared of a diagnosis."""
    answer = d.to_json()
    errors = d.stages[-1].horizons["1.0"]["pooled"]
    return {**{key: answer[key] for key in KEEP if key in answer},
            "errors": {c: errors[c] for c in CHANNELS}}


def read_real(data: Path) -> tuple[list[Recording], list[Recording]]:
    """The recordings of the real car, split by day: (training, test)."""
    sys.path.insert(0, str(HOME / "benchmarks"))
    from bench_real_car import read, split_by_day

    return split_by_day(read(data))


def key_of(case: Case, name: str, factor: float) -> str:
    """Under which a line is kept."""
    return f"{case.key} {name} x {factor:g}"


def drawn(group: str, n: int, first: int) -> list[Case]:
    """n cases of a group, from a seed on."""
    found = cases([group], first=first)
    while len(found) < n:
        found += cases([group], first=first + len(found))
    return thinned(found, n)


def choose(sample: Sequence[Case], known: dict[str, Answer], checked: int, repeats: int
           ) -> list[tuple[Case, str, float]]:
    """What to repeat: where a change was noted, and in the first cases whether or not."""
    out = []
    for name in (n for n in list_thresholds() if not is_concluding(n)):
        followed = is_followed(name)
        for factor in FACTORS:
            noted = [c for c in sample if factor in known[c.key]["noted"][name]]
            few = noted[::max(1, len(noted) // repeats)][:repeats] if noted else []
            first = sample[:: max(1, len(sample) // checked)][:checked]
            also = [c for c in first if c not in few] if len(few) < checked or not followed else []
            out += [(c, name, factor) for c in (*few, *also)]
    return out


def essence(line: Answer) -> tuple[Any, ...]:
    """What a user acts on: the verdict, the causes and the parameters."""
    return (line.get("verdict"), tuple(sorted(c["effect"] for c in line.get("causes", []))),
            tuple(sorted(p["group"] for p in line.get("parameters", []))),
            tuple(sorted(u["channel"] for u in line.get("unexplained", []))), line.get("error"))


def same_numbers(one: Answer, other: Answer) -> bool:
    """Whether two lines agree in every number but those that carry the names of files."""
    def numbers(line: Answer) -> list[Any]:
        causes = [{k: v for k, v in c.items() if k != "sizes"} for c in line.get("causes", [])]
        return [causes, *(line.get(k) for k in ("parameters", "possible", "withdrawn", "notes"))]

    return essence(one) == essence(other) and numbers(one) == numbers(other)


def table(sample: Sequence[Case], known: dict[str, Answer]) -> str:
    """Return a Markdown page: a table of each kind of thresholds, with a row for each."""
    lines = ["# What half and double of a threshold do", "",
             f"Figures of {date.today():%B %Y}: {len(sample)} cases of the "
             "[campaign](campaign.md), 60 s for training and 40 s for testing.", "",
             "```sh", "python -m studies.diagnosis.policy_sensitivity", "```", "",
             "| column | content |", "|---|---|",
             "| acts in | cases in which half or double changes a comparison or an array |",
             "| repeated | diagnoses with half and double; 0: not measured yet, the command "
             "resumes |",
             "| numbers | those of them in which any number of the answer differs |",
             "| answer | those in which verdict, causes, parameters or structure differ |",
             "| right, wrong | change of the outcomes of those cases, at half and at double |", "",
             summarise(sample, known)]
    for title, after in (("In the search", False), ("After the search", True)):
        lines += ["", f"## {title}",
                  "| threshold | usual | acts in | repeated | numbers | answer | right | wrong |",
                  "|---|---:|---:|---:|---:|---:|---:|---:|",
                  *(make_row(name, sample, known) for name in list_thresholds()
                    if is_concluding(name) == after)]
    return "\n".join(lines) + "\n"


def repeated(name: str, sample: Sequence[Case], known: dict[str, Answer]
             ) -> list[tuple[Case, Answer, Answer]]:
    """(case, line as it is, line with half or double) of what was repeated."""
    return [(c, known[c.key], known[key_of(c, name, f)]) for f in FACTORS for c in sample
            if key_of(c, name, f) in known]


def summarise(sample: Sequence[Case], known: dict[str, Answer]) -> str:
    """How many thresholds were repeated, change an outcome, or change no number."""
    lines = {name: found for name in list_thresholds() if (found := repeated(name, sample, known))}
    decisive = [name for name, found in lines.items()
                if any(score(c, a).outcome != score(c, b).outcome for c, a, b in found)]
    idle = [name for name, found in lines.items() if all(same_numbers(a, b) for _, a, b in found)]
    return (f"Of {len(list_thresholds())} thresholds {len(lines)} were repeated, in "
            f"{sum(map(len, lines.values()))} diagnoses. {len(decisive)} change an outcome "
            f"(columns *right* and *wrong*), {len(idle)} change no number (column *numbers*).")


def make_row(name: str, sample: Sequence[Case], known: dict[str, Answer]) -> str:
    """The row of one threshold."""
    acts = sum(bool(known[c.key]["noted"][name]) for c in sample)
    found = repeated(name, sample, known)
    numbers = sum(not same_numbers(one, other) for _, one, other in found)
    answers = sum(essence(one) != essence(other) for _, one, other in found)
    changes = []
    for outcome in ("right", "wrong"):
        changes.append(", ".join(f"{sum(change_of(outcome, *x) for x in at):+d}" for at in (
            [(c, a, b) for c, a, b in found if b["key"] == key_of(c, name, f)] for f in FACTORS)))
    cells = [f"`{name}`", f"{usual(name):g}", str(acts) if is_followed(name) else "",
             str(len(found)), str(numbers), str(answers), *changes]
    return f"| {' | '.join(cells)} |"


def change_of(outcome: str, case: Case, one: Answer, other: Answer) -> int:
    """1 if a case has an outcome with a change alone, -1 without it alone."""
    return (score(case, other).outcome == outcome) - (score(case, one).outcome == outcome)


def is_concluding(name: str) -> bool:
    """Whether a threshold acts after the search alone."""
    return name.split(".")[0] in CONCLUDING


def is_followed(name: str) -> bool:
    """Whether a threshold notes where half and double matter."""
    return name not in NOT_FOLLOWED


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing, write the table."""
    p = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    p.add_argument("--only", nargs="+", choices=list(GROUPS), default=list(ROWS), metavar="ROW")
    p.add_argument("--cases", type=int, default=0, metavar="N", help="of each row")
    p.add_argument("--checked", type=int, default=4, metavar="N",
                   help="cases that are repeated whether or not anything was noted")
    p.add_argument("--repeats", type=int, default=10, metavar="N",
                   help="most cases that are repeated for half, and for double")
    p.add_argument("--first-seed", type=int, default=7000, metavar="N")
    p.add_argument("--seconds", type=float, nargs=2, default=SECONDS, metavar=("TRAIN", "TEST"))
    p.add_argument("--jobs", type=int, default=2, help="cores")
    p.add_argument("--out", type=Path, default=RESULTS, help="lines of JSON, resumed")
    p.add_argument("--table", type=Path, default=TABLE, help="Markdown page to write")
    p.add_argument("--real", type=Path, nargs="?", const=DATA, metavar="DATA",
                   help="the published recordings of the real car")
    o = p.parse_args(arguments)
    if o.real:
        return run_real(o)
    sample = [c for row in o.only for c in drawn(row, o.cases or ROWS[row], o.first_seed)]
    o.out.parent.mkdir(parents=True, exist_ok=True)
    known = done(o.out)
    complete(known, [c for c in sample if c.key not in known], o, examine_first)
    changes = choose(sample, known, o.checked, o.repeats) if o.repeats else []
    complete(known, [x for x in changes if key_of(*x) not in known], o, examine)
    o.table.write_text(table(sample, known), encoding="utf-8")
    print(f"{len(sample)} cases: {o.table}")
    return 0


def complete(known: dict[str, Answer], work: Sequence[Any], o: argparse.Namespace,
             do: Callable[..., list[Answer]]) -> None:
    """Do what is missing, and add it to the lines known."""
    found = each(partial(do, seconds=tuple(o.seconds)), work, o.jobs, parts=len(work))
    for lines in track(found, "half and double", total=len(work)):
        keep(known, lines, o.out)


def keep(known: dict[str, Answer], lines: Sequence[Answer], path: Path) -> None:
    """Add lines to those known and to a file."""
    with path.open("a", encoding="utf-8") as file:
        file.writelines(json.dumps(line) + "\n" for line in lines)
    known.update({line["key"]: line for line in lines})


def run_real(o: argparse.Namespace) -> int:
    """Conclude about the real car with each noted change, and list those that change a number."""
    known = done(o.out)
    if "real" not in known:
        keep(known, examine_real(o.real), o.out)
    first = known["real"]
    for key, line in known.items():
        if key.startswith("real ") and not same_numbers(first, line):
            ratios = {c: line["errors"][c] / first["errors"][c] for c in CHANNELS}
            print(key, *(f"{c} {r:.3f}" for c, r in ratios.items()),
                  "answer differs" if essence(line) != essence(first) else "")
    return 0


if __name__ == "__main__":
    sys.exit(main())
