"""Diagnoses that leave a question open: short drives of one kind, with something hidden."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import apply, catalogue
from dart_hal.vehicle.flat import value
from dart_lab.diagnosis.result import (
    Cause,
    Constancy,
    Diagnosis,
    ErrorReduction,
    ParameterChange,
    ParameterEstimate,
    Stage,
)
from dart_lab.diagnosis.run import make_evidence
from dart_lab.diagnosis.search.scan import EffectScan
from dart_lab.identification.evidence.noise import estimate_noise
from dart_lab.identification.evidence.space import MessageTiming, Space
from dart_lab.identification.experiment.floor import Floor
from dart_lab.identification.objective import refit
from studies.diagnosis.hidden_drive import Plan, write
from studies.diagnosis.known_frame import read

ROLLOUT_STEPS = 3000  # samples of 0.01 s
MOTOR = {"motor.d": 3.0, "motor.e": 0.8, "friction.a": 0.3}
"""Standard errors of parameters that move along."""


def _wave(period, size):
    return size * np.sin(2.0 * np.pi * np.arange(ROLLOUT_STEPS) * 0.01 / period)


def _pulls():
    throttle = np.zeros(ROLLOUT_STEPS)
    for i in range(0, ROLLOUT_STEPS, 500):
        throttle[i + 50:i + 450] = 0.27
    return throttle


DRIVE_COMMANDS = {
    "slow waves": (np.full(ROLLOUT_STEPS, 0.24), _wave(4.0, 0.35)),
    "pulls": (_pulls(), np.zeros(ROLLOUT_STEPS)),
    "straight": (np.full(ROLLOUT_STEPS, 0.24), np.zeros(ROLLOUT_STEPS)),
    "slow circles": (np.full(ROLLOUT_STEPS, 0.24),
                     np.where(np.arange(ROLLOUT_STEPS) < ROLLOUT_STEPS // 2, 0.5, -0.5)),
}


@dataclass(frozen=True)
class QuestionCase:
    """truth hidden in a drive of one kind; confounder: what it is confounded with there."""

    drive: str
    truth: tuple[str, float]
    confounder: str
    free: tuple[str, ...] = ()

    @property
    def car(self):
        return apply(PAPER, self.truth[0], k=self.truth[1])


def record_case(path, case, series, seed, mocap):
    """One recording of the hidden car."""
    r = read(write(path, case.car, seed, Plan(series=series)))
    if mocap:
        return r
    from dataclasses import replace
    return replace(r, mocap=None)


def diagnosis(case, recordings):
    """As if the truth had been named, and its confounder listed with it."""
    evidence, _ = make_evidence(recordings, PAPER.body.l_r)
    name, k = case.truth
    cause = Cause(name, "", catalogue()[name].stage, {"k": ParameterEstimate(k, 0.0, "")}, 0.0,
                  0.0, (), ErrorReduction("omega", 0.0, 0.0, 0.0, 0.0, ""), (case.confounder,),
                  "", 1.0, {},
                  Constancy(1.0, "", (), 0.0, (0.0, 0.0)), (1.0, 1.0, 1.0))
    moved = {n: ParameterChange(value(PAPER, n), value(PAPER, n), MOTOR[n], "") for n in case.free}
    stage = Stage("", case.car, {}, evidence.residuals(case.car))
    return Diagnosis("explained", "paper", moved, (cause,), (), (), (stage,), evidence, {}, {}, {})


def gains(case, recordings):
    """{effect: drop of the robust loss} of truth and confounder, as a diagnosis scans."""
    evidence, _ = make_evidence(recordings, PAPER.body.l_r)
    space = Space(PAPER, case.free, {n: MOTOR[n] for n in case.free})
    x = space.point(MessageTiming(0.0, 0.02))
    for _ in range(2):
        p, timing = space.split(x)
        noise = estimate_noise(evidence.residuals(p, timing), evidence.blocks())
        point = refit(evidence, noise, space, x)
        x = point.x
    scan = EffectScan(evidence, point)
    return {name: scan.best_trial(name).gain for name in (case.truth[0], case.confounder)}


LARGE_FLOOR = Floor(10.0, 10.0)
