"""What is suggested: a drive, the pairs it separates, and what each hypothesis predicts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from dart_hal.core.types import FloatArray

from ..policy import USUAL

ENOUGH = USUAL.suggest.separation


@dataclass(frozen=True, slots=True)
class Pair:
    """One effect and its confounder.

    before, after: standard deviations between the two with the data at hand and
    with the new drive alone, the smaller of both directions; the square is the
    robust loss that the better of the two saves. right: of the simulated
    repeats of the drive, the share in which the true one of the two fits
    better (NaN: not simulated). needed: standard deviations that tell them apart.
    """

    effect: str
    confounder: str
    before: float
    after: float
    right: float = float("nan")
    needed: float = ENOUGH

    @property
    def separated(self) -> bool:
        return self.after >= self.needed

    def to_json(self) -> dict[str, Any]:
        """{"effect", "rival", "before", "after", "right"}."""
        return {"effect": self.effect, "rival": self.confounder, "before": self.before,
                "after": self.after, "right": self.right}


@dataclass(frozen=True, slots=True)
class Prediction:
    """The drive as the two hypotheses that are hardest to separate see it, each (n,).

    t [s]; throttle, steering: commands -1..1; channel and unit of ``says``, by
    hypothesis: the truth and its confounder at its best; noise: standard deviation of
    one reading of that channel. Motion is compared at 0.01 s, a sensor at its
    messages.
    """

    t: FloatArray
    throttle: FloatArray
    steering: FloatArray
    channel: str
    unit: str
    at: FloatArray
    says: Mapping[str, FloatArray]
    noise: float

    def to_json(self) -> dict[str, Any]:
        """Arrays as lists."""
        return {"channel": self.channel, "unit": self.unit, "t": self.at.tolist(),
                "says": {k: v.tolist() for k, v in self.says.items()}, "noise": self.noise}


@dataclass(frozen=True, slots=True)
class Tried:
    """A drive that was simulated: seconds, and the least separation of any pair.

    needs: what it was judged by, as ``Suggestion.needs``.
    """

    drive: str
    seconds: float
    needs: str
    least: float

    def to_json(self) -> dict[str, Any]:
        """{"drive", "duration_s", "needs", "least"}."""
        return {"drive": self.drive, "duration_s": self.seconds, "needs": self.needs,
                "least": self.least}


@dataclass(frozen=True, slots=True)
class Suggestion:
    """What to drive next for one cause that has confounders.

    enough: whether it separates all pairs; if not, it is the one that comes
    nearest, or "" where no drive fits on the floor; "" as well where none is
    needed. commands: what to type,
    in order. needs: "motion capture" or "on-board sensors" alone. by_hand: what
    the effect's own page says, where no drive is needed or none is enough.
    values: size of each hypothesis that suits the data at hand, by effect.
    """

    cause: str
    confounders: tuple[str, ...]
    drive: str
    description: str
    commands: tuple[str, ...]
    seconds: float
    space: str
    needs: str
    enough: bool
    pairs: tuple[Pair, ...]
    values: Mapping[str, Mapping[str, float]]
    by_hand: str
    tried: tuple[Tried, ...]
    prediction: Prediction | None = None

    def sentence(self) -> str:
        """What to do and what it would show, in one line."""
        confounders = ", ".join(self.confounders)
        if not self.drive and self.enough:
            return f"the data at hand tell {self.cause} from {confounders} by themselves"
        if not self.drive:
            return f"no drive fits on this floor that could tell {self.cause} from {confounders}"
        drive = f"{self.drive} ({self.seconds:.0f} s"
        drive += ", with motion capture)" if self.needs == "motion capture" else ")"
        if self.enough:
            return f"drive {drive}: it would tell {self.cause} from {confounders}"
        others = sorted({p.confounder for p in self.pairs
                         if p.effect == self.cause and p.separated})
        many = len({t.drive for t in self.tried})
        return (f"none of {many} drives would tell {self.cause} from all of {confounders}; {drive} "
                "comes nearest" + (f" and tells it from {', '.join(others)}" if others else ""))

    def caution(self) -> str:
        """Why a drive may tell less than is promised, "" where nothing says so."""
        known = [p for p in self.pairs if p.effect == self.cause and p.before >= p.needed]
        if not known:
            return ""
        others = ", ".join(f"{p.confounder} ({p.before:.1f})" for p in known)
        return (f"by this measure the data at hand tell {self.cause} from {others} already; that "
                "they do not says that something else is wrong there, as large as the difference, "
                "and a new drive may have it as well")

    def to_json(self) -> dict[str, Any]:
        """One entry of ``--suggest --json``."""
        return {"cause": self.cause, "rivals": list(self.confounders), "drive": self.drive or None,
                "description": self.description, "commands": list(self.commands),
                "duration_s": self.seconds, "space": self.space, "needs": self.needs,
                "enough": self.enough, "caution": self.caution(),
                "pairs": [p.to_json() for p in self.pairs],
                "values": {k: dict(v) for k, v in self.values.items()},
                "by_hand": self.by_hand, "tried": [t.to_json() for t in self.tried],
                "prediction": self.prediction.to_json() if self.prediction else None}
