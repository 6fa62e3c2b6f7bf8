"""What a diagnosis was asked."""

from __future__ import annotations

from dataclasses import dataclass

from dart_hal.vehicle.parameters import Vehicle

from .gains import Side
from .search.forward import ForwardSearch
from .search.selection import Settings


@dataclass(frozen=True, slots=True)
class Question:
    """What was asked: the base model, both sides, and the search with its settings.

    predictor: whether the best predictor is wanted. frame: parameters of the marker frame that move
    with every fit.
    """

    model: str
    base: Vehicle
    train: Side
    test: Side
    settings: Settings
    refit: bool
    search: ForwardSearch
    predictor: bool = False
    frame: tuple[str, ...] = ()
