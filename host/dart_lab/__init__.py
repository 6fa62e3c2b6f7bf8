"""DART-Lab: simulate, identify, evaluate and diagnose small cars, on a workstation.

    from dart_hal import find_model, read_any
    from dart_lab import diagnose

    file, vehicle = find_model("paper")
    train, test = (read_any([folder])[0] for folder in ("training", "test"))
    print(diagnose(file, vehicle, train, test).causes)
"""

from __future__ import annotations

from dart_hal.core.lazy import read_public_names

# The names are in __init__.pyi.
__getattr__, __dir__, __all__ = read_public_names(__name__, __file__)
