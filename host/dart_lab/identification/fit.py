"""Result of a fit: values with standard errors, and whether they can be trusted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from dart_hal.core.types import FloatArray

# [s] Largest standard error of an identified delay or lag. A time may be 0, so no share of its
# value can be required; 0.02 s is one frame of the PWM.
MAX_TIME_STD = 0.02


@dataclass(frozen=True, slots=True)
class FittedParameter:
    """Value and standard error of a parameter in ``unit``; std is infinite without information."""

    value: float
    std: float
    unit: str
    identifiable: bool = True


@dataclass(frozen=True, slots=True)
class SubmodelFit:
    """One sub-model fitted to data.

    parameters: by their names in ``model.toml``; covariance (k, k): in the same order; n: number
    of residuals; rmse: their root mean square [unit], without robust weights; at_bound:
    parameters that stopped at a bound; notes: sentences for the user; details: further numbers
    of the fit for pictures, by name.
    """

    submodel: str
    parameters: Mapping[str, FittedParameter]
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
        """Whether the fit converged inside its bounds, so that it may be written to a model."""
        return self.converged and not self.at_bound

    @property
    def identifies_any(self) -> bool:
        """Whether the data identify any of its parameters."""
        return any(entry.identifiable for entry in self.parameters.values())

    def values(self) -> dict[str, float]:
        """Return the values by name."""
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
