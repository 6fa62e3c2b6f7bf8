"""What each rule of the diagnosis is worth: hidden drives diagnosed again without it.

    python -m studies.diagnosis.ablation          all rows and rules, resumed where it was left
    python -m studies.diagnosis.ablation --only pair --cases 4 --rules confounders
    python -m studies.diagnosis.ablation --real    the real car instead, recordings split by day

A case is diagnosed once with all rules, and each notes whether it acted: whether anything would
have gone on differently without it. Only then is the case diagnosed again without that rule, for
else every step is the same.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial, wraps
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

from rich.console import Console
from rich.progress import track
from rich.table import Table

from dart_hal.core.process.jobs import each
from dart_lab.diagnosis import gates
from dart_lab.diagnosis.gates import AcceptanceGate
from studies.diagnosis.campaign import HOME, Answer, ask, done, run
from studies.diagnosis.campaign_cases import GROUPS, Case
from studies.diagnosis.campaign_score import score
from studies.diagnosis.policy_sensitivity import CHANNELS, DATA, drawn, replaced

ROWS = {"medium": 48, "fixed": 48, "small": 24, "null": 48, "null fixed": 24, "pair": 40,
        "far": 24, "near": 24, "wrong": 24}
"""Cases of each row."""
SECONDS = (60.0, 40.0)
RESULTS = HOME / "build" / "campaign" / "ablation.jsonl"
Function = Callable[..., Any]


@dataclass(frozen=True)
class Rule:
    """where: module and attribute of a function, below ``dart_lab.diagnosis``. without: makes of
    that function what takes its place when the rule is off. acted(result, *arguments): whether the
    rule changed anything in one call."""

    where: str
    without: Callable[[Function], Function]
    acted: Callable[..., bool]


def _constant(value: Any) -> Callable[[Function], Function]:
    return lambda _: lambda *_args, **_kw: value


def _plain_grades(original: Function) -> Function:
    from dart_lab.diagnosis.grade import bag

    def grades(of: Any, names: Sequence[str], seed: int) -> dict[str, float]:
        columns = bag._stack_columns(of, names)
        return {n: bag.probability(bag._select_columns(of, columns, n, ()), bag.ABSENT_STEP,
                                   bag.BOOTSTRAP_DRAWS, seed) for n in names}

    return grades


def _not_sharpened(original: Function) -> Function:
    from dart_lab.diagnosis.search.selection import fit_best_trials

    def keep(self: Any, point: Any, noise: Any, trials: Any) -> Any:
        return point, noise, trials, fit_best_trials(point, trials, partial(
            self.add_effect, self._evidence, noise))

    return keep


def _one_explanation(original: Function) -> Function:
    return lambda point, trials, fit: original(point, trials[:1], fit)


RULES: dict[str, Rule] = {
    "effects taken back": Rule(
        "grade.accept:_FitCache.readmit", lambda _: lambda self, those, away: (those, dict(away)),
        lambda out, self, those, away: out[0].names != those.names),
    "variants of stronger names": Rule("grade.accept:grade_effects", _plain_grades,
                                       lambda *_: True),
    "noise without the cause": Rule(
        "search.forward:ForwardSearch._separate_noise_from_causes", _not_sharpened,
        lambda out, self, point, noise, trials: out[1] is not noise),
    "order by gain at the end": Rule(
        "search.forward:ForwardSearch._update_gains",
        lambda _: lambda self, point, noise, named: named,
        lambda out, self, point, noise, named: [n.effect for n in out] != [n.effect for n in named]
    ),
    "companions at the end": Rule("search.forward:ForwardSearch._add_confounders",
                                  lambda _: lambda self, point, noise, before, one: one,
                                  lambda out, self, point, noise, before, one: out != one),
    "confounders": Rule("search.selection:find_confounders", _constant(()),
                        lambda found, *_: bool(found)),
    "noise of the names that stay": Rule(
        "conclude:select_noise", lambda _: lambda names, noise, base: noise,
        lambda out, names, noise, base: out is not noise),
    "several explanations": Rule("search.forward:fit_best_trials", _one_explanation,
                                 lambda fits, *_: len(fits) > 1),
    "cost of a claim": Rule("parameters.claims:_raises_errors", _constant(True),
                            lambda ok, *_: not ok),
    "claims beyond stated errors": Rule("parameters.claims:_exceeds_stated_error",
                                        _constant(True), lambda ok, *_: not ok),
    "pairs of groups": Rule("parameters.claims:_pair_groups", _constant([]),
                            lambda found, *_: bool(found)),
    # whether a search for an onset changed anything is not known: it counts as acting
    "onset of a threshold": Rule("search.scan:find_onset", _constant(None), lambda *_: True),
}


GATED = {f"gate: {gate.name}": gate for gate in gates.GATES
         if gate.name not in ("significance", "largest gain")}
"""Gates that can be left out: without these two every effect would be accepted."""


NAMES = [*GATED, *RULES]


def _place(where: str) -> tuple[Any, str]:
    module, _, path = where.partition(":")
    owner: Any = importlib.import_module(f"dart_lab.diagnosis.{module}")
    *inner, name = path.split(".")
    for part in inner:
        owner = getattr(owner, part)
    return owner, name


@contextmanager
def without(name: str) -> Iterator[None]:
    """Diagnose without a rule or a gate."""
    if name in GATED:
        others = tuple(gate for gate in gates.GATES if gate is not GATED[name])
        with replaced(gates, "GATES", others):
            yield
        return
    owner, attribute = _place(RULES[name].where)
    with replaced(owner, attribute, RULES[name].without(getattr(owner, attribute))):
        yield


@contextmanager
def watched(acted: set[str]) -> Iterator[None]:
    """Diagnose with all rules and gates, and note those that act."""
    with ExitStack() as stack:
        for name, rule in RULES.items():
            owner, attribute = _place(rule.where)
            watching = _watching(name, rule, getattr(owner, attribute), acted)
            stack.enter_context(replaced(owner, attribute, watching))
        tests = tuple(gate._replace(test=_noting(gate, acted)) for gate in gates.GATES)
        stack.enter_context(replaced(gates, "GATES", tests))
        yield


def _noting(gate: AcceptanceGate, acted: set[str]) -> Callable[..., bool]:
    def test(candidate: Any, policy: Any) -> bool:
        passes = gate.test(candidate, policy)
        if not passes:
            acted.add(f"gate: {gate.name}")
        return passes

    return test


def _watching(name: str, rule: Rule, original: Function, acted: set[str]) -> Function:
    @wraps(original)
    def call(*arguments: Any, **named: Any) -> Any:
        result = original(*arguments, **named)
        if rule.acted(result, *arguments, *named.values()):
            acted.add(name)
        return result

    return call


def examine(work: tuple[Case, str], seconds: tuple[float, float]) -> Answer:
    """One line of the results: a case with all rules ("") or without one."""
    case, rule = work
    acted: set[str] = set()
    with without(rule) if rule else watched(acted):
        line = run(case, seconds, ask)
    if rule:
        return {**line, "key": f"{case.key} without {rule}"}
    return {**line, "acted": sorted(acted)}


def examine_real(rule: str, data: Path) -> Answer:
    """One line: the real car, recordings split by day, with all rules ("") or without one."""
    from bench_real_car import read, split_by_day

    from dart_hal.vehicle.load import find_model
    from dart_lab.diagnosis import diagnose

    train, test = split_by_day(read(data))
    model, vehicle = find_model("paper")
    acted: set[str] = set()
    began = time.process_time()
    with without(rule) if rule else watched(acted):
        d = diagnose(model, vehicle, train, test)
    pooled = d.stages[-1].horizons["1.0"]["pooled"]
    return {"key": f"real without {rule}" if rule else "real", "acted": sorted(acted),
            "causes": [c.effect for c in d.causes], "verdict": d.verdict,
            "errors": {c: pooled[c] for c in CHANNELS},
            "seconds": round(time.process_time() - began, 1)}


def make_real_table(rules: Sequence[str], known: dict[str, Answer]) -> Table:
    """A row for each rule that acted: the causes, and the errors over those with all rules."""
    out = Table("without", "causes", "verdict", *CHANNELS, "seconds", title="real car")
    for rule in ("", *rules):
        key = f"real without {rule}" if rule else "real"
        if key in known:
            line = known[key]
            errors = [f"{line['errors'][c] / known['real']['errors'][c]:.3f}" for c in CHANNELS]
            out.add_row(rule or "nothing", ", ".join(line["causes"]), line["verdict"], *errors,
                        f"{line['seconds']:.0f}")
    return out


def run_real(o: argparse.Namespace) -> int:
    """Diagnose the real car without each rule that acts on it, one after the other."""
    known = done(o.out)
    with o.out.open("a", encoding="utf-8") as file:
        for rule in ("", *o.rules):
            key = f"real without {rule}" if rule else "real"
            if key in known or (rule and rule not in known["real"]["acted"]):
                continue
            known[key] = examine_real(rule, o.real)
            file.write(json.dumps(known[key]) + "\n")
            file.flush()
    Console(width=160).print(make_real_table(o.rules, known))
    return 0


def make_table(rules: Sequence[str], cases: Sequence[Case], known: dict[str, Answer]) -> Table:
    """A row for each rule: in how many cases it acted, and what changes in those without it."""
    out = Table("rule", "acted in", "repeated", "right", "right without", "wrong", "wrong without",
                "time without it", title=f"{len(cases)} cases")
    for rule in rules:
        acted = [c for c in cases if rule in known[c.key]["acted"]]
        pairs = [(c, known[c.key], known[f"{c.key} without {rule}"]) for c in acted
                 if f"{c.key} without {rule}" in known]
        counts = [sum(score(c, lines[k]).outcome == outcome for c, *lines in pairs)
                  for outcome in ("right", "wrong") for k in range(2)]
        seconds = [sum(lines[k]["seconds"] for _, *lines in pairs) for k in range(2)]
        out.add_row(rule, str(len(acted)), str(len(pairs)), *map(str, counts),
                    f"x {seconds[1] / seconds[0]:.2f}" if pairs else "")
    return out


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing, print the table."""
    p = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    p.add_argument("--only", nargs="+", choices=list(GROUPS), default=list(ROWS), metavar="ROW")
    p.add_argument("--rules", nargs="*", choices=NAMES, default=NAMES, metavar="RULE")
    p.add_argument("--cases", type=int, default=0, metavar="N", help="of each row")
    p.add_argument("--first-seed", type=int, default=6000, metavar="N")
    p.add_argument("--seconds", type=float, nargs=2, default=SECONDS, metavar=("TRAIN", "TEST"))
    p.add_argument("--jobs", type=int, default=2, help="cores")
    p.add_argument("--out", type=Path, default=RESULTS, help="lines of JSON, resumed")
    p.add_argument("--real", type=Path, nargs="?", const=DATA, metavar="DATA",
                   help="the published recordings of the real car")
    o = p.parse_args(arguments)
    o.out.parent.mkdir(parents=True, exist_ok=True)
    if o.real:
        return run_real(o)
    wanted = [c for row in o.only for c in drawn(row, o.cases or ROWS[row], o.first_seed)]
    known = done(o.out)
    examined(known, [(c, "") for c in wanted], o)
    examined(known, [(c, r) for r in o.rules for c in wanted if r in known[c.key]["acted"]], o)
    Console(width=120).print(make_table(o.rules, wanted, known))
    return 0


def examined(known: dict[str, Answer], work: Sequence[tuple[Case, str]], o: argparse.Namespace
             ) -> None:
    """Do what is missing, and add it to the lines known."""
    missing = [(c, r) for c, r in work if (f"{c.key} without {r}" if r else c.key) not in known]
    found = each(partial(examine, seconds=tuple(o.seconds)), missing, o.jobs, parts=len(missing))
    with o.out.open("a", encoding="utf-8") as file:
        for line in track(found, "diagnosing", total=len(missing)):
            file.write(json.dumps(line) + "\n")
            file.flush()
            known[line["key"]] = line


if __name__ == "__main__":
    sys.exit(main())
