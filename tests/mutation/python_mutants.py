"""Mutants of a Python file: the operators of cosmic-ray, and calls left out."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

from mutant import CHECKOUT, Mutant, make_mutant

BINARY = ("Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul", "FloorDiv_Mul", "Mod_Add", "BitOr_BitAnd",
          "BitAnd_BitOr", "BitXor_BitOr", "LShift_RShift", "RShift_LShift")
COMPARISON = ("Lt_LtE", "LtE_Lt", "Gt_GtE", "GtE_Gt", "Lt_GtE", "Gt_LtE", "Eq_NotEq", "NotEq_Eq",
              "Is_IsNot", "IsNot_Is")
OTHERS = ("ReplaceUnaryOperator_USub_UAdd", "ReplaceUnaryOperator_Delete_Not", "AddNot",
          "ReplaceTrueWithFalse", "ReplaceFalseWithTrue", "ReplaceAndWithOr",
          "ReplaceOrWithAnd", "ReplaceBreakWithContinue", "ReplaceContinueWithBreak",
          "ExceptionReplacer", "NumberReplacer", "ZeroIterationForLoop")
GRID_ROW = re.compile(r"^[A-Z_]+(?: +(?:\.|[A-Z]+)){5,}$", re.MULTILINE)
OPERATORS = tuple(f"core/{name}" for name in (
    *(f"ReplaceBinaryOperator_{pair}" for pair in BINARY),
    *(f"ReplaceComparisonOperator_{pair}" for pair in COMPARISON), *OTHERS))


def python_mutants(file: str) -> Iterator[Mutant]:
    """Every mutant of ``file`` (relative to the checkout) that means something else."""
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    source = (CHECKOUT / file).read_text(encoding="utf-8")
    same = _meaning(source)
    for name in OPERATORS:
        occurrence = 0
        while (text := mutate_code(source, get_operator(name)(), occurrence)) is not None:
            occurrence += 1
            made = make_mutant(file, _short(name), source, text)
            if made and not made.before.startswith("@") and _meaning(text) not in (same, None):
                yield made
    yield from _without_calls(file, source)
    yield from _without_cells(file, source)


def _without_calls(file: str, source: str) -> Iterator[Mutant]:
    """Each call made for its effect alone, left out."""
    lines = source.splitlines(keepends=True)
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
            first = node.lineno - 1
            last = node.end_lineno
            indent = lines[first][:node.col_offset]
            text = "".join([*lines[:first], indent + "pass\n", *lines[last:]])
            if made := make_mutant(file, "CallLeftOut", source, text):
                yield made


def _without_cells(file: str, source: str) -> Iterator[Mutant]:
    """Each way out of a state in a grid of events (rows) and states, closed."""
    for row in GRID_ROW.finditer(source):
        for cell in re.finditer(r"(?<= )[A-Z]+", row[0]):
            at = row.start() + cell.start()
            closed = ".".ljust(len(cell[0]))
            text = source[:at] + closed + source[at + len(cell[0]):]
            if made := make_mutant(file, "CellClosed", source, text):
                yield made


def _meaning(source: str) -> str | None:
    """The syntax tree without annotations, which nothing evaluates here; None: no Python."""
    try:
        tree = ast.parse(source)
    except SyntaxError:
        return None
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            node.returns = None
        elif isinstance(node, ast.arg):
            node.annotation = None
        elif isinstance(node, ast.AnnAssign):
            node.annotation = ast.Constant(None)
    return ast.dump(tree)


def _short(name: str) -> str:
    return name.removeprefix("core/").replace("Operator", "").removeprefix("Replace")
