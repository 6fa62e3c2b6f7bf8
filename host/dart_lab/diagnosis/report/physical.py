"""Sizes of effects in physical terms: what a parameter is, in the unit that a reader knows."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from dart_hal.vehicle.effects import catalogue
from dart_hal.vehicle.parameters import GRAVITY
from dart_lab.diagnosis.result import Cause, ParameterEstimate
from dart_lab.report.numbers import significant, with_error

# By unit of the catalogue: factor and unit of the report.
SCALES: Mapping[str, tuple[float, str]] = {
    "relative": (100.0, "%"), "s": (1000.0, "ms"), "m": (1000.0, "mm"),
    "-": (1.0, ""), "share": (1.0, "")}
# By unit: the same size in ordinary driving.
EXAMPLES: Mapping[str, Callable[[float], str]] = {
    "rad": lambda k: f"{significant(math.degrees(k))} deg",
    "1/N": lambda k: f"{significant(1.0 / k)} N",
    "N/rad": lambda k: f"{significant(0.35 * k)} N at 0.35 rad",
    "N s/m": lambda k: f"{significant(2.0 * k)} N at 2 m/s",
    "N s2/m2": lambda k: f"{significant(4.0 * k)} N at 2 m/s",
    "N m2": lambda k: f"{significant(k)} N m on a circle of 1 m radius",
    "N m s": lambda k: f"{significant(3.0 * k)} N m at 3 rad/s",
    "rad/N": lambda k: f"{significant(5.0 * math.degrees(k))} deg at 5 N",
    "s2/m": lambda k: f"{significant(200.0 * k)} % at 2 m/s2",
    "m/s2": lambda k: f"a slope of {significant(100.0 * k / GRAVITY)} cm in 1 m"}


def describe_size(cause: Cause) -> str:
    """Describe each parameter of a cause and its size with the standard error.

    Parameters that are no effect by themselves, for example a phase, are only in the tables.
    """
    known = {q.name: q for q in catalogue()[cause.effect].parameters}
    return ", ".join(f"{known[name].meaning} {_size(known[name].meaning, number)}"
                     for name, number in cause.parameters.items() if known[name].alone)


def main_size(cause: Cause) -> str:
    """Return the sizes of a cause without their meanings: "119 +- 4 ms"; "" for none."""
    known = {q.name: q for q in catalogue()[cause.effect].parameters}
    return ", ".join(_value(known[name].meaning, number)
                     for name, number in cause.parameters.items() if known[name].alone)


def _size(meaning: str, number: ParameterEstimate) -> str:
    """Return a size with an example: "0.0845 +- 0.0041 rad (4.84 deg)"."""
    example = EXAMPLES.get(number.unit)
    shown = f" ({example(number.value)})" if example is not None and number.value else ""
    return _value(meaning, number) + shown


def _value(meaning: str, number: ParameterEstimate) -> str:
    """Return "119 +- 4 ms", "+5.9 +- 0.1 %"."""
    is_share = meaning.startswith("share")
    factor, unit = (100.0, "%") if is_share else SCALES.get(number.unit, (1.0, number.unit))
    sign = "+" if unit == "%" and not is_share and number.value > 0.0 else ""
    value = factor * number.value
    std = factor * number.std
    known = math.isfinite(std) and std > 0.0
    text = sign + (with_error(value, std) if known else significant(value))
    return f"{text} {unit}".rstrip()
