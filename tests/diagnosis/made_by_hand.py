"""Diagnoses made by hand: what the report shows is known, because it was written here."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import apply, catalogue
from dart_lab.diagnosis.gains import RecordingSet
from dart_lab.diagnosis.paths import find_paths
from dart_lab.diagnosis.result import (
    Cause,
    Considered,
    Constancy,
    Diagnosis,
    ErrorReduction,
    ParameterChange,
    ParameterEstimate,
    Stage,
    Unexplained,
)
from dart_lab.identification.evaluation import evaluate
from dart_lab.identification.evaluation import prepare as prepare_cases
from dart_lab.identification.evidence.drive import prepare_drive
from dart_lab.identification.evidence.residuals import Evidence
from studies.diagnosis import hidden_drive
from studies.diagnosis.known_frame import read

HIDDEN = apply(apply(PAPER, "steering_lag", k=0.12), "gyro_scale", k=0.06)


@lru_cache(maxsize=1)
def recording():
    """A minute of a car with a steering lag and a gyro that reads too much."""
    folder = Path(mkdtemp())
    return read(hidden_drive.write(folder / "car_1_hidden.csv", HIDDEN, seed=3))


@lru_cache(maxsize=1)
def stages():
    """Base, refitted base, with the lag, with the gyro as well; and CTRV."""
    r = recording()
    evidence = Evidence([prepare_drive(r, PAPER.body.l_r)], PAPER.body.l_r)
    models = (("base: paper", PAPER), ("refitted base", PAPER),
              ("+ steering_lag", apply(PAPER, "steering_lag", k=0.12)), ("+ gyro_scale", HIDDEN))
    out = []
    ctrv = {}
    for label, p in models:
        result = evaluate(replace(p, name="paper"), [r], limit=False)
        out.append(Stage(label, p, result.model.to_json(), evidence.residuals(p)))
        ctrv = result.ctrv.to_json()
    return tuple(out), evidence, ctrv


@lru_cache(maxsize=1)
def side():
    """The same recording as test recordings."""
    return RecordingSet(stages()[1], prepare_cases([recording()]))


@lru_cache(maxsize=4)
def paths(causes):
    """In its worst and its median window, with as many causes."""
    every = stages()[0]
    models = {"given": every[0].vehicle, "refitted": every[1].vehicle,
              **({"extended": every[1 + causes].vehicle} if causes else {})}
    return find_paths(side(), models, "refitted")


CONSTANT = Constancy(0.42, "speed", ((0.5, 0.97, 0.05), (1.0, 1.01, 0.04), (1.5, 1.02, 0.06)), 0.04,
                     (0.01, 0.1))
CHANGES = replace(CONSTANT, p_value=0.001, change=0.3)


def cause(name, value, std, gain, like=()):
    effect = catalogue()[name]
    parameter = effect.parameters[0]
    return Cause(name, effect.title, effect.stage,
                 {parameter.name: ParameterEstimate(value, std, parameter.unit, parameter.null)},
                 0.0004,
                 321.5, ("A sentence of <evidence> & more.",), gain, like, effect.experiment,
                 0.9875, {"19/a.csv": (1.02, 0.04)}, CONSTANT,
                 (1.21, 1.14, 1.29))


def diagnosis(verdict="partly_explained", causes=2, unexplained=True, **changes):
    """A whole diagnosis with the requested number of its two causes."""
    every, evidence, ctrv = stages()
    gain = ErrorReduction("yaw_rate", 0.4312, 0.4123, 0.3571, 0.4719, "rollout, 1 s")
    named = (cause("steering_lag", 0.1187, 0.0043, gain, ("yaw_inertia", "steering_rate_limit")),
             cause("gyro_scale", 0.0588, 0.0011,
                   ErrorReduction("gyro", 0.8112, 0.7934, np.nan, np.nan, "residual of the gyro")))
    rejected = tuple(Considered(n, 0.2 + 0.01 * i, 40.0 / (i + 1),
                                f"the {n} loses on stretches that were left out")
                     for i, n in enumerate(sorted(set(catalogue()) - {c.effect for c in named}))
                     ) if causes is not None else ()
    left = (Unexplained("v_x", "rises with the speed", ("speed", "time"), 0.003, 0.17),)
    base = Diagnosis(
        verdict, "<paper> & co", {"friction.a": ParameterChange(1.7195, 1.8312, 0.0219, "N"),
                                  "motor.d": ParameterChange(28.9, 71.3, 0.51, "N",
                                                              "weaker than its prior")},
        named[:causes], rejected, left if unexplained else (), every[:2 + causes], evidence, ctrv,
        {"yaw_rate": gain} if causes else {},
        {"19/a.csv": {"role": "train", "sha256": "ab" * 32, "used": 5321, "dropped": 77,
                      "why": ["3 window(s) left out: slow"]},
         "19/<b>.csv": {"role": "test", "sha256": "cd" * 32, "used": 1234, "dropped": 5,
                        "why": []}},
        ("no test recordings: about 40 % of each training recording is held out",), 7, 3.25,
        None, ("mass",) if causes else (), 0.01,
        {n: 400.0 / (i + 1)**2 for i, n in enumerate(catalogue())}, paths=paths(causes))
    return replace(base, **changes)
