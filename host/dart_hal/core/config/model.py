"""``model.toml``: identified parameters and effects; their structure is checked here.

The meaning of the parameters and the list of effects are defined in ``vehicle``.
"""

from __future__ import annotations

from typing import Any, Literal

import msgspec
import numpy as np

from dart_hal.core.config.parse import parse, require, unknown_key_error
from dart_hal.core.config.quantity import FileTable, Quantity
from dart_hal.core.errors import ConfigError

MODEL_SCHEMA = "dart-hal/model/1"
# V, from one empty cell to twelve full ones.
MOTOR_VOLTAGE_RANGE = (2.5, 55.0)
# Of a correlation: a file states covariances with six digits.
MAX_ROUNDING_ERROR = 1e-4
Parameter = float | Quantity
Parameters = dict[str, Parameter]

# Sections of model.toml and the parameters of each (units: see ``vehicle``).
MODEL_PARAMETERS: dict[str, tuple[str, ...]] = {
    "body": ("wheelbase", "l_f", "l_r", "mass", "yaw_inertia", "front_share"),
    "friction": ("a", "b", "c", "q"),
    "motor": ("d", "e", "g", "reverse", "gain", "max_force"),
    "steering": ("k_left", "a_left_rad", "s0", "a_right_rad", "k_right"),
    "delay": ("steering_s", "throttle_s", "steering_lag_s", "throttle_lag_s"),
    "tyres": ("front_D", "front_C", "front_B", "front_E", "rear_cornering_stiffness", "rear_max",
              "rear_D", "rear_C", "rear_B"),
}


# Keys of model.toml with their type and meaning, for the reference page.
MODEL_KEYS: dict[str, tuple[str, str]] = {
    "schema": ("text", f"kind and version of the file: `{MODEL_SCHEMA}`"),
    "name": ("text", "name of the model in tables and reports"),
    "kind": ("`dynamic` or `kinematic`", "bicycle that moves the car: with slip of the tyres, or "
             "without"),
    "motor_voltage": ("number [V]", "voltage of the battery at which the parameters of the motor "
                      "hold; with it, `battery_fade` follows the measured voltage, without it the "
                      "time, as in all files of version 0.1"),
    "body": ("table", "sizes and inertia of the car"),
    "friction": ("table", "resistance to rolling"),
    "motor": ("table", "force of the motor at the wheels"),
    "steering": ("table", "map from a steering command to the angle of the road wheels"),
    "delay": ("table", "delays and lags of both commands"),
    "tyres": ("table", "side forces of the tyres"),
    "forms": ("table of texts", "variants of the equations: `slip` = `all_speeds`, `paper` or "
              "`upstream`, the form of the slip angles; `motor` = `duty` or `speed`, what commands "
              "the motor"),
    "speed_loop": ("table of numbers", "numbers of a speed loop of your own; kept and not used"),
    "effects": ("list of tables", "what the car has beyond the base model: `name` of an effect and "
                "its `parameters`"),
    "covariance": ("table", "covariance of parameters that were fitted together: `names` (n) of "
                   "the form `section.key`, `matrix` (n, n) in their units"),
    "provenance": ("table", "who wrote the file: command, version, base, SHA-256 of the "
                   "recordings, source of the sizes"),
}


class EffectEntry(FileTable, frozen=True):
    """One effect of the catalogue with its parameters."""

    name: str
    parameters: Parameters = msgspec.field(default_factory=dict)


class Covariance(FileTable, frozen=True):
    """Covariance (n, n) of parameters that were fitted together; names "section.key"."""

    names: tuple[str, ...]
    matrix: tuple[tuple[float, ...], ...]


