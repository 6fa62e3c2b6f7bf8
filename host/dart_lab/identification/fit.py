"""What a fit gives: values with standard errors, and how far they can be trusted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from dart_hal.core.types import FloatArray

TIME_KNOWN = 0.02
"""s; a delay or lag counts as identified below this standard error: a time may be 0, so no share
of the value can be asked for, and 0.02 s is one frame of the PWM."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """value and one standard error in ``unit``; ``identifiable``: the data tell it.

    std is infinite where the data say nothing at all about the parameter.
    """

    value: float
    std: float
    unit: str
    identifiable: bool = True


@dataclass(frozen=True, slots=True)
class Fit:
    """One sub-model fitted to data.

    parameters by their names in ``model.toml``; covariance (k, k) in the same
    order; n residuals of root mean square ``rmse`` and mean square ``loss``
    (plain, without robust weights) in ``unit``; ``at_bound``: parameters that
    stopped at the edge of their interval; ``notes``: what the reader must know;
    ``details``: numbers of the fit that a picture shows, by name.
    """

    submodel: str
    parameters: Mapping[str, Estimate]
    covariance: FloatArray
    n: int
    rmse: float
    unit: str
    converged: bool
    at_bound: tuple[str, ...] = ()
    cpu_s: float = 0.0
    notes: tuple[str, ...] = field(default=())
    details: Mapping[str, float] = field(default_factory=dict)

    @property
    def loss(self) -> float:
        """Mean square of the residuals [unit^2]."""
        return self.rmse**2

    @property
    def sound(self) -> bool:
        """Converged inside its bounds: fit to be written to a model file."""
        return self.converged and not self.at_bound

    def values(self) -> dict[str, float]:
        """The plain numbers by name."""
        return {name: entry.value for name, entry in self.parameters.items()}

    def to_json(self) -> dict[str, Any]:
        """As ``dart-hal identify --json`` prints it."""
        return {
            "parameters": {name: {"value": e.value, "std": e.std, "unit": e.unit}
                           for name, e in self.parameters.items()},
            "covariance": self.covariance.tolist(), "n": self.n, "rmse": self.rmse,
            "loss": self.loss, "unit": self.unit, "converged": self.converged,
            "at_bound": list(self.at_bound), "cpu_s": self.cpu_s, "notes": list(self.notes),
            "identifiable": {name: e.identifiable for name, e in self.parameters.items()}}
