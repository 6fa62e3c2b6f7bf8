"""DART-Lab: simulate, identify, evaluate and diagnose small cars, on a workstation.

    from dart_hal import find_model, read_any
    from dart_lab import diagnose

    file, vehicle = find_model("paper")
    train, test = (read_any([folder])[0] for folder in ("training", "test"))
    print(diagnose(file, vehicle, train, test).causes)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dart_hal.vehicle.effect import Effect, Parameter
    from dart_hal.vehicle.effects import apply, catalogue
    from dart_lab.diagnosis.inputs import check_inputs
    from dart_lab.diagnosis.report import write_page
    from dart_lab.diagnosis.result import Diagnosis
    from dart_lab.diagnosis.run import diagnose
    from dart_lab.diagnosis.write import extended_model
    from dart_lab.identification.evaluation import evaluate
    from dart_lab.identification.experiment.floor import Floor
    from dart_lab.identification.experiment.make import conduct, make_plan
    from dart_lab.identification.outcome import Identification, identify
    from dart_lab.sim.light import LightBatch, LightCar, LightConfig, LightWorld

__all__ = [
    "Diagnosis", "Effect", "Floor", "Identification", "LightBatch", "LightCar", "LightConfig",
    "LightWorld", "Parameter", "apply", "catalogue", "check_inputs", "conduct", "diagnose",
    "evaluate", "extended_model", "identify", "make_plan", "write_page",
]

_MODULES = {
    "dart_hal.vehicle.effect": ("Effect", "Parameter"),
    "dart_hal.vehicle.effects": ("apply", "catalogue"),
    "dart_lab.diagnosis.inputs": ("check_inputs",),
    "dart_lab.diagnosis.report": ("write_page",),
    "dart_lab.diagnosis.result": ("Diagnosis",),
    "dart_lab.diagnosis.run": ("diagnose",),
    "dart_lab.diagnosis.write": ("extended_model",),
    "dart_lab.identification.evaluation": ("evaluate",),
    "dart_lab.identification.experiment.floor": ("Floor",),
    "dart_lab.identification.experiment.make": ("conduct", "make_plan"),
    "dart_lab.identification.outcome": ("Identification", "identify"),
    "dart_lab.sim.light": ("LightBatch", "LightCar", "LightConfig", "LightWorld"),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Load on first use."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'dart_lab' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    """The public names, for completion."""
    return sorted(__all__)
