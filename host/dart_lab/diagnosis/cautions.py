"""Warnings of a conclusion: about the recordings, and about fits that ended on a bound."""

from __future__ import annotations

import math
import shlex
from collections.abc import Collection, Mapping, Sequence

from dart_lab.identification.evidence.space import MAX_COMMAND_AGE
from dart_lab.identification.objective import Point
from dart_lab.report.numbers import shorten_list

from .gains import RecordingSet
from .grade.alike import RecordingGroups, estimate_sizes, find_groups, join_sizes
from .policy import Policy
from .report.words import channel
from .result import Cause, ErrorReduction, ParameterChange

AT_BOUND = "at the edge of what is allowed"
MIN_ERROR_RISE = 0.2  # of the error: an increase that is reported without an interval
AGE_BOUND_TOLERANCE = 1e-3  # s; an age that is nearer to its bound is on it


def list_cautions(last: Point, sets: tuple[RecordingSet, RecordingSet],
                  changes: Mapping[str, ParameterChange], gain: Mapping[str, ErrorReduction],
                  causes: Sequence[Cause], policy: Policy) -> tuple[str, ...]:
    """List the warnings, the most important first.

    last: the last fit by the noise, with the accepted effects; sets: training and test recordings;
    changes: parameters that the refit changed, empty without one; gain: of the final model over the
    base.
    """
    out = _compare_recordings(last, sets, policy)
    if not changes:
        return tuple(out)
    out += _list_bounds(changes, last)
    worse = list_worse_channels(gain)
    if worse and not causes:
        out.append("with refitted parameters the model predicts the test recordings worse "
                   f"({', '.join(map(channel, worse))}): these training recordings do not "
                   "determine the parameters. Record more driving like that of the test "
                   "recordings, or use --no-refit")
    return tuple(out)


def list_worse_channels(gain: Mapping[str, ErrorReduction]) -> list[str]:
    """List channels of the test recordings that are predicted significantly worse.

    Where the recordings are too short for an interval: worse by more than ``MIN_ERROR_RISE``.
    """
    return [name for name, g in gain.items()
            if g.high < 0.0 or (not math.isfinite(g.high) and g.test < -MIN_ERROR_RISE)]


def _compare_recordings(last: Point, sets: tuple[RecordingSet, RecordingSet], policy: Policy
                        ) -> list[str]:
    """Warn if the recordings are of two cars or floors."""
    train, test = (estimate_sizes(part.evidence, part.names, last, policy) for part in sets)
    found = find_groups(join_sizes(train, test), policy.two_cars)
    if found is None:
        return []
    if _separates_sets(found, train.recordings, test.recordings):
        return [f"the test recordings look like another floor or car: {found}. The gains are those "
                "of this model there, and not of its causes alone"]
    alone = [shlex.join(n for n in part if n in train.recordings)
             for part in (found.smaller, found.larger)]
    return [f"the recordings look like two floors or cars: {found}. Diagnose them separately: "
            + ", and ".join(f"--train {names}" for names in alone if names)]


def _separates_sets(found: RecordingGroups, train: Collection[str], test: Collection[str]) -> bool:
    """Return whether the two groups are the training and the test recordings."""
    return {frozenset(found.smaller), frozenset(found.larger)} == {
        frozenset(train), frozenset(test)}


def _list_bounds(changes: Mapping[str, ParameterChange], last: Point) -> list[str]:
    """Warn of parameters and command ages that ended on a bound."""
    out = []
    names = [name for name, change in changes.items() if change.doubt == AT_BOUND]
    if names:
        out.append(f"{shorten_list(names)} ended {AT_BOUND}: these recordings do not determine "
                   "it, or require a value that no such car has; look for a wrong unit, another "
                   "car's model, or a cause that is not in the catalogue")
    if last.timing.command_age > MAX_COMMAND_AGE - AGE_BOUND_TOLERANCE:
        out.append(f"the car acts {1000.0 * last.timing.command_age:.0f} ms before its commands "
                   f"are in the recording, {AT_BOUND}: the clocks of command and sensors differ. "
                   "Synchronise the clocks of all computers that record, and record again")
    return out
