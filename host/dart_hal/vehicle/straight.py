"""One step of a car as one straight line of Python, to the bit the same and a third quicker.

The factories give closures that call each other sixteen times a Runge-Kutta step. Here they are
run once on symbols (``native.trace``), and what they compute is written down as one function:
the same operations on the same operands, equal ones once. Nothing is reordered, left out or
replaced, so no bit changes; where that cannot be had, the closures are taken.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from functools import lru_cache
from types import CodeType
from typing import Any

from dart_hal.vehicle.namespace import SCALAR, Namespace
from dart_hal.vehicle.native.trace import FUNCTIONS, Expr, Graph, Node, needed

DEEP = 12
"""Operations in one expression; Python's parser nests at most 200."""
Make = Callable[[Namespace], Callable[..., Any]]


class Exact(Graph):
    """A graph that keeps every operation: x + 0 is not x where x is -0."""

    def apply(self, op: str, *operands: Any) -> Expr:
        exprs = [x if isinstance(x, Expr) else self.constant(x) for x in operands]
        return self._node(Node(op, tuple(x.index for x in exprs)))


def straight(make: Make, names: Sequence[str]) -> Callable[..., Any]:
    """``make(SCALAR)`` as a straight line; names: of its arguments, floats all.

    make: gives the function for a namespace; what it returns is a tuple. A function that cannot
    be traced, because it branches or knows infinity, is returned as it is.
    """
    graph = Exact()
    try:
        results = make(graph.namespace())(*map(graph.symbol, names))
        wanted = tuple((r if isinstance(r, Expr) else graph.constant(r)).index for r in results)
    except (TypeError, ValueError):
        return make(SCALAR)
    text, constants = _text(graph, wanted, names)
    space: dict[str, Any] = {name: getattr(SCALAR, name) for name in FUNCTIONS}
    exec(_compiled(text), space)
    function: Callable[..., Any] = space["bound"](*constants, *map(space.get, FUNCTIONS))
    return function


@lru_cache(maxsize=64)
def _compiled(text: str) -> CodeType:
    """Cars of one form have one text: their numbers are arguments."""
    return compile(text, "<a straight line of vehicle equations>", "exec")


def _text(graph: Graph, wanted: tuple[int, ...], names: Sequence[str]) -> tuple[str, list[float]]:
    """Source of ``bound``, which takes constants and functions and returns the step."""
    nodes = needed(graph, wanted)
    uses = Counter(a for i in nodes for a in graph.nodes[i].args) + Counter(wanted)
    twice = {a for i in nodes if graph.nodes[i].op in ("fmin", "fmax") for a in graph.nodes[i].args}
    constants: list[float] = []
    written: dict[int, str] = {}
    deep: dict[int, int] = {}
    lines: list[str] = []
    for i in nodes:
        node = graph.nodes[i]
        deep[i] = 1 + max((deep[a] for a in node.args), default=0)
        if node.op == "const":
            written[i] = f"c{len(constants)}"
            constants.append(node.value)
        elif node.op == "symbol":
            written[i] = node.name
        else:
            written[i] = _operation(node.op, [written[a] for a in node.args])
            if uses[i] > 1 or i in twice or deep[i] > DEEP:
                lines.append(f"n{i} = {written[i]}")
                written[i], deep[i] = f"n{i}", 0
    given = ", ".join([*(f"c{k}=c{k}" for k in range(len(constants))),
                       *(f"{f}={f}" for f in FUNCTIONS)])
    bound = ", ".join([*(f"c{k}" for k in range(len(constants))), *FUNCTIONS])
    body = "\n        ".join([*lines, f"return {', '.join(written[i] for i in wanted)},"])
    return (f"def bound({bound}):\n    def step({', '.join(names)}, *, {given}):\n        {body}\n"
            "    return step\n", constants)


def _operation(op: str, args: list[str]) -> str:
    if op == "neg":
        return f"(-{args[0]})"
    if op in ("fmin", "fmax"):  # as Python's min and max choose, also of two that are equal
        a, b = args
        return f"({b} if {b} {'<' if op == 'fmin' else '>'} {a} else {a})"
    return f"({args[0]} {op} {args[1]})" if len(op) == 1 else f"{op}({', '.join(args)})"

