"""The shortest drive that separates a cause from all its confounders."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import combinations

from dart_hal.core.config import ModelFile
from dart_hal.vehicle.effects import catalogue
from dart_lab.identification.experiment.floor import Floor

from ..policy import USUAL, Policy
from ..result import Cause, Diagnosis
from .library import CHOICES, FLOOR, Progress, Rehearsed, rehearsed
from .predict import predict
from .question import Question, ask
from .race import Race
from .result import Pair, Suggestion, Tried


def suggest(diagnosis: Diagnosis, *, floor: Floor = FLOOR, seed: int = 0,
            progress: Progress | None = None, model: ModelFile | None = None,
            policy: Policy = USUAL) -> tuple[Suggestion, ...]:
    """For each cause that cannot be told from others: the drive that would separate them.

    floor: what there is to drive on; seed: of the simulated repeats; model: of
    the car that would drive (None: the paper's), for the rehearsal; policy: thresholds.
    Empty when every cause stands for itself.
    """
    open_ = [cause for cause in diagnosis.causes if cause.cannot_be_told_from]
    if not open_:
        return ()
    drives = _Kept(rehearsed(floor, model))
    out = []
    for i, cause in enumerate(open_):
        def tell(share: float, text: str, done: int = i) -> None:
            if progress is not None:
                progress((done + share) / len(open_), text)

        out.append(_answer(ask(diagnosis, cause, policy), cause, drives, floor, seed, tell))
    return tuple(out)


class _Kept:
    """An iterator that can be walked again; what was made is kept."""

    def __init__(self, source: Iterator[Rehearsed]) -> None:
        self._source, self._made = source, list[Rehearsed]()

    def __iter__(self) -> Iterator[Rehearsed]:
        yield from self._made
        for one in self._source:
            self._made.append(one)
            yield one


def _answer(q: Question, cause: Cause, drives: Iterable[Rehearsed], floor: Floor, seed: int,
            tell: Progress) -> Suggestion:
    confounders = q.names[1:]
    if not confounders:  # none of them could stand for it on the data at hand
        return Suggestion(cause.effect, cause.cannot_be_told_from, "", "", (), 0.0, str(floor), "",
                          True, (), q.values, "", ())
    tried: list[Tried] = []
    best: Race | None = None
    enough = False
    for i, drive in enumerate(drives):
        tell(i / len(CHOICES), drive.choice.name)
        for setting in q.settings:
            race = Race(q, drive, setting, seed)
            tried.append(Tried(drive.choice.name, drive.seconds, setting.needs, race.least))
            policy = q.policy.suggest  # on-board sensors start every window themselves
            least = policy.separation if setting is q.settings[-1] else policy.alone
            enough = race.least >= least and race.surest() >= policy.right
            if enough or best is None or (race.separated, race.least) > (best.separated,
                                                                         best.least):
                best = race
            if enough:
                break
        if enough:
            break
    by_hand = catalogue()[cause.effect].experiment
    if best is None:
        return Suggestion(cause.effect, confounders, "", "", (), 0.0, str(floor), "", False, (),
                          q.values, by_hand, tuple(tried))
    pairs = tuple(Pair(a, b, min(q.before[a, b], q.before[b, a]), best.between(a, b),
                       best.right(a, b), q.policy.suggest.separation)
                  for a, b in combinations(q.names, 2))
    choice = best.drive.choice
    return Suggestion(cause.effect, confounders, choice.name, choice.description, best.drive.typed,
                      best.drive.seconds, str(floor), best.setting.needs, enough,
                      pairs, q.values, by_hand, tuple(tried), predict(best, pairs))
