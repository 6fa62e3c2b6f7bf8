"""A ``model.toml`` as a vehicle; what it leaves out is the paper's."""

from __future__ import annotations

from dataclasses import replace

from dart_hal.config import ModelFile
from dart_hal.vehicle.parameters import AxleTyres, PaperTyres, Vehicle
from dart_hal.vehicle.sets import PAPER

GROUPS = ("body", "friction", "motor", "steering", "delay")


def vehicle_of(model: ModelFile | None) -> Vehicle:
    """The vehicle of a model file; None = the paper's. Raises ConfigError on a bad value."""
    if model is None:
        return PAPER
    groups = {name: replace(getattr(PAPER, name), **model.values(name)) for name in GROUPS}
    given = model.values("tyres")
    tyres: PaperTyres | AxleTyres
    if "rear_D" in given:
        tyres = AxleTyres(**given)
    else:
        assert isinstance(PAPER.tyres, PaperTyres)
        tyres = replace(PAPER.tyres, **given)
    return replace(PAPER, name=model.name, tyres=tyres, **groups)
