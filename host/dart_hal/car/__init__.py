"""The facade: ``Car``, ``Fleet`` and ``join``, all that a controller needs."""

from dart_hal.core.lazy import read_public_names

# The names are in __init__.pyi: one car needs no fleet.
__getattr__, __dir__, __all__ = read_public_names(__name__, __file__)
