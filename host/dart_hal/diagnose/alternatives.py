"""Other models that the data do not order, and how far the reported numbers move with them.

Which effect is accepted decides the values of all other numbers: a front tyre that loses grip by
roll needs another stiffness than one that does not. With M other models that the data do not
distinguish from the accepted one, x_m the numbers of one and x those reported,

    C = C_sampling + sum_m (x_m - x)(x_m - x)^T / (M + 1)

is the covariance over all M + 1 models with equal weights, around the reported numbers (law of
total covariance; Bayesian model averaging, Hoeting et al. 1999, equation 3). What another model has
not is not moved by it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.types import FloatArray
from dart_hal.vehicle.effects import apply, catalogue
from dart_hal.vehicle.parameters import Vehicle

from .evidence.residuals import Evidence, only_read
from .final_fit import FinalFit
from .search.fit import Point, refit_near, refit_with
from .search.forward import Search
from .search.scan import scan

MAX_ALTERNATIVES = 6
"""Models that are fitted, nearest first: each costs about as much as one round of the search."""


@dataclass(frozen=True, slots=True)
class Exchange:
    """One model: the accepted one with an effect removed, one added, or one for another."""

    removed: str = ""
    added: str = ""

    def __str__(self) -> str:
        """In words, as a report says it."""
        if not self.removed:
            return f"with {self.added}"
        return f"with {self.added} for {self.removed}" if self.added else f"without {self.removed}"


def list_exchanges(confounders: Mapping[str, Sequence[str]], unsure: Sequence[str],
                   possible: Sequence[str]) -> tuple[Exchange, ...]:
    """List models that the data do not order, of those that change how the car moves.

    confounders: by accepted effect, what the data do not distinguish from it; unsure: accepted
    effects that are not confident; possible: effects that are not accepted but possible.
    """
    found = [Exchange(name, other) for name, others in confounders.items() for other in others]
    found += [Exchange(name) for name in unsure]
    found += [Exchange(added=name) for name in possible]
    return tuple(e for e in found if all(_moves_car(n) for n in (e.removed, e.added) if n)
                 )[:MAX_ALTERNATIVES]


def include_alternatives(final: FinalFit, exchanges: Sequence[Exchange], search: Search,
                         evidence: Evidence) -> FinalFit:
    """Return the fit with standard errors that include those of other models.

    evidence: to which its point was fitted.
    """
    moves = [move for e in exchanges
             if (move := _move(final.point, e, search, evidence)) is not None]
    if not moves:
        return final
    between = np.stack(moves)
    covariance = final.covariance + between.T @ between / (len(moves) + 1)
    point = final.point
    stds = point.space.standard_errors(point.x, covariance)
    return replace(final, covariance=covariance, stds={**final.stds, **stds})


def _move(point: Point, exchange: Exchange, search: Search, evidence: Evidence
          ) -> FloatArray | None:
    """By how much the numbers (k,) of a fit differ in another model; None if it has the effect."""
    names = [a.name for a in point.vehicle.effects]
    if exchange.added in names or (exchange.removed and exchange.removed not in names):
        return None
    other = point
    if exchange.removed:
        vehicle = replace(point.vehicle, effects=tuple(
            a for a in point.vehicle.effects if a.name != exchange.removed))
        other = _fit(vehicle, point, search, evidence)
    if exchange.added:
        trial, = scan(evidence, other, (exchange.added,))
        vehicle = apply(other.vehicle, exchange.added, **trial.values)
        space = search.make_space(vehicle)
        other = refit_with(evidence, point.noise, space, space.start(vehicle, other.timing), other,
                           trial.residual.astype(np.float64))
    x = np.array(point.x)
    places = {name: i for i, name in enumerate(other.space.names)}
    for i, name in enumerate(point.space.names):
        if name in places:
            x[i] = other.x[places[name]]
    return np.asarray(x - point.x)


def _fit(vehicle: Vehicle, near: Point, search: Search, evidence: Evidence) -> Point:
    space = search.make_space(vehicle)
    x = space.carried(space.start(vehicle, near.timing), near.space, near.x)
    return refit_near(evidence, near.noise, space, x, near)


def _moves_car(effect: str) -> bool:
    return not only_read(catalogue()[effect])
