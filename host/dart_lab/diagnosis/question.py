"""Input of the conclusion of a diagnosis."""

from __future__ import annotations

from dataclasses import dataclass

from dart_hal.vehicle.parameters import Vehicle

from .gains import RecordingSet
from .search.forward import ForwardSearch
from .search.selection import Settings


@dataclass(frozen=True, slots=True)
class DiagnosisSetup:
    """Base model, training and test recordings, and the search with its settings.

    predictor: whether to find the best predictor. frame: parameters of the marker frame that every
    fit estimates.
    """

    model: str
    base: Vehicle
    train: RecordingSet
    test: RecordingSet
    settings: Settings
    refit: bool
    search: ForwardSearch
    predictor: bool = False
    frame: tuple[str, ...] = ()
