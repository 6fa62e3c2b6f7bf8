"""The steps of ``vehicle.step`` as graphs: what a kernel computes and from what."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from dart_hal.vehicle.flat import bind, values
from dart_hal.vehicle.namespace import ARRAY, SCALAR, Namespace
from dart_hal.vehicle.native.trace import Expr, Graph, evaluate, find_dependencies
from dart_hal.vehicle.parameters import PaperTyres, Vehicle
from dart_hal.vehicle.step import make_car_step, make_motion_step, make_tick_step

DT_SYMBOL = "dt"
# N; replaces the infinite limit of a linear rear tyre, because -ffast-math excludes infinity.
MAX_FORCE = 1e30
STATE_NAMES = {"car": ("x", "y", "eta", "vx", "vy", "om", "tau", "s"),
          "motion": ("x", "y", "eta", "vx", "vy", "om"),
          "tick": ("x", "y", "eta", "vx", "vy", "om", "k0", "k1", "brake")}
INPUT_NAMES = {"car": ("tau_command", "s_command"), "motion": ("tau", "delta"),
               "tick": ("cos_d", "sin_d")}
STEP_FACTORIES: dict[str, Callable[..., Any]] = {
    "car": make_car_step, "motion": make_motion_step, "tick": make_tick_step}


@dataclass(frozen=True, slots=True)
class Traced:
    """One step as a graph, split by what its parts depend on.

    uniform: nodes of parameters and dt alone, which the kernel is given;
    held: nodes of the inputs as well, computed once per sample; outputs: the
    new state, a node for each of ``states``.
    """

    name: str
    graph: Graph
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[int, ...]
    uniform: tuple[int, ...]
    held: tuple[int, ...]


# Vehicles by what makes equations differ: a fit needs the same ones thousands of times.
_FORM_CACHE: dict[Hashable, Vehicle] = {}


@lru_cache(maxsize=64)
def trace(form: Vehicle, kind: str, method: str = "rk4") -> Traced:
    """Equations of the form's kind; its numbers do not matter, see ``form_of``."""
    def make(symbol: Callable[[str], Expr], xp: Namespace) -> Callable[..., Any]:
        step: Callable[..., Any] = STEP_FACTORIES[kind](
            bind(form, symbol), xp, dt=symbol(DT_SYMBOL), method=method)
        return step

    return record(f"{kind}_{slug(form)}_{method}", make, STATE_NAMES[kind], INPUT_NAMES[kind])


def record(name: str, make: Callable[[Callable[[str], Expr], Namespace], Callable[..., Any]],
           states: tuple[str, ...], inputs: tuple[str, ...]) -> Traced:
    """Any step: ``make(symbol, xp)`` returns ``step(*states, *inputs) -> states``.

    ``symbol(name)`` is a parameter. Two inputs are what a kernel takes.
    """
    graph = Graph()
    out = make(graph.symbol, graph.namespace())(*map(graph.symbol, states),
                                                *map(graph.symbol, inputs))
    exprs = [x if isinstance(x, Expr) else graph.constant(x) for x in out]
    return split(name, graph, states, inputs, tuple(x.index for x in exprs))


def split(name: str, graph: Graph, states: tuple[str, ...], inputs: tuple[str, ...],
          outputs: tuple[int, ...]) -> Traced:
    """Find what stays the same over the steps of a sample, and over all of them."""
    # Level of a node: 0 depends on parameters alone, 1 on inputs too, 2 on the state too.
    level: dict[int, int] = {}
    for i in find_dependencies(graph, outputs):
        node = graph.nodes[i]
        own = 2 if node.name in states else 1 if node.name in inputs else 0
        level[i] = max([own, *(level[a] for a in node.args)])
    # Where a node uses a value of a lower level, that value is computed outside of the loop: once
    # per sample (level 1), or by the caller (level 0). Constants are written into the text.
    uniform: set[int] = set()
    held: set[int] = set()
    for i in level:
        for a in graph.nodes[i].args:
            if graph.nodes[a].op != "const" and level[a] < level[i]:
                (held if level[a] == 1 else uniform).add(a)
    uniform |= {i for i in outputs if level[i] == 0 and graph.nodes[i].op != "const"}
    held |= {i for i in outputs if level[i] == 1}
    return Traced(name, graph, states, inputs, outputs, tuple(sorted(uniform)),
                  tuple(sorted(held)))


def form_of(p: Vehicle) -> Vehicle:
    """A vehicle with the equations of p and no numbers of its own, to be a key."""
    slip = "all_speeds" if p.kind == "kinematic" else p.slip  # the tyres have no part in it
    key = p.kind, slip, type(p.tyres), p.drive, tuple(a.effect for a in p.effects)
    if key not in _FORM_CACHE:
        _FORM_CACHE[key] = bind(replace(p, name="", slip=slip), lambda name: 0.0)
    return _FORM_CACHE[key]


def slug(p: Vehicle) -> str:
    """The equations as a part of a C name."""
    drive = "" if p.drive == "duty" else f"_{p.drive}"
    if p.kind == "kinematic":
        return f"kinematic{drive}"
    return f"dynamic_{'paper' if isinstance(p.tyres, PaperTyres) else 'axle'}_{p.slip}{drive}"


def coefficients(traced: Traced, p: Vehicle, dt: float, lanes: int = 0) -> Any:
    """Values of ``traced.uniform`` for a vehicle in f64: (H,), or (H, lanes) for a stack."""
    return evaluate_coefficients(traced, {**values(p), DT_SYMBOL: dt}, lanes)


def evaluate_coefficients(traced: Traced, parameters: Mapping[str, Any], lanes: int = 0) -> Any:
    """The same from a value for each symbol that is neither state nor input."""
    symbols = {name: _clip_infinite(number) for name, number in parameters.items()}
    if not lanes:
        return np.array(evaluate(traced.graph, traced.uniform, symbols, SCALAR))
    out = np.empty((len(traced.uniform), lanes))
    for row, number in zip(out, evaluate(traced.graph, traced.uniform, symbols, ARRAY),
                           strict=True):
        row[:] = number
    return out


def _clip_infinite(number: Any) -> Any:
    if isinstance(number, np.ndarray):
        return np.clip(number.astype(np.float64), -MAX_FORCE, MAX_FORCE)
    return min(max(number, -MAX_FORCE), MAX_FORCE)
