"""Mutants of equations: one arithmetic term, function, number or variable at a time.

Made from the syntax tree alone, without cosmic-ray, so that they can be tried in the process of a
test. Mutated are the functions of a file, its constants, and the mapping ``signals`` of an effect.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator

from mutant import CHECKOUT, Mutant, make_mutant

SWAPS = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*"}
SIGNS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
FUNCTIONS = {"sin": "cos", "cos": "sin", "fmax": "fmin", "fmin": "fmax"}
WITHOUT = ("fabs", "tanh", "sqrt", "floor")
"""Functions of one argument that are left out."""
VARIABLES = dict(pair for a, b in (
    ("f_xf", "f_xr"), ("f_yf", "f_yr"), ("f_x", "f_y"), ("cos_d", "sin_d"), ("v_x", "v_y"),
    ("l_f", "l_r"), ("omega", "omega_dot"), ("front_D", "rear_D"), ("steering_s", "throttle_s"),
    ("steering_lag_s", "throttle_lag_s"), ("a_left_rad", "a_right_rad"), ("d", "e"),
    ("a", "c")) for pair in ((a, b), (b, a)))
"""Attributes of the same kind, taken for each other where they are read."""


Place = Callable[[ast.AST], tuple[int, int]]
"""Begin and end of a node in the source, in characters."""
Edit = tuple[str, int, int, str]
"""(operator, begin, end, replacement)."""


def term_mutants(file: str) -> Iterator[Mutant]:
    """Make every mutant of ``file`` (relative to the checkout)."""
    source = (CHECKOUT / file).read_text(encoding="utf-8")
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))

    def place(node: ast.AST) -> tuple[int, int]:
        return (starts[node.lineno - 1] + node.col_offset,
                starts[node.end_lineno - 1] + node.end_col_offset)

    for node in _nodes_of_equations(ast.parse(source)):
        for name, begin, end, new in _edits(node, source, place):
            if made := make_mutant(file, name, source, source[:begin] + new + source[end:]):
                yield made


def _nodes_of_equations(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield what computes: no annotation, no docstring, nothing that describes the effect."""
    for statement in tree.body:
        if isinstance(statement, ast.FunctionDef):
            yield from _nodes_of_function(statement)
        elif isinstance(statement, ast.Assign) and isinstance(statement.value, ast.Call):
            yield from (k.value for k in statement.value.keywords if k.arg == "signals")
        elif isinstance(statement, ast.Assign):
            yield from ast.walk(statement.value)


def _nodes_of_function(function: ast.FunctionDef) -> Iterator[ast.AST]:
    for statement in function.body:
        if isinstance(statement, ast.FunctionDef):
            yield from _nodes_of_function(statement)
        else:
            yield from ast.walk(statement)


def _edits(node: ast.AST, source: str, place: Place) -> Iterator[Edit]:
    def text(part: ast.AST) -> str:
        begin, end = place(part)
        return source[begin:end]

    if isinstance(node, ast.BinOp) and type(node.op) in SWAPS:
        sign = SIGNS[type(node.op)]
        swap = SWAPS[type(node.op)]
        begin = place(node.left)[1]
        end = place(node.right)[0]
        gap = source[begin:end]
        yield f"{sign} to {swap}", begin, end, gap.replace(sign, swap)
        yield f"right of {sign} left out", *place(node), f"({text(node.left)})"
        if sign in "+*":
            yield f"left of {sign} left out", *place(node), f"({text(node.right)})"
        elif sign == "-":
            yield "left of - left out", *place(node), f"(-({text(node.right)}))"
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        yield "sign left out", *place(node), text(node.operand)
    elif isinstance(node, ast.Constant) and type(node.value) is float:
        yield "number 1.25 times", *place(node), repr(1.25 * node.value or 0.25)
    elif isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant):
        yield "next index", *place(node.slice), str((node.slice.value + 1) % 2)
    elif isinstance(node, ast.Compare) and type(node.ops[0]) in (ast.Gt, ast.Lt):
        signs = "><" if isinstance(node.ops[0], ast.Gt) else "<>"
        begin = place(node.left)[1]
        end = place(node.comparators[0])[0]
        yield f"{signs[0]} to {signs[1]}", begin, end, source[begin:end].replace(*signs)
    elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load):
        if other := VARIABLES.get(node.attr):
            yield f"{node.attr} to {other}", *place(node), f"{text(node.value)}.{other}"
    elif isinstance(node, ast.Call):
        yield from _edits_of_call(node, text, place)
    elif isinstance(node, ast.Dict):
        for key, part in zip(node.keys, node.values, strict=True):
            begin = place(key)[0]
            after = place(part)[1]
            comma = source[after:].lstrip().startswith(",")
            end = after + source[after:].index(",") + 1 if comma else after
            yield f"{text(key)} left out", begin, end, ""


def _edits_of_call(node: ast.Call, text: Callable[[ast.AST], str],
                   place: Place) -> Iterator[Edit]:
    function = node.func.attr if isinstance(node.func, ast.Attribute) else ""
    if other := FUNCTIONS.get(function):
        yield f"{function} to {other}", *place(node.func), f"{text(node.func.value)}.{other}"
    if function in WITHOUT:
        yield f"{function} left out", *place(node), f"({text(node.args[0])})"
    if function in ("fmax", "fmin"):
        for part in node.args:
            yield f"limit of {function} left out", *place(node), f"({text(part)})"
    if function == "_replace":
        for keyword in node.keywords:
            yield (f"{keyword.arg} unchanged", *place(keyword.value),
                   f"{text(node.func.value)}.{keyword.arg}")
