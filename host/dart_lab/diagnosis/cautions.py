"""What must be said beside a conclusion: of the recordings, and of what the fit ran into."""

from __future__ import annotations

import math
import shlex
from collections.abc import Collection, Mapping, Sequence

from dart_lab.report.numbers import some

from .evidence.space import MAX_COMMAND_AGE
from .gains import Side
from .grade.alike import Apart, apart, beside, wanted
from .policy import ConclusionPolicy, Policy
from .report.words import channel
from .result import Cause, Gained, Moved
from .search.fit import Point

EDGE = "at the edge of what is allowed"
CLOSE = 1e-3  # s; nearer to a bound it is there


def cautions(last: Point, sides: tuple[Side, Side], moved: Mapping[str, Moved],
             gain: Mapping[str, Gained], causes: Sequence[Cause], policy: Policy
             ) -> tuple[str, ...]:
    """In the order of their weight.

    last: the final fit; sides: training and test recordings; moved: what the refit changed, empty
    where there was none; gain: of the final model over the base.
    """
    out = _alike(last, sides, policy)
    if not moved:
        return tuple(out)
    out += _edges(moved, last)
    worse = worse_at(gain, policy.conclusion)
    if worse and not causes:
        out.append("with refitted parameters the model predicts the test recordings worse "
                   f"({', '.join(map(channel, worse))}): these training recordings do not "
                   "determine the parameters. Record more driving like that of the test "
                   "recordings, or use --no-refit")
    return tuple(out)


def worse_at(gain: Mapping[str, Gained], policy: ConclusionPolicy) -> list[str]:
    """Channels of the test recordings that are surely predicted worse; by much, where they are
    too short for an interval."""
    return [name for name, g in gain.items()
            if g.high < 0.0 or (not math.isfinite(g.high) and g.test < -policy.worse)]


def _alike(last: Point, sides: tuple[Side, Side], policy: Policy) -> list[str]:
    """Whether the recordings are of one car on one floor."""
    train, test = (wanted(side.evidence, side.names, last, policy) for side in sides)
    found = apart(beside(train, test), policy.alike)
    if found is None:
        return []
    if _split(found, train.recordings, test.recordings):
        return [f"the test recordings look like another floor or car: {found}. The gains are those "
                "of this model there, and not of its causes alone"]
    alone = [shlex.join(n for n in part if n in train.recordings)
             for part in (found.fewer, found.more)]
    return [f"the recordings look like two floors or cars: {found}. Diagnose them apart: "
            + ", and ".join(f"--train {names}" for names in alone if names)]


def _split(found: Apart, train: Collection[str], test: Collection[str]) -> bool:
    """Whether the two groups are the two sides."""
    return {frozenset(found.fewer), frozenset(found.more)} == {frozenset(train), frozenset(test)}


def _edges(moved: Mapping[str, Moved], last: Point) -> list[str]:
    """What ended where the fit may go no further."""
    out = []
    names = [name for name, m in moved.items() if m.doubt == EDGE]
    if names:
        out.append(f"{some(names)} ended {EDGE}: these recordings do not tell it, or ask for what "
                   "no such car has; look for a wrong unit, another car's model, or a cause that "
                   "is not in the catalogue")
    if last.timing.command_age > MAX_COMMAND_AGE - CLOSE:
        out.append(f"the car acts {1000.0 * last.timing.command_age:.0f} ms before its commands "
                   f"are in the recording, {EDGE}: the clocks of command and sensors differ. "
                   "Synchronise the clocks of all computers that record, and record again")
    return out
