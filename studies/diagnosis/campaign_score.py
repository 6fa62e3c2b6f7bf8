"""Right, wrong or missed: what a diagnosis said, held against what was hidden."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import binomtest

from studies.diagnosis.campaign_cases import GROUPS, Case
from studies.diagnosis.out_of_catalogue import FAMILY
from studies.diagnosis.wrong_parameters import WRONG, claimed

SET = 3
"""An honest "cannot be told from" names no more than so many."""
OUTCOMES = ("right", "wrong", "missed")
TARGETS: dict[str, dict[str, float]] = {
    "medium": {"right": 0.95, "wrong": 0.02}, "large": {"right": 1.00, "wrong": 0.02},
    "disturbed": {"right": 0.80}, "rough": {"right": 0.75}, "onboard": {"right": 0.60},
    "onboard large": {"right": 0.85}, "null": {"right": 0.98, "wrong": 0.005},
    "null fixed": {"right": 0.98, "wrong": 0.005},
    "fixed": {"right": 0.97, "alone": 0.92, "wrong": 0.01}, "pair": {"right": 0.85},
    "pair fixed": {"right": 0.85}, "far": {"right": 0.90}, "far fixed": {"right": 0.95},
    "near": {"right": 0.90}, "wrong": {"right": 0.80}}
"""Least share that is right, and right alone, largest share that is wrong."""
PROTOTYPE = {"small": 0.76, "medium": 0.895, "large": 1.0, "disturbed": 0.71, "gentle": 0.71,
             "rough": 0.58, "onboard": 0.44, "onboard large": 0.67, "null": 1.0, "pair": 1.0,
             "far": 1.0}


@dataclass(frozen=True)
class Score:
    """outcome: one of OUTCOMES; named: the first cause, "unexplained" or "nothing".

    extra: causes that are named and not hidden; off: relative error of the size
    where the effect itself was named, else None; held: of each such size, whether its 90 % interval
    holds what is hidden.
    """

    outcome: str
    named: str
    extra: int = 0
    off: float | None = None
    held: tuple[bool, ...] = ()


def score(case: Case, answer: Mapping[str, Any]) -> Score:
    """Of the JSON document of one diagnosis; one with "error" has named nothing."""
    causes = answer.get("causes", [])
    flagged = bool(answer.get("unexplained")) or any(
        c.get("constancy", {}).get("changes_with")
        for c in (*causes, *answer.get("parameters", [])))
    named = causes[0]["effect"] if causes else "unexplained" if flagged else "nothing"
    kind = GROUPS[case.group].kind
    if kind == "null":
        silent = not flagged and "error" not in answer
        return Score("wrong" if causes else "right" if silent else "missed", named, len(causes))
    if kind == "far":
        outcome = "right" if flagged else "wrong" if causes else "missed"
        return Score(outcome, named, len(causes))
    if kind == "near":
        family = FAMILY[case.hidden[0][0]]
        right = any(_answers(c) & family for c in causes)
        return Score("right" if right else "wrong" if causes else "missed", named,
                     sum(not _answers(c) & family for c in causes))
    if kind == "wrong":
        return _of_wrong(case, answer, named)
    return _of_hidden(case, causes, named)


def _of_wrong(case: Case, answer: Mapping[str, Any], named: str) -> Score:
    """Exactly the altered groups, and the effects beside them."""
    groups = [c["group"] for c in answer.get("parameters", [])]
    causes = answer.get("causes", [])
    false, missed = claimed({n for n, _ in case.hidden if n in WRONG}, groups)
    effects = {n for n, _ in case.hidden if n not in WRONG}
    others = [c for c in causes if not _answers(c) & effects]
    told = len(effects & {n for c in causes for n in _answers(c)})
    extra, left = false + len(others), missed + len(effects) - told
    return Score("wrong" if extra else "missed" if left else "right", named, extra)


def _of_hidden(case: Case, causes: Sequence[Mapping[str, Any]], named: str) -> Score:
    """Every cause that is hidden must be covered by a cause of its own; a pair, and no more."""
    left, off, held = list(causes), [], list[bool]()
    found = 0
    for name, size in sorted(case.hidden, key=lambda h: all(h[0] != c["effect"] for c in causes)):
        exact = [c for c in left if c["effect"] == name]
        cover = exact or [c for c in left if name in _answers(c)]
        if cover:
            found += 1
            left.remove(cover[0])
        if exact:
            off.append(_off(exact[0], size))
            held.append(_holds(exact[0], size))
    right = found == len(case.hidden) and (len(case.hidden) == 1 or not left)
    outcome = "right" if right else "wrong" if left else "missed"
    return Score(outcome, named, len(left), max(off) if off else None, tuple(held))


def _answers(cause: Mapping[str, Any]) -> set[str]:
    """The effect and, if they are few, those that it cannot be told from."""
    like = cause.get("cannot_be_told_from", [])
    return {cause["effect"], *(like if len(like) <= SET else ())}


def _off(cause: Mapping[str, Any], size: float) -> float:
    value = next(iter(cause["parameters"].values()))["value"]
    return abs(float(value) - size) / abs(size)


def _holds(cause: Mapping[str, Any], size: float) -> bool:
    """Whether the 90 % interval of the first parameter holds a size."""
    number = next(iter(cause["parameters"].values()))
    return abs(float(number["value"]) - size) <= 1.645 * float(number["std"])


@dataclass(frozen=True)
class Row:
    """Shares of one group; sizes: median and 90th percentile of the error; time [s] per case.

    alone: right, and nothing named beside it. held: (90 % intervals of sizes that hold what is
    hidden, number of these intervals).
    """

    group: str
    n: int
    shares: dict[str, float]
    extra: float
    alone: float
    sizes: tuple[float, float]
    held: tuple[int, int]
    seconds: float

    @property
    def interval(self) -> tuple[float, float]:
        """Of the share that is right, 90 % (Wilson)."""
        found = binomtest(round(self.shares["right"] * self.n), self.n)
        return tuple(map(float, found.proportion_ci(0.9, "wilson")))

    @property
    def ok(self) -> bool | None:
        """Whether the targets are met; None without any."""
        target = TARGETS.get(self.group)
        if target is None:
            return None
        return (self.shares["right"] >= target.get("right", 0.0)
                and self.alone >= target.get("alone", 0.0)
                and self.shares["wrong"] <= target.get("wrong", 1.0))


def rows(results: Iterable[tuple[Case, Score, float]]) -> list[Row]:
    """One for each group, in the order of GROUPS; results: (case, score, seconds)."""
    by_group: dict[str, list[tuple[Case, Score, float]]] = {}
    for result in results:
        by_group.setdefault(result[0].group, []).append(result)
    out = []
    for group in (g for g in GROUPS if g in by_group):
        scores = [s for _, s, _ in by_group[group]]
        count = Counter(s.outcome for s in scores)
        off = [s.off for s in scores if s.off is not None]
        sizes = (float(np.median(off)), float(np.quantile(off, 0.9))) if off else (np.nan, np.nan)
        out.append(Row(group, len(scores), {o: count[o] / len(scores) for o in OUTCOMES},
                       sum(s.extra > 0 for s in scores) / len(scores),
                       sum(s.outcome == "right" and not s.extra for s in scores) / len(scores),
                       sizes, (sum(h for s in scores for h in s.held),
                               sum(len(s.held) for s in scores)),
                       float(np.mean([t for *_, t in by_group[group]]))))
    return out


def grades(results: Iterable[tuple[Case, Mapping[str, Any]]]) -> list[tuple[float, bool]]:
    """(stated probability, whether right) of every name, but of causes outside of the catalogue.

    Right: what is hidden, or its family; of those outside no name is.
    """
    out = []
    for case, answer in results:
        kind = GROUPS[case.group].kind
        if kind == "far":
            continue
        hidden = {n for n, _ in case.hidden}
        truth = FAMILY[case.hidden[0][0]] if kind == "near" else hidden
        out += [(float(c["probability"]), bool(_answers(c) & truth))
                for c in answer.get("causes", []) if "probability" in c]
    return out


def confusion(results: Iterable[tuple[Case, Score, float]], groups: Sequence[str] = ()
              ) -> dict[str, Counter[str]]:
    """What was named first, by what was hidden; a covered truth counts as itself."""
    out: dict[str, Counter[str]] = {}
    for case, s, _ in results:
        if len(case.hidden) == 1 and (not groups or case.group in groups):
            truth = case.hidden[0][0]
            known = GROUPS[case.group].kind == "effect" and s.outcome == "right"
            out.setdefault(truth, Counter())[truth if known else s.named] += 1
    return out
