"""Include other models that fit equally well in the standard errors of the reported numbers.

Which effect is accepted decides the values of all other numbers: a front tyre that loses grip by
roll needs another stiffness than one that does not. With M other models that the data do not
distinguish from the accepted one, x_m the numbers of one and x those reported,

    C = C_sampling + sum_m (x_m - x)(x_m - x)^T / (M + 1)

is the covariance over all M + 1 models with equal weights, around the reported numbers (law of
total covariance; Bayesian model averaging, Hoeting et al. 1999, equation 3). A parameter that is
not in another model keeps its value in x_m.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.effects import apply, catalogue
from dart_hal.vehicle.flat import names as flat_names
from dart_lab.identification.evidence.residuals import Evidence, affects_readings_only
from dart_lab.identification.objective import Point, refit
from dart_lab.identification.shooting.fit import TYRE_SHAPE_NAMES

from .final_fit import FinalFit
from .policy import ScanPolicy
from .search.forward import ForwardSearch
from .search.scan import scan

# Relative standard errors of sizes that are not weighed or measured, by the effect that changes
# them: a car with another battery, and a mass that is distributed otherwise.
SIZE_ERRORS = {"mass": ("body.mass", 0.02), "yaw_inertia": ("body.yaw_inertia", 0.06)}
MAX_ALTERNATIVES = 6  # fitted models; each costs about as much as one round of the search


@dataclass(frozen=True, slots=True)
class Exchange:
    """An alternative model: the accepted one without an effect, with one more, or with another."""

    removed: str = ""
    added: str = ""


def list_exchanges(confounders: Mapping[str, Sequence[str]], likely: Sequence[str],
                   possible: Sequence[str]) -> tuple[Exchange, ...]:
    """List models with equal fit, of effects that change the motion of the car.

    confounders: by accepted effect, what the data do not distinguish from it; likely: accepted
    effects that are not confident; possible: effects that are not accepted but possible.
    """
    found = [Exchange(name, other) for name, others in confounders.items() for other in others]
    found += [Exchange(name) for name in likely]
    found += [Exchange(added=name) for name in possible]
    return tuple(e for e in found if all(_moves_car(n) for n in (e.removed, e.added) if n)
                 )[:MAX_ALTERNATIVES]


def include_alternatives(final: FinalFit, exchanges: Sequence[Exchange], search: ForwardSearch,
                         evidence: Evidence, policy: ScanPolicy) -> FinalFit:
    """Return the fit with standard errors that include those of other models.

    evidence: to which its point was fitted; policy: sizes that are tried of an effect.
    """
    moves = [move for e in exchanges
             if (move := _move(final.point, e, search, evidence, policy)) is not None]
    if not moves:
        return final
    # Between-model covariance: the accepted model has the move 0 and counts in the divisor.
    between = np.stack(moves)
    covariance = final.covariance + between.T @ between / (len(moves) + 1)
    point = final.point
    stds = point.space.standard_errors(point.x, covariance)
    return replace(final, covariance=covariance, stds={**final.stds, **stds})


def include_sizes(final: FinalFit, evidence: Evidence, known: Mapping[str, float]) -> FinalFit:
    """Return the fit with standard errors that include those of mass and yaw inertia.

    Forces are only known as well as the mass, and tyres as well as the inertia. A size with a
    standard error of its own (``known``) is a parameter of the fit, and one that an accepted effect
    changes is measured.
    """
    point = final.point
    has = {a.name for a in point.vehicle.effects}
    columns = []
    residual = point.noise.stack(evidence.residuals(point.vehicle, point.timing))[0]
    for effect, (size, error) in SIZE_ERRORS.items():
        if size in known or effect in has:
            continue
        changed = apply(point.vehicle, effect, k=error)
        columns.append(point.noise.stack(evidence.residuals(changed, point.timing))[0] - residual)
    if not columns:
        return final
    # A change of the residuals moves the minimum by -H^-1 A^T Omega times it.
    weighted = point.jacobian * point.irls_weight[:, None]
    moves = np.linalg.solve(point.normal, weighted.T @ np.stack(columns, axis=1))
    covariance = final.covariance + moves @ moves.T
    stds = point.space.standard_errors(point.x, covariance)
    return replace(final, covariance=covariance, stds={**final.stds, **stds})


def include_tyre_shape(final: FinalFit, search: ForwardSearch, evidence: Evidence) -> FinalFit:
    """Return the fit with standard errors that include that of the shape of the tyre curve.

    A fit keeps the shape of the base: below the grip limit the data hardly show it, and a free one
    predicts worse. With another shape the tyre has another stiffness and peak force, though. In a
    fit x' with a free shape, N' its normal matrix,

        C += inv(N')_xx - inv(N'_xx)       error of x by that of the shape
             + (x' - x) (x' - x)^T         its change
    """
    point = final.point
    names = tuple(name for name in (f"tyres.{key}" for key in TYRE_SHAPE_NAMES)
                  if name in flat_names(point.vehicle))
    if not names or not any(name.startswith("tyres.") for name in point.space.names):
        return final
    space = search.make_space(point.vehicle, names)
    x = space.transfer(space.start(point.vehicle, point.timing), point.space, point.x)
    other = refit(evidence, point.noise, space, x, point)
    kept = [i for i in range(len(other.x)) if i >= len(space.names) or space.names[i] not in names]
    grid = np.ix_(kept, kept)
    move = other.x[kept] - point.x
    covariance = (final.covariance + np.linalg.inv(other.normal)[grid]
                  - np.linalg.inv(other.normal[grid]) + np.outer(move, move))
    stds = point.space.standard_errors(point.x, covariance)
    return replace(final, covariance=covariance, stds={**final.stds, **stds})


def _move(point: Point, exchange: Exchange, search: ForwardSearch, evidence: Evidence,
          policy: ScanPolicy) -> FloatArray | None:
    """Return the change of the parameters (k,) in another model; None if it has the effect."""
    names = [a.name for a in point.vehicle.effects]
    if exchange.added in names or (exchange.removed and exchange.removed not in names):
        return None
    other = point
    if exchange.removed:
        other = search.remove_effect(evidence, point.noise, point, exchange.removed)
    if exchange.added:
        trial, = scan(evidence, other, (exchange.added,), policy=policy)
        other = search.add_effect(evidence, point.noise, other, trial)
    # A parameter that the other model lacks contributes no difference.
    x = np.array(point.x)
    places = {name: i for i, name in enumerate(other.space.names)}
    for i, name in enumerate(point.space.names):
        if name in places:
            x[i] = other.x[places[name]]
    return np.asarray(x - point.x)


def _moves_car(effect: str) -> bool:
    return not affects_readings_only(catalogue()[effect])
