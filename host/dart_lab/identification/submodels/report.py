"""Samples that each file gave to the fits, and the result of a fit that could not be made."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from dart_lab.identification.fit import FittedParameter, SubmodelFit
from dart_lab.identification.report import FileReport

# Sub-models in their order, with the units of their parameters as in ``model.toml``.
PARAMETER_UNITS: Mapping[str, Mapping[str, str]] = {
    "friction": {"a": "N", "b": "s/m", "c": "N s/m"},
    "motor": {"d": "N", "e": "N s/m", "g": "-"},
    "steering": {"k_left": "-", "a_left_rad": "rad", "s0": "-", "a_right_rad": "rad",
                 "k_right": "-"},
    "delay": {"steering_s": "s", "throttle_s": "s", "steering_lag_s": "s", "throttle_lag_s": "s"},
    "tyres": {"front_D": "N", "front_C": "-", "front_B": "1/rad", "front_E": "-",
              "rear_cornering_stiffness": "N/rad"},
}


@dataclass(slots=True)
class Ledger:
    """Collects the samples that each sub-model used of each file, and the reasons."""

    used: dict[str, int] = field(default_factory=dict)
    dropped: dict[str, int] = field(default_factory=dict)
    why: dict[str, list[str]] = field(default_factory=dict)

    def add(self, file: str, used: int, dropped: int, why: Iterable[str] = ()) -> None:
        """Count samples of ``file``; reasons are listed once each."""
        self.used[file] = self.used.get(file, 0) + used
        self.dropped[file] = self.dropped.get(file, 0) + dropped
        known = self.why.setdefault(file, [])
        known += [text for text in why if text not in known]

    def reports(self) -> dict[str, FileReport]:
        """Return one report per file, in the order of the first ``add``."""
        return {file: FileReport(self.used[file], self.dropped[file], tuple(self.why[file]))
                for file in self.used}


def make_unidentified(submodel: str, values: Mapping[str, float], notes: Sequence[str],
                      cpu_s: float = 0.0) -> SubmodelFit:
    """Make the result of a fit that was not possible: base values, nothing identified."""
    units = PARAMETER_UNITS[submodel]
    k = len(units)
    return SubmodelFit(submodel, {name: FittedParameter(values[name], math.inf, unit, False)
                                  for name, unit in units.items()},
                       np.full((k, k), np.inf), 0, 0.0, "", False, (), cpu_s, tuple(notes))