class ModelFile(FileTable, frozen=True, kw_only=True):
    """A vehicle model as a file: parameters by section, effects in the order of application.

    ``forms``: variants of the equations, such as "slip" (``vehicle.tyres.make_slip``)
    and "motor" ("duty" or "speed", ``vehicle.motor``);
    ``speed_loop``: gains of ``drive_speed``; ``motor_voltage`` [V]: of the battery, at which the
    motor's parameters hold, None if unknown; ``provenance``: hashes of the data, command.
    """

    schema: str = MODEL_SCHEMA
    name: str
    kind: Literal["kinematic", "dynamic"]
    motor_voltage: float | None = None
    body: Parameters
    friction: Parameters = msgspec.field(default_factory=dict)
    motor: Parameters = msgspec.field(default_factory=dict)
    steering: Parameters = msgspec.field(default_factory=dict)
    delay: Parameters = msgspec.field(default_factory=dict)
    tyres: Parameters = msgspec.field(default_factory=dict)
    forms: dict[str, str] = msgspec.field(default_factory=dict)
    speed_loop: dict[str, float] = msgspec.field(default_factory=dict)
    effects: tuple[EffectEntry, ...] = ()
    covariance: dict[str, Covariance] = msgspec.field(default_factory=dict)
    provenance: dict[str, Any] = msgspec.field(default_factory=dict)

    def values(self, section: str) -> dict[str, float]:
        """Return the values of one section without standard errors."""
        return {key: plain(entry) for key, entry in getattr(self, section).items()}


def plain(entry: Parameter) -> float:
    """Return the value of a parameter, with or without a standard error."""
    return entry.value if isinstance(entry, Quantity) else float(entry)


def parse_model(text: str, origin: str) -> ModelFile:
    """Read the text of a model.toml. Raises ConfigError with ``origin`` and key."""
    return check_model(parse(text, ModelFile, origin), origin)


def check_model(model: ModelFile, origin: str) -> ModelFile:
    """Check the keys and numbers of a model and return it. Raises ConfigError."""
    for section, known in MODEL_PARAMETERS.items():
        for key, entry in getattr(model, section).items():
            if key not in known:
                raise unknown_key_error(key, known, origin, section)
            _check_entry(entry, f"{section}.{key}", origin)
    volt = model.motor_voltage
    low, high = MOTOR_VOLTAGE_RANGE
    require(volt is None or low <= volt <= high, origin, "motor_voltage", volt,
            f"{low:g} to {high:g} V")
    for effect in model.effects:
        for key, entry in effect.parameters.items():
            _check_entry(entry, f"effects.{effect.name}.{key}", origin)
    for name, table in model.covariance.items():
        _check_covariance(table, f"covariance.{name}", model, origin)
    return model


def list_parameters(model: ModelFile) -> list[str]:
    """Return the names of all parameters of a model, "section.key" and "effect.parameter"."""
    return [f"{section}.{one}" for section in MODEL_PARAMETERS for one in getattr(model, section)
            ] + [f"{effect.name}.{one}" for effect in model.effects for one in effect.parameters]


def _check_covariance(table: Covariance, key: str, model: ModelFile, origin: str) -> None:
    """Raise ConfigError unless the names are parameters and the matrix is a covariance of them."""
    n = len(table.names)
    if [len(row) for row in table.matrix] != [n] * n:
        raise ConfigError(f"{origin}: {key}.matrix is not {n} x {n}",
                          found=str([len(row) for row in table.matrix]), read=origin,
                          expected=f"{n} rows of {n}, one for each name",
                          remedy="identify the model again")
    known = list_parameters(model)
    for name in table.names:
        if name not in known:
            raise unknown_key_error(name, known, origin, f"{key}.names")
    require(len(set(table.names)) == n, origin, f"{key}.names", table.names, "each name once")
    matrix = np.array(table.matrix)
    std = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    outside = np.abs(matrix) > (1.0 + MAX_ROUNDING_ERROR) * np.outer(std, std)
    correlation = matrix / np.maximum(np.outer(std, std), np.finfo(float).tiny)
    if (np.diag(matrix) < 0.0).any() or outside.any() or not np.allclose(
            matrix, matrix.T, rtol=MAX_ROUNDING_ERROR) or (
            n and np.linalg.eigvalsh(correlation).min() < -MAX_ROUNDING_ERROR):
        raise ConfigError(f"{origin}: {key}.matrix is no covariance", read=origin,
                          found="a matrix that is not symmetric or not positive semidefinite",
                          expected="a symmetric, positive semidefinite matrix",
                          remedy=f"remove [{key}], or identify the model again")


def _check_entry(entry: Parameter, key: str, origin: str) -> None:
    if isinstance(entry, Quantity):
        require(entry.std >= 0, origin, f"{key}.std", entry.std, ">= 0")
