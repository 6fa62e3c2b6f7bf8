"""Find the shortest drive that separates a cause from all its confounders."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import combinations

from dart_hal.core.config import ModelFile
from dart_hal.vehicle.effects import catalogue
from dart_hal.vehicle.scale import find_scale
from dart_lab.identification.experiment.floor import Floor

from ..policy import USUAL, Policy
from ..result import Cause, Diagnosis
from .library import CHOICES, Progress, RehearsedDrive, default_floor, rehearse_choices
from .predict import predict_hardest_pair
from .question import ConfounderQuestion, make_question
from .race import DriveSimulation
from .result import Pair, Suggestion, TriedDrive


def suggest(diagnosis: Diagnosis, *, floor: Floor | None = None, seed: int = 0,
            progress: Progress | None = None, model: ModelFile | None = None,
            policy: Policy = USUAL) -> tuple[Suggestion, ...]:
    """Suggest the drive that distinguishes each cause from its confounders.

    floor: free floor (None: that of ``default_floor``). seed: of the simulated repeats. model: of
    the car that drives, for the rehearsal (None: the paper's). policy: thresholds. Returns nothing
    if no cause has confounders.
    """
    confounded = [cause for cause in diagnosis.causes if cause.cannot_be_told_from]
    if not confounded:
        return ()
    floor = floor or default_floor(diagnosis.extended.body)
    policy = policy.at_scale(find_scale(diagnosis.extended.body))
    drives = _CachedIterator(rehearse_choices(floor, model))
    out = []
    for i, cause in enumerate(confounded):
        def report_progress(share: float, text: str, done: int = i) -> None:
            if progress is not None:
                progress((done + share) / len(confounded), text)

        out.append(_suggest_for_cause(make_question(diagnosis, cause, policy), cause, drives, floor,
                                      seed, report_progress))
    return tuple(out)


class _CachedIterator:
    """An iterable over an iterator that keeps its items, so that it can be repeated."""

    def __init__(self, source: Iterator[RehearsedDrive]) -> None:
        self._source = source
        self._made = list[RehearsedDrive]()

    def __iter__(self) -> Iterator[RehearsedDrive]:
        yield from self._made
        for one in self._source:
            self._made.append(one)
            yield one


def _suggest_for_cause(q: ConfounderQuestion, cause: Cause, drives: Iterable[RehearsedDrive],
                       floor: Floor, seed: int, report_progress: Progress) -> Suggestion:
    """Suggest the drive for one cause.

    1. Simulate the drives, shortest first, with the fewest sensors first.
    2. Stop at the first drive whose smallest separation is sufficient.
    3. Otherwise take the drive that separates most pairs.
    """
    confounders = q.names[1:]
    if not confounders:  # none explains enough of it on the data at hand
        return Suggestion(cause.effect, cause.cannot_be_told_from, "", "", (), 0.0, str(floor), "",
                          True, (), q.values, "", ())
    tried: list[TriedDrive] = []
    best: DriveSimulation | None = None
    enough = False
    for i, drive in enumerate(drives):
        report_progress(i / len(CHOICES), drive.choice.name)
        for setting in q.settings:
            simulation = DriveSimulation(q, drive, setting, seed)
            tried.append(TriedDrive(drive.choice.name, drive.seconds, setting.needs,
                                    simulation.min_separation))
            policy = q.policy.suggest
            # On-board sensors also give the initial state of a window: more separation is needed.
            required_separation = (policy.separation if setting is q.settings[-1]
                                   else policy.onboard_separation)
            enough = simulation.min_separation >= required_separation
            if enough or best is None or (simulation.separated_pairs,
                                          simulation.min_separation) > (best.separated_pairs,
                                                                        best.min_separation):
                best = simulation
            if enough:
                break
        if enough:
            break
    by_hand = catalogue()[cause.effect].experiment
    if best is None:
        return Suggestion(cause.effect, confounders, "", "", (), 0.0, str(floor), "", False, (),
                          q.values, by_hand, tuple(tried))
    pairs = tuple(Pair(a, b, min(q.before[a, b], q.before[b, a]), best.separation(a, b),
                       best.correct_share(a, b), q.policy.suggest.separation)
                  for a, b in combinations(q.names, 2))
    choice = best.drive.choice
    return Suggestion(cause.effect, confounders, choice.name, choice.description,
                      best.drive.shell_commands, best.drive.seconds, str(floor), best.setting.needs,
                      enough, pairs, q.values, by_hand, tuple(tried), predict_hardest_pair(best,
                                                                                           pairs))
