"""Equations as a graph: run them on symbols and record each operation.

The factories of this package take any namespace of functions. Here its values are nodes of a graph;
equal sub-expressions are one node. Only arithmetic and the twelve functions can be recorded. An
equation that compares a symbol or tests its truth has a branch, which raises TypeError.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any

from dart_hal.vehicle.namespace import SCALAR, Namespace

FUNCTIONS = tuple(f.name for f in fields(Namespace))
_ARITHMETIC: dict[str, Callable[..., Any]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv,
    "neg": operator.neg}


@dataclass(frozen=True, slots=True)
class Node:
    """One operation: "+ - * /", "neg", a function, "const" (value) or "symbol" (name)."""

    op: str
    args: tuple[int, ...] = ()
    value: float = 0.0
    name: str = ""


@dataclass(frozen=True, slots=True)
class EvaluationPlan:
    """Constants, symbols and operations by the index of their nodes, each in computable order."""

    constants: Mapping[int, float]
    symbols: tuple[tuple[int, str], ...]
    steps: tuple[tuple[int, Callable[..., Any], tuple[int, ...]], ...]


class Graph:
    """Nodes in the order in which they can be computed."""

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self._known: dict[Node, int] = {}
        self._plans: dict[tuple[tuple[int, ...], Namespace], EvaluationPlan] = {}

    def symbol(self, name: str) -> Expr:
        """The symbol of that name."""
        return self._node(Node("symbol", name=name))

    def constant(self, value: float) -> Expr:
        """A number. Raises ValueError for one that is not finite."""
        if not math.isfinite(value):
            raise ValueError(f"no kernel can hold the constant {value}")
        return self._node(Node("const", value=float(value)))

    def apply(self, op: str, *operands: Any) -> Expr:
        """The node of an operation; numbers among themselves are computed at once."""
        exprs = [x if isinstance(x, Expr) else self.constant(x) for x in operands]
        nodes = [self.nodes[x.index] for x in exprs]
        # 1. Numbers among themselves are computed at once.
        # 2. x + 0, 1 x and the like are x.
        # 3. All else is a node; an equal one is used again, so that a kernel computes it once.
        if all(n.op == "const" for n in nodes):
            return self.constant(_operation(op, SCALAR)(*[n.value for n in nodes]))
        same = _simplify(op, exprs, nodes)
        return same if same is not None else self._node(Node(op, tuple(x.index for x in exprs)))

    def namespace(self) -> Namespace:
        """The functions of the equations, recorded into this graph."""
        def record(op: str) -> Callable[..., Expr]:
            return lambda *operands: self.apply(op, *operands)

        return Namespace(**{name: record(name) for name in FUNCTIONS})

    def plan(self, targets: tuple[int, ...], xp: Namespace) -> EvaluationPlan:
        """How to compute some nodes, made once."""
        key = targets, xp
        if key not in self._plans:
            nodes = [(i, self.nodes[i]) for i in find_dependencies(self, targets)]
            self._plans[key] = EvaluationPlan(
                {i: n.value for i, n in nodes if n.op == "const"},
                tuple((i, n.name) for i, n in nodes if n.op == "symbol"),
                tuple((i, _operation(n.op, xp), n.args) for i, n in nodes
                      if n.op not in ("const", "symbol")))
        return self._plans[key]

    def _node(self, node: Node) -> Expr:
        if node not in self._known:
            self._known[node] = len(self.nodes)
            self.nodes.append(node)
        return Expr(self, self._known[node])


class Expr:
    """A value of the graph; arithmetic on it records, a question about it is refused."""

    __slots__ = ("graph", "index")
    __array_ufunc__ = None
    """numpy must not take it for an array element."""

    def __init__(self, graph: Graph, index: int) -> None:
        self.graph = graph
        self.index = index

    def __add__(self, other: Any) -> Expr:
        return self.graph.apply("+", self, other)

    def __radd__(self, other: Any) -> Expr:
        return self.graph.apply("+", other, self)

    def __sub__(self, other: Any) -> Expr:
        return self.graph.apply("-", self, other)

    def __rsub__(self, other: Any) -> Expr:
        return self.graph.apply("-", other, self)

    def __mul__(self, other: Any) -> Expr:
        return self.graph.apply("*", self, other)

    def __rmul__(self, other: Any) -> Expr:
        return self.graph.apply("*", other, self)

    def __truediv__(self, other: Any) -> Expr:
        return self.graph.apply("/", self, other)

    def __rtruediv__(self, other: Any) -> Expr:
        return self.graph.apply("/", other, self)

    def __neg__(self) -> Expr:
        return self.graph.apply("neg", self)

    def __pos__(self) -> Expr:
        return self

    def __bool__(self) -> bool:
        raise TypeError("an equation tests the truth of a symbol: it has a branch")

    def __lt__(self, other: Any) -> bool:
        raise TypeError("an equation compares symbols: it has a branch")

    __le__ = __gt__ = __ge__ = __lt__


def evaluate(graph: Graph, targets: tuple[int, ...], symbols: Mapping[str, Any],
             xp: Namespace) -> list[Any]:
    """Values of the nodes ``targets`` for values of the symbols they depend on."""
    plan = graph.plan(targets, xp)
    values: dict[int, Any] = {**plan.constants, **{i: symbols[name] for i, name in plan.symbols}}
    for index, operation, args in plan.steps:
        values[index] = operation(*[values[a] for a in args])
    return [values[i] for i in targets]


def find_dependencies(graph: Graph, targets: tuple[int, ...]) -> list[int]:
    """All nodes that ``targets`` depend on and themselves, in computable order."""
    # Depth-first search. Operands exist before their operation, so ascending indices are a
    # computable order.
    found: set[int] = set()
    todo = list(targets)
    while todo:
        index = todo.pop()
        if index not in found:
            found.add(index)
            todo.extend(graph.nodes[index].args)
    return sorted(found)


def _operation(op: str, xp: Namespace) -> Callable[..., Any]:
    return _ARITHMETIC.get(op) or getattr(xp, op)


def _simplify(op: str, exprs: list[Expr], nodes: list[Node]) -> Expr | None:
    """The operand that x + 0, x - 0, 1 x and x / 1 leave as it is."""
    number = [n.value if n.op == "const" else None for n in nodes]
    if (op == "+" and number[0] == 0.0) or (op == "*" and number[0] == 1.0):
        return exprs[1]
    if (op in "+-" and number[-1] == 0.0) or (op in "*/" and number[-1] == 1.0):
        return exprs[0]
    return None
