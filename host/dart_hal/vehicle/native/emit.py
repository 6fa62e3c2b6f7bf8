"""C text of a traced step: straight lines in a loop over cars that gcc turns into vectors.

What gcc needs for that was found by experiment: no array inside the loop, the
functions of libmvec (-ffast-math), and never sine and cosine of one argument,
which it would fuse into a complex exponential that has no vector form; so
cosine is written as a shifted sine. One text serves f32 and f64, one vehicle
for all lanes and one per lane: see ``PRELUDE``.
"""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Iterable

from dart_hal.vehicle.native.model import Traced
from dart_hal.vehicle.native.trace import find_dependencies

PRELUDE = """\
/* Generated from the Python equations of the vehicle (`make native`); do not edit.
 *
 * BITS 32 or 64: the number type. LANES 0: one vehicle for all cars, its
 * coefficients h[k]; 1: one for each car, h[k * ldh + car]. The coefficients are
 * what depends on parameters and dt alone, computed by the caller.
 */
#include <math.h>
#include <stdint.h>

#if BITS == 32
typedef float real;
#define F(function) function##f
#define LEAST -87.0f
#else
typedef double real;
#define F(function) function
#define LEAST -708.0
#endif
#define R(number) ((real)number)
#if EXACT /* the functions that Python calls */
#define EXP(x) F(exp)(x)
#define COS(x) F(cos)(x)
#else
/* what would underflow takes libmvec out of its vectors, at half the speed of a step */
#define EXP(x) F(exp)(F(fmax)(x, LEAST))
#define COS(x) F(sin)((x) + R(1.5707963267948966))
#endif
#if LANES
#define H(k) h[(k) * ldh + i]
#else
#define H(k) h[k]
#endif
#define BLOCK 128 /* cars that stay in the first cache together */
#define PAD 16    /* cars of the widest vector */
#define INSIDE static inline __attribute__((always_inline)) void

typedef struct {
    int64_t n, samples, substeps, reads; /* cars, rows of input, steps per row, rows of output */
    int64_t ldh, lane, row;              /* strides of h, and of inputs by car and by sample */
    const int64_t *at;                   /* (reads) samples passed, ascending */
    const real *h, *u0, *u1, *start;     /* start (states, n) */
    real *out;                           /* (reads, states, n) */
} job;
"""

ARRAYS = ("state[", "held[", "given[")
RESERVED = {"i", "h", "w", "ldh", "state", "held", "given", "real", "job"}

DRIVER = """\
void run_{name}(const job *j)
{{
    real state[{states}][BLOCK] __attribute__((aligned(64)));
    real held[{held}][BLOCK] __attribute__((aligned(64)));
    real given[2][BLOCK] __attribute__((aligned(64)));
    for (int64_t first = 0; first < j->n; first += BLOCK) {{
        const int64_t left = j->n - first, m = left < BLOCK ? left : BLOCK;
        const int64_t w = m == 1 ? 1 : (m + PAD - 1) / PAD * PAD; /* whole vectors */
        const real *h = j->h + (LANES ? first : 0);
        int64_t read = 0;
        for (int q = 0; q < {states}; q++)
            for (int64_t i = 0; i < w; i++)
                state[q][i] = j->start[q * j->n + first + (i < m ? i : m - 1)];
        for (int64_t t = 0;; t++) {{
            for (; read < j->reads && j->at[read] == t; read++)
                for (int q = 0; q < {states}; q++)
                    for (int64_t i = 0; i < m; i++)
                        j->out[(read * {states} + q) * j->n + first + i] = state[q][i];
            if (t == j->samples || read == j->reads)
                break;
            for (int64_t i = 0; i < w; i++) {{
                const int64_t from = t * j->row + j->lane * (first + (i < m ? i : m - 1));
                given[0][i] = j->u0[from];
                given[1][i] = j->u1[from];
            }}
            hold_{name}(w, j->ldh, h, given, held);
            for (int64_t sub = 0; sub < j->substeps; sub++)
                step_{name}(w, j->ldh, h, held, state);
        }}
    }}
}}
"""


