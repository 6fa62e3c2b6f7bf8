"""Result of a diagnosis: verdict, causes with their evidence, remaining structure, and gain."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from dart_hal.core.types import FloatArray
from dart_hal.vehicle.effects import catalogue
from dart_hal.vehicle.flat import value
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.evidence.residuals import Evidence, Residuals

from .error_summaries import (
    Excess,
    HeldOutError,
    JsonFields,
    LateCommands,
    Outliers,
    PathWindow,
    Ratio,
    as_json,
    find_excesses,
    geometric_mean,
)

# A ratio of errors, and the ends of its 90 % interval; those are NaN with too few data for one.
Cost = tuple[float, float, float]
VERDICTS = ("nothing_wrong", "explained", "partly_explained", "unexplained", "parameters_only")


@dataclass(frozen=True, slots=True)
class ParameterEstimate(JsonFields):
    """One parameter of a cause, with its standard error and the value that changes nothing."""

    value: float
    std: float
    unit: str
    null: float = 0.0


def estimate_effects(vehicle: Vehicle, names: Iterable[str], stds: Mapping[str, float]
                     ) -> dict[str, dict[str, ParameterEstimate]]:
    """Return the parameters of effects of a vehicle, by effect; stds: by effect and parameter."""
    return {n: {q.name: ParameterEstimate(float(value(vehicle, f"{n}.{q.name}")),
                                          stds[f"{n}.{q.name}"], q.unit, q.null)
                for q in catalogue()[n].parameters} for n in names}


@dataclass(frozen=True, slots=True)
class ParameterChange(JsonFields):
    """A parameter of the base model that the refit changed; doubt: why it may be wrong."""

    before: float
    after: float
    std: float
    unit: str
    doubt: str = ""


@dataclass(frozen=True, slots=True)
class ErrorReduction:
    """1 - RMSE after / RMSE before of one channel on recordings that the fit did not use.

    low, high: its 95 % interval (block bootstrap; NaN with less than 4 blocks);
    train: the same on the training recordings; measure: what was compared.
    """

    channel: str
    train: float
    test: float
    low: float
    high: float
    measure: str

    def to_json(self) -> dict[str, Any]:
        """{"channel", "train", "test", "test_ci95", "measure"}."""
        return {"channel": self.channel, "train": self.train, "test": self.test,
                "test_ci95": [self.low, self.high], "measure": self.measure}


@dataclass(frozen=True, slots=True)
class Constancy:
    """Whether a size is the same throughout the training recordings.

    p_value, family-wise, that a constant size would vary as much; along: the variable with the most
    significant change; others: two further ones at most, the most likely first; curve: (value of
    the variable, size relative to the fitted one, its standard error). change: root mean square of
    the change, as a share of the size. least: level and change from which a change is reported.
    """

    p_value: float
    along: str
    curve: tuple[tuple[float, float, float], ...]
    change: float
    least: tuple[float, float]
    others: tuple[str, ...] = ()

    @property
    def constant(self) -> bool:
        """Whether no significant and relevant change was found."""
        return self.p_value >= self.least[0] or self.change < self.least[1]

    def to_json(self) -> dict[str, Any]:
        """{"constant", "p_value", "change", "changes_with" or null, "or_with", "curve"}."""
        return {"constant": self.constant, "p_value": self.p_value, "change": self.change,
                "changes_with": None if self.constant else self.along, "or_with": list(self.others),
                "curve": [list(point) for point in self.curve]}


@dataclass(frozen=True, slots=True)
class Cause(JsonFields):
    """An accepted effect with its sizes, probability and confounders.

    enters: stage of the effect; loss: drop of the robust loss on the training recordings.
    experiment: the drive that would distinguish it from its confounders, ``cannot_be_told_from``.
    gain: of the channel where it is largest. cost: root of the robust loss of the test recordings
    without it over that with all causes, at the timing that suits them, and its 90 % interval.
    probability: share of draws whose held-out data are predicted better with it. sizes: (size
    relative to the fitted one, standard error) by training recording.
    """

    effect: str
    title: str
    enters: str
    parameters: Mapping[str, ParameterEstimate]
    p_value: float
    loss: float
    evidence: tuple[str, ...]
    gain: ErrorReduction
    cannot_be_told_from: tuple[str, ...]
    experiment: str
    probability: float
    sizes: Mapping[str, tuple[float, float]]
    constancy: Constancy
    cost: Cost

    def to_json(self) -> dict[str, Any]:
        """As in the list ``causes``."""
        sizes = {k: {"relative": a, "std": s} for k, (a, s) in self.sizes.items()}
        return {**JsonFields.to_json(self), "sizes": sizes, "cost": _cost(self.cost)}


@dataclass(frozen=True, slots=True)
class QuantityChange(JsonFields):
    """A quantity of the car that a mechanic can check: by the model as given, and as fitted."""

    before: float
    after: float
    std: float
    unit: str


@dataclass(frozen=True, slots=True)
class Claim(JsonFields):
    """Parameters of the model that were wrong.

    parameters: what their full names begin with; stds: their standard errors, by full name; cost:
    root of the robust loss of the test recordings with this group at its old value over that with
    all refitted, and its 90 % interval (NaN where they are too short).
    """

    group: str
    title: str
    parameters: tuple[str, ...]
    probability: float
    quantities: Mapping[str, QuantityChange]
    cost: Cost
    cannot_be_told_from: tuple[str, ...]
    experiment: str
    constancy: Constancy
    stds: Mapping[str, float] = field(default_factory=dict)

    @property
    def constant(self) -> bool:
        """Whether its quantities are constant to a tenth of their values.

        The change of a parameter may vary by a large factor if it is small itself.
        """
        moved = min((abs(q.after - q.before) / max(abs(q.after), abs(q.before), 1e-12)
                     for q in self.quantities.values()), default=1.0)
        return self.constancy.constant or self.constancy.change * moved < self.constancy.least[1]

    def to_json(self) -> dict[str, Any]:
        """As in the list ``parameters``."""
        return {**JsonFields.to_json(self), "cost": _cost(self.cost),
                "constancy": {**self.constancy.to_json(), "constant": self.constant,
                              "changes_with": None if self.constant else self.constancy.along}}


@dataclass(frozen=True, slots=True)
class Possible(JsonFields):
    """An effect that the search found, and that is not accepted.

    grade: "likely" or "possible", by its probability; why: reason of the rejection.
    """

    effect: str
    title: str
    probability: float
    loss: float
    why: str = ""
    grade: str = "possible"


@dataclass(frozen=True, slots=True)
class Considered(JsonFields):
    """An effect that was not accepted, and why. loss: drop of the robust loss."""

    effect: str
    p_value: float
    loss: float
    why_not: str


@dataclass(frozen=True, slots=True)
class Unexplained:
    """Structure of the last residual that no effect of the catalogue explains.

    along: the variables it depends on; share: of the variance of that residual.
    period: of its single variable; 0 if it is not periodic.
    """

    channel: str
    structure: str
    along: tuple[str, ...]
    p_value: float
    share: float
    period: float = 0.0

    def to_json(self) -> dict[str, Any]:
        """As in the list ``unexplained``."""
        return {"channel": self.channel, "structure": self.structure, "with": list(self.along),
                "p_value": self.p_value, "share": self.share}


def _cost(cost: Cost) -> dict[str, Any]:
    ratio, low, high = cost
    return {"ratio": ratio, "ci90": [low, high]}


def effect_label(effect: str) -> str:
    """Return the label of the stage at which an effect enters the model."""
    return f"+ {effect}"


@dataclass(frozen=True, slots=True)
class Stage:
    """The model after one more step: the base, the refitted base, and each cause in order.

    horizons: errors on the test recordings as ``evaluate`` gives them, None where unknown;
    residuals: on the test drives, in SI units.
    """

    label: str
    vehicle: Vehicle
    horizons: Mapping[str, Any]
    residuals: Residuals


@dataclass(frozen=True, slots=True)
class BestPredictor:
    """The model with the smallest errors in held-out recordings, see ``find_predictor``.

    vehicle: delays counted from the log, with the accepted effects on sensors. effects: sizes of
    those on the motion that were found; parameters: of the base. Standard errors follow from a
    jackknife over recordings. left_out: errors by held-out training recording. tried: sets of
    effects, and their errors in held-out recordings over those of the refit. horizons: errors on
    the test recordings.
    """

    vehicle: Vehicle
    effects: Mapping[str, Mapping[str, ParameterEstimate]]
    parameters: Mapping[str, ParameterEstimate]
    left_out: Mapping[str, HeldOutError]
    tried: tuple[tuple[tuple[str, ...], Ratio], ...]
    horizons: Mapping[str, Any]

    @property
    def ratio(self) -> Ratio:
        """Error in held-out recordings over that of the refit.

        The effects were selected by these recordings, so it is slightly too small.
        """
        return geometric_mean(one.ratio for one in self.left_out.values())

    def to_json(self) -> dict[str, Any]:
        """As ``predictor``."""
        ratio, low, high = self.ratio
        return {"effects": as_json(self.effects), "parameters": as_json(self.parameters),
                "ratio": ratio, "ratio_ci90": [low, high], "left_out": as_json(self.left_out),
                "tried": [{"effects": list(names), "ratio": r.value, "ratio_ci90": [r.low, r.high]}
                          for names, r in self.tried],
                "errors": self.horizons}


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """Result of a diagnosis; ``evidence`` holds the test drives of the stages' residuals.

    false_alarm: share of data sets in which an effect is found where nothing is
    missing; ranking: drop of the loss for every effect alone, before any was accepted.
    mounting: of the IMU, by effect and parameter, see ``fit_mounting``. predictor: None if
    not requested. paths: see ``find_paths``. late_commands: see ``find_late_commands``.
    correlation: of the refitted parameters among each other, (names, matrix), None without a refit.
    noise_floor: RMS error of a faultless model 1 s ahead on the test recordings, by channel; empty
    if unknown.
    """

    verdict: str
    model: str
    refitted: Mapping[str, ParameterChange]
    causes: tuple[Cause, ...]
    considered: tuple[Considered, ...]
    unexplained: tuple[Unexplained, ...]
    stages: tuple[Stage, ...]
    evidence: Evidence
    ctrv: Mapping[str, Any]
    gain: Mapping[str, ErrorReduction]
    files: Mapping[str, Mapping[str, Any]]
    notes: tuple[str, ...] = ()
    seed: int = 0
    runtime_s: float = 0.0
    written: str | None = None
    withdrawn: tuple[str, ...] = field(default_factory=tuple)
    false_alarm: float = 0.01
    ranking: Mapping[str, float] = field(default_factory=dict)
    possible: tuple[Possible, ...] = ()
    claims: tuple[Claim, ...] = ()
    mounting: Mapping[str, Mapping[str, ParameterEstimate]] = field(default_factory=dict)
    outliers: tuple[Outliers, ...] = ()
    predictor: BestPredictor | None = None
    predictor_written: str | None = None
    paths: tuple[PathWindow, ...] = ()
    noise_floor: Mapping[str, float] = field(default_factory=dict)
    late_commands: LateCommands | None = None
    correlation: tuple[tuple[str, ...], FloatArray] | None = None

    @property
    def excesses(self) -> tuple[Excess, ...]:
        """Channels in which the error of the extended model is far above the noise floor."""
        return find_excesses(self.stages[-1].horizons, self.noise_floor)

    @property
    def compared(self) -> dict[str, Stage]:
        """The model as given, refitted and, where a cause was accepted, extended."""
        refitted = [s for s in self.stages[1:2] if not s.label.startswith(effect_label(""))]
        return {"given": self.stages[0], **({"refitted": refitted[0]} if refitted else {}),
                **({"extended": self.stages[-1]} if self.causes else {})}

    @property
    def extended(self) -> Vehicle:
        """The base, refitted if allowed, with the causes found."""
        return self.stages[-1].vehicle

    def to_json(self) -> dict[str, Any]:
        """As ``dart-hal diagnose --json`` prints it."""
        return {
            "verdict": self.verdict,
            "base": {"model": self.model, "refitted": as_json(self.refitted),
                     "errors": self.stages[0].horizons},
            "parameters": as_json(self.claims),
            **{name: as_json(getattr(self, name)) for name in (
                "causes", "possible", "considered", "unexplained", "outliers", "late_commands",
                "paths", "mounting", "notes", "withdrawn")},
            "extended": {"model": self.written, "errors": self.stages[-1].horizons,
                         "gain": {k: g.test for k, g in self.gain.items()},
                         "gain_ci95": {k: [g.low, g.high] for k, g in self.gain.items()}},
            "predictor": self.predictor and {"model": self.predictor_written,
                                             **self.predictor.to_json()},
            "stages": [{"label": s.label, "errors": s.horizons} for s in self.stages],
            "ctrv": self.ctrv, "noise_floor": dict(self.noise_floor),
            "ranking": dict(self.ranking), "seed": self.seed,
            "false_alarm": self.false_alarm, "runtime_s": self.runtime_s,
            "files": {k: dict(f) for k, f in self.files.items()}}
