"""Summaries of errors: ratios over recordings, the largest ones, and paths of single windows."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np

from dart_hal.core.types import FloatArray
from dart_lab.identification.evaluation.prediction import CHANNELS

# RMSE over the noise floor, above which a model is not faultless: three quarters of the mean square
# error then come from something else than noise. The largest of 144 simulated drives that hide
# nothing is 1.5, see docs/results/noise_floor.md.
MAX_OVER_FLOOR = 2.0


def as_json(value: Any) -> Any:
    """Return a value in JSON types; an object with a method ``to_json`` becomes its result."""
    if hasattr(value, "to_json"):
        return value.to_json()
    if isinstance(value, Mapping):
        return {key: as_json(one) for key, one in value.items()}
    return [as_json(one) for one in value] if isinstance(value, tuple) else value


class JsonFields:
    """A dataclass whose JSON object has all its fields, by their names."""

    __slots__ = ()

    def to_json(self) -> dict[str, Any]:
        """The fields, each by ``as_json``."""
        return {f.name: as_json(getattr(self, f.name))
                for f in fields(self)}  # type: ignore[arg-type]  # a dataclass


class Ratio(NamedTuple):
    """A geometric mean of ratios, and the ends of its 90 % interval."""

    value: float
    low: float
    high: float


def geometric_mean(ratios: Iterable[float]) -> Ratio:
    """Geometric mean of ratios of recordings; the interval is Student's over their logarithms."""
    from scipy.special import stdtrit  # takes half a second, which --help need not wait for

    logs = np.log(list(ratios))
    std = float(np.std(logs, ddof=1)) / math.sqrt(len(logs))
    half = float(stdtrit(len(logs) - 1, 0.95)) * std
    mean = float(logs.mean())
    return Ratio(math.exp(mean), math.exp(mean - half), math.exp(mean + half))


@dataclass(frozen=True, slots=True)
class HeldOutError:
    """RMS errors 1 s ahead in a held-out recording, by fits to the others, as CHANNELS.

    refitted: parameters alone; predictor: with the effects of the best predictor.
    """

    refitted: tuple[float, ...]
    predictor: tuple[float, ...]

    @property
    def ratio(self) -> float:
        """Error of the predictor over that of the refit, geometric mean over the channels."""
        return float(np.exp(np.log(np.array(self.predictor) / np.array(self.refitted)).mean()))

    def to_json(self) -> dict[str, Any]:
        """As in ``predictor.left_out``."""
        return {"refitted": dict(zip(CHANNELS, self.refitted, strict=True)),
                "predictor": dict(zip(CHANNELS, self.predictor, strict=True)),
                "ratio": self.ratio}


@dataclass(frozen=True, slots=True)
class ErrorMoment(JsonFields):
    """Time of an error that was far larger than usual.

    second: in the file; error: in SI units; times: the same in robust standard deviations; speed
    [m/s] and commands (-1..1) at that time.
    """

    file: str
    second: float
    error: float
    times: float
    speed: float
    throttle: float
    steering: float


@dataclass(frozen=True, slots=True)
class Outliers(JsonFields):
    """A channel whose errors have long tails, see ``find_outliers``; the worst moments first."""

    channel: str
    ratio: float
    moments: tuple[ErrorMoment, ...]


@dataclass(frozen=True, slots=True)
class LateCommands(JsonFields):
    """Commands that acted later than their log allows, see ``find_late_commands``.

    share: of the windows whose error depends on the age of a command; delay [s]: mean extra delay;
    log_likelihood: gain by such commands; moments: the most significant ones.
    """

    share: float
    delay: float
    log_likelihood: float
    moments: tuple[ErrorMoment, ...]


@dataclass(frozen=True, slots=True)
class PathWindow(JsonFields):
    """The path of the centre of mass in one window of a recording, measured and predicted.

    kind: worst or median, by the position error of the model ``chosen_by`` at the end of the
    window, which is ``error`` [m]; windows: of all test recordings, by which it was chosen; file,
    second: where it starts; paths: (2, n) by model, x ahead and y to the left of the car at the
    start [m], one point each ``step`` [s]; "measured" is one of them.
    """

    kind: str
    chosen_by: str
    error: float
    windows: int
    file: str
    second: float
    step: float
    paths: Mapping[str, FloatArray]

    def to_json(self) -> dict[str, Any]:
        """As in ``paths``; lengths to a millimetre."""
        paths = {name: np.round(xy, 3).tolist() for name, xy in self.paths.items()}
        return {**JsonFields.to_json(self), "paths": paths}


@dataclass(frozen=True, slots=True)
class Excess:
    """A channel in which the error 1 s ahead is more than MAX_OVER_FLOOR times the noise floor."""

    channel: str
    error: float
    floor: float


def find_excesses(horizons: Mapping[str, Any], floor: Mapping[str, float]) -> tuple[Excess, ...]:
    """Find the channels whose error 1 s ahead is far above the noise floor.

    horizons: errors as ``evaluate`` gives them; floor: by channel.
    """
    errors = horizons.get("1.0", {}).get("pooled", {})
    return tuple(Excess(name, errors[name], value) for name, value in floor.items()
                 if errors[name] > MAX_OVER_FLOOR * value)