def body(traced: Traced) -> str:
    """The functions of one step: hold, step and the exported ``run_<name>(job)``."""
    name = traced.name
    names = (*traced.states, *traced.inputs)
    if bad := [s for s in names if s in RESERVED or not s.isidentifier()]:
        raise ValueError(f"{', '.join(bad)} cannot be a name in C here")
    hold = _Lines(traced, {**_rows("H({})", traced.uniform), **_symbols(traced, traced.inputs,
                                                                        "given[{}][i]")})
    step = _Lines(traced, {**_rows("H({})", traced.uniform), **_rows("held[{}][i]", traced.held),
                           **_symbols(traced, traced.states, "state[{}][i]")})
    arguments = "int64_t w, int64_t ldh, const real *restrict h"
    return "\n".join([
        f"INSIDE hold_{name}({arguments},", "    real (*restrict given)[BLOCK], "
        "real (*restrict held)[BLOCK])",
        *_loop(hold.write(traced.held, "held[{}][i]")), "",
        f"INSIDE step_{name}({arguments},", "    real (*restrict held)[BLOCK], "
        "real (*restrict state)[BLOCK])",
        *_loop(step.write(traced.outputs, "state[{}][i]")), "",
        DRIVER.format(name=name, states=len(traced.states), held=max(len(traced.held), 1)),
    ])


def source(bodies: Iterable[str]) -> str:
    """A whole C file."""
    return PRELUDE + "".join(f"\n{text}" for text in bodies)


def _rows(pattern: str, nodes: Iterable[int]) -> dict[int, str]:
    return {index: pattern.format(row) for row, index in enumerate(nodes)}


def _symbols(traced: Traced, targets: tuple[str, ...], pattern: str) -> dict[int, str]:
    where = {node.name: i for i, node in enumerate(traced.graph.nodes) if node.op == "symbol"}
    return {where[name]: pattern.format(row) for row, name in enumerate(targets)}


def _loop(lines: list[str]) -> list[str]:
    out = ["{", "#pragma omp simd", "    for (int64_t i = 0; i < w; i++) {"]
    for line in lines:
        out += textwrap.wrap(line, 98, initial_indent=" " * 8, subsequent_indent=" " * 12,
                             break_long_words=False, break_on_hyphens=False)
    return [*out, "    }", "}"]


class _Lines:
    """Statements for some nodes; what is used once goes into the place where it is used."""

    def __init__(self, traced: Traced, given: dict[int, str]) -> None:
        self._nodes = traced.graph.nodes
        self._graph = traced.graph
        self._given = given

    def write(self, targets: tuple[int, ...], target: str) -> list[str]:
        order = self._order(targets)
        uses = Counter(a for i in order if i not in self._given for a in self._nodes[i].args)
        uses.update(targets)
        text: dict[int, str] = {}
        lines = []
        for i in order:
            expression = self._given.get(i) or self._expression(i, text)
            leaf = self._nodes[i].op == "const" or expression.startswith("H(")
            if (uses[i] > 1 or expression.startswith(ARRAYS)) and not leaf:
                name = self._nodes[i].name or f"v{i}"
                lines.append(f"const real {name} = {_bare(expression)};")
                expression = name
            text[i] = expression
        lines += [f"{target.format(row)} = {_bare(text[i])};" for row, i in enumerate(targets)]
        return lines

    def _order(self, targets: tuple[int, ...]) -> list[int]:
        """Nodes to compute, without what lies behind given ones."""
        found: set[int] = set()
        todo = list(targets)
        while todo:
            i = todo.pop()
            if i not in found:
                found.add(i)
                todo.extend(() if i in self._given else self._nodes[i].args)
        return [i for i in find_dependencies(self._graph, targets) if i in found]

    def _expression(self, index: int, text: dict[int, str]) -> str:
        node = self._nodes[index]
        args = [text[a] for a in node.args]
        if node.op == "const":
            return f"R({node.value!r})"
        if node.op in "+-*/":
            return f"({args[0]} {node.op} {args[1]})"
        if node.op == "neg":
            return f"(-{args[0]})"
        if node.op == "cos":
            return f"COS({_bare(args[0])})"
        if node.op == "exp":
            return f"EXP({_bare(args[0])})"
        return f"F({node.op})({', '.join(map(_bare, args))})"


def _bare(expression: str) -> str:
    """Without the brackets round the whole of it."""
    if not expression.startswith("("):
        return expression
    depth = 0
    for i, c in enumerate(expression):
        depth += (c == "(") - (c == ")")
        if depth == 0:
            return expression[1:-1] if i == len(expression) - 1 else expression
    return expression
