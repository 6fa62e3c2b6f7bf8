"""The paper's optimiser on the same problems: ADAM on parameters scaled to 0..1.

With torch (``pip install 'dart-hal[bench]'``) gradients come from its tape, as
in the paper's code; without it the same steps in numpy with our analytic
Jacobians, which is several times faster than what the paper did.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from dart_lab.identification.paper.problem import CurveProblem

BETA1, BETA2, EPSILON = 0.9, 0.999, 1e-8


@dataclass(frozen=True, slots=True)
class Settings:
    """steps and learning rate of the paper; start: share of each interval, default 0.5."""

    steps: int
    rate: float
    start: tuple[float, ...] = ()


SETTINGS = {
    "friction": Settings(100, 0.1), "motor": Settings(500, 0.01, (0.95, 0.5, 0.5)),
    "steering": Settings(300, 0.1), "tyres_rear_offset": Settings(100, 0.1),
    "tyres_front": Settings(500, 0.01)}
"""The fits of the paper, by the name of the problem."""


@dataclass(frozen=True, slots=True)
class Run:
    """x (k,) at the end, mean square of the residuals there, CPU time."""

    x: np.ndarray
    loss: float
    cpu_s: float


def torch_or_none() -> ModuleType | None:
    """The module, on one thread; None when it is not installed."""
    try:
        import torch
    except ImportError:
        return None
    torch.set_num_threads(1)
    return torch


def adam(problem: CurveProblem, torch: ModuleType | None) -> Run:
    """One run with the paper's settings."""
    settings = SETTINGS[problem.submodel]
    run = _in_numpy if torch is None else _in_torch
    begin = time.process_time()
    x = run(problem, settings, torch)
    took = time.process_time() - begin
    return Run(x, problem.rmse(x)**2, took)


def _start(p: CurveProblem, settings: Settings) -> np.ndarray:
    return np.array(settings.start or (0.5,) * len(p.names))


def _in_numpy(p: CurveProblem, settings: Settings, _: None) -> np.ndarray:
    low, span = np.array(p.low), np.array(p.high) - np.array(p.low)
    z, n = _start(p, settings), len(p.target)
    first, second = np.zeros_like(z), np.zeros_like(z)
    for step in range(1, settings.steps + 1):
        inside = (z >= 0.0) & (z <= 1.0)
        value, slopes = p.curve(low + span * np.clip(z, 0.0, 1.0), *p.inputs)
        gradient = 2.0 / n * ((value - p.target) @ slopes) * span * inside
        first = BETA1 * first + (1.0 - BETA1) * gradient
        second = BETA2 * second + (1.0 - BETA2) * gradient**2
        root = np.sqrt(second / (1.0 - BETA2**step)) + EPSILON
        z = z - settings.rate * first / (1.0 - BETA1**step) / root
    return low + span * np.clip(z, 0.0, 1.0)


def _in_torch(p: CurveProblem, settings: Settings, torch: Any) -> np.ndarray:
    inputs = [torch.tensor(v, dtype=torch.float32) for v in p.inputs]
    target = torch.tensor(p.target, dtype=torch.float32)
    # one parameter per number and a clamp each, as the paper's modules have them
    z = [torch.nn.Parameter(torch.tensor([s], dtype=torch.float32)) for s in _start(p, settings)]
    clamp = torch.nn.Hardtanh(0.0, 1.0)
    optimiser = torch.optim.Adam(z, lr=settings.rate)
    curve = CURVES[p.submodel]

    def scaled() -> list[Any]:
        return [low + (high - low) * clamp(number)
                for low, high, number in zip(p.low, p.high, z, strict=True)]

    for _ in range(settings.steps):
        optimiser.zero_grad()
        loss = torch.nn.functional.mse_loss(curve(torch, scaled(), *inputs), target)
        loss.backward()
        optimiser.step()
    return np.array([float(number.detach()) for number in scaled()])


def _friction(torch: Any, x: Any, v: Any) -> Any:
    return -(x[0] * torch.tanh(x[1] * v) + x[2] * v)


def _motor(torch: Any, x: Any, tau: Any, v: Any) -> Any:
    u = tau + x[2]
    return (x[0] - x[1] * v) * u * 0.5 * (torch.tanh(100.0 * u) + 1.0)


def _steering(torch: Any, x: Any, s: Any) -> Any:
    c = s + x[2]
    w = 0.5 * (torch.tanh(30.0 * c) + 1.0)
    return w * x[1] * torch.tanh(x[0] * c) + (1.0 - w) * x[3] * torch.tanh(x[4] * c)


def _rear(torch: Any, x: Any, alpha: Any) -> Any:
    return x[0] * (alpha + x[1])


def _front(torch: Any, x: Any, alpha: Any) -> Any:
    y = x[2] * alpha
    return x[0] * torch.sin(x[1] * torch.atan(y - x[3] * (y - torch.atan(y))))


CURVES: dict[str, Callable[..., Any]] = {
    "friction": _friction, "motor": _motor, "steering": _steering, "tyres_rear_offset": _rear,
    "tyres_front": _front}
