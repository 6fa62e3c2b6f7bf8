"""Mutants of a C++ file: one operator, literal or statement at a time.

Text, not syntax: operators count where the house style puts spaces around
them, so templates, pointers and references stay whole. What the compiler then
refuses is no mutant and is not counted.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from mutant import CHECKOUT, Mutant, make_mutant

SWAPS = {" < ": " <= ", " <= ": " < ", " > ": " >= ", " >= ": " > ", " == ": " != ",
         " != ": " == ", " && ": " || ", " || ": " && ", " + ": " - ", " - ": " + ",
         " & ": " | ", " | ": " & ", " |= ": " &= ", " &= ": " |= ", " += ": " -= ",
         " << ": " >> ", " >> ": " << ", "++": "--", "--": "++",
         "true": "false", "false": "true"}
CPP_TOKEN = re.compile("|".join(r"\b" + k + r"\b" if k.isalpha() else re.escape(k)
                                for k in sorted(SWAPS, key=len, reverse=True)))
NOT = re.compile(r"(?<=[( ])!(?=\w)")
NUMBER = re.compile(r"(?<![\w.])\d+(?=u?\b)(?!\.)")
STATEMENT = re.compile(r"^ +(?!return|break|case|default|using|constexpr|static_assert|for|while"
                       r"|if|else|switch|[\w:<> ]+ const [\w]+ =)[\w.\->:*\[\]+ =|&()~]+;$")
OUTSIDE = re.compile(r"//[^\n]*|/\*.*?\*/|\"(?:\\.|[^\"\\])*\"|^#(?:[^\n]*\\\n)*[^\n]*|"
                     r"static_assert\(.*?\);|constexpr bool \w+\(.*?^}|enum class.*?};",
                     re.DOTALL | re.MULTILINE)


def cpp_mutants(file: str) -> Iterator[Mutant]:
    """Every mutant of ``file`` (relative to the checkout)."""
    source = (CHECKOUT / file).read_text(encoding="utf-8")
    code = OUTSIDE.sub(lambda m: re.sub(r"[^\n]", "\1", m[0]), source)
    for name, start, end, new in _edits(code):
        if made := make_mutant(file, name, source, source[:start] + new + source[end:]):
            yield made


def _edits(code: str) -> Iterator[tuple[str, int, int, str]]:
    """(operator, start, end, the replacement)."""
    for m in CPP_TOKEN.finditer(code):
        yield f"{m[0].strip()} to {SWAPS[m[0]].strip()}", *m.span(), SWAPS[m[0]]
    for m in NOT.finditer(code):
        yield "! left out", *m.span(), ""
    for m in NUMBER.finditer(code):
        yield "number + 1", *m.span(), str(int(m[0]) + 1)
    at = 0
    for line in code.splitlines(keepends=True):
        if STATEMENT.match(line.rstrip("\n")):
            yield "statement left out", at, at + len(line), "\n"
        at += len(line)
