"""Result of ``suggest``: a drive, the pairs that it separates, and the predictions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from dart_hal.core.types import FloatArray

from ..policy import USUAL

MIN_SEPARATION = USUAL.suggest.separation


@dataclass(frozen=True, slots=True)
class Pair:
    """One effect and its confounder.

    before, after: standard deviations between the two with the data at hand and with the new drive
    alone, the smaller of both directions; the square is the robust loss that the better of the two
    saves. right: share of the simulated repeats of the drive in which the true one of the two fits
    better (NaN: not simulated). needed: standard deviations that distinguish them.
    """

    effect: str
    confounder: str
    before: float
    after: float
    right: float = float("nan")
    needed: float = MIN_SEPARATION

    @property
    def is_separated(self) -> bool:
        """Check that the drive distinguishes the two."""
        return self.after >= self.needed

    def to_json(self) -> dict[str, Any]:
        """{"effect", "rival", "before", "after", "right"}."""
        return {"effect": self.effect, "rival": self.confounder, "before": self.before,
                "after": self.after, "right": self.right}


@dataclass(frozen=True, slots=True)
class DrivePrediction:
    """Prediction of the drive by the two hypotheses that are hardest to separate, each (n,).

    t [s]; throttle, steering: commands -1..1; channel, unit: of ``curves``, the readings by
    hypothesis: the true effect and its fitted confounder; noise: standard deviation of one reading
    of that channel. Motion is compared every 0.01 s, a sensor at its messages.
    """

    t: FloatArray
    throttle: FloatArray
    steering: FloatArray
    channel: str
    unit: str
    at: FloatArray
    curves: Mapping[str, FloatArray]
    noise: float

    def to_json(self) -> dict[str, Any]:
        """JSON object with arrays as lists."""
        return {"channel": self.channel, "unit": self.unit, "t": self.at.tolist(),
                "says": {k: v.tolist() for k, v in self.curves.items()}, "noise": self.noise}


@dataclass(frozen=True, slots=True)
class TriedDrive:
    """A simulated drive: its duration, and the smallest separation of any pair.

    needs: as ``Suggestion.needs``.
    """

    drive: str
    seconds: float
    needs: str
    min_separation: float

    def to_json(self) -> dict[str, Any]:
        """{"drive", "duration_s", "needs", "least"}."""
        return {"drive": self.drive, "duration_s": self.seconds, "needs": self.needs,
                "least": self.min_separation}


@dataclass(frozen=True, slots=True)
class Suggestion:
    """The next drive for one cause that has confounders.

    enough: the drive separates all pairs. Otherwise it is the one that comes closest. drive: "" if
    no drive fits on the floor, or if none is needed. commands: shell commands in order. needs:
    "motion capture", or "on-board sensors" alone. by_hand: the check that the page of the effect
    recommends, if no drive is needed or none is enough. values: by effect, its size that fits the
    data at hand.
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
    tried: tuple[TriedDrive, ...]
    prediction: DrivePrediction | None = None

    def sentence(self) -> str:
        """Describe the drive and its benefit in one line."""
        confounders = ", ".join(self.confounders)
        if not self.drive and self.enough:
            return f"these data already distinguish {self.cause} from {confounders}"
        if not self.drive:
            return (f"no drive that distinguishes {self.cause} from {confounders} fits on "
                    "this floor")
        drive = f"{self.drive} ({self.seconds:.0f} s"
        drive += ", with motion capture)" if self.needs == "motion capture" else ")"
        if self.enough:
            return f"drive {drive}: it distinguishes {self.cause} from {confounders}"
        others = sorted({p.confounder for p in self.pairs
                         if p.effect == self.cause and p.is_separated})
        many = len({t.drive for t in self.tried})
        return (f"none of {many} drives distinguishes {self.cause} from all of {confounders}; "
                f"{drive} comes closest"
                + (f" and distinguishes it from {', '.join(others)}" if others else ""))

    def caution(self) -> str:
        """Explain why a drive may be less informative than predicted; "" if there is no reason."""
        known = [p for p in self.pairs if p.effect == self.cause and p.before >= p.needed]
        if not known:
            return ""
        others = ", ".join(f"{p.confounder} ({p.before:.1f})" for p in known)
        return (f"by this measure these data already distinguish {self.cause} from {others}. The "
                "diagnosis does not: another error of the model, as large as the difference, may "
                "be present, also in a new drive")

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
