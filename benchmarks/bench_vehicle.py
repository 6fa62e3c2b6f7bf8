"""How fast cars are simulated: one, a batch, and how far that is from what the core can compute.

A step is one Runge-Kutta step of 10 ms of the dynamic bicycle with the lags of
both actuators as states, a car-step that of one car in a batch.
"""

from __future__ import annotations

import ctypes
import math
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
from figures import Figure, best_cpu

from dart_hal.vehicle import PAPER, UPSTREAM_2024, Batch, Vehicle, rollout
from dart_hal.vehicle.batch import car_rollout, car_step
from dart_hal.vehicle.native import build, status
from dart_hal.vehicle.native.model import form_of, trace
from dart_hal.vehicle.native.trace import FUNCTIONS, find_dependencies

ROUNDS, CARS = 5, 10_000
START = (0.0, 0.0, 0.0, 1.2, 0.0, 0.3, 0.2, 0.1)
CHEAP = {"fabs", "fmin", "fmax", "floor", "neg"}
"""One instruction each; the other functions are polynomials."""
PER_FUNCTION = 30
"""Flops of one vector sine, tanh and so on: range reduction, polynomial, reassembly."""

CHAINS = 16
"""Independent multiply-adds in flight: more than latency times units, fewer than registers."""
PEAK = "\n".join([
    "#if BITS == 32", "typedef float real;", "#else", "typedef double real;", "#endif",
    "typedef real vec __attribute__((vector_size(64)));",
    "double peak(long n, double x, double y) {",
    "    const vec a = {0}, p = a + (real)x, q = a + (real)y;",
    *(f"    vec s{k} = a + {k};" for k in range(CHAINS)),
    "    while (n--) {", *(f"        s{k} = s{k} * p + q;" for k in range(CHAINS)), "    }",
    f"    vec sum = {' + '.join(f's{k}' for k in range(CHAINS))};", "    return sum[0];", "}", ""])


def figures(scale: float = 1.0) -> list[Figure]:
    """Rows of the table; the paper's car is next to the later set, which has more terms."""
    rows = _single(scale) + _batch("numpy", scale)
    if not status().startswith("compiled"):
        return [*rows, Figure("vehicle: compiled kernels", math.nan, "", note=status())]
    fast = _batch("native", scale)
    return [*rows, *_native_single(scale), *fast, *_limit(fast), _windows(scale), _agreement()]


def _single(scale: float) -> list[Figure]:
    rates = [_per_call(p, "numpy", round(5000 * scale)) for p in (UPSTREAM_2024, PAPER)]
    return [Figure("vehicle: one car, pure Python", rates[0], "steps/s", 50e3, note=_paper(rates))]


def _native_single(scale: float) -> list[Figure]:
    calls = [_per_call(p, "native", round(50_000 * scale)) for p in (UPSTREAM_2024, PAPER)]
    rows = [Figure("vehicle: one car, kernel, call by call", calls[0], "steps/s", 250e3,
                   note=_paper(calls))]
    for dtype, low in ((np.float64, 0.7e6), (np.float32, 1e6)):
        rates = [_one_rollout(p, dtype, round(100_000 * scale)) for p in (UPSTREAM_2024, PAPER)]
        rows.append(Figure(f"vehicle: one car, kernel, in a rollout, {_short(dtype)}", rates[0],
                           "steps/s", low, note=_paper(rates)))
    return rows


def _batch(engine: str, scale: float) -> list[Figure]:
    targets = {("numpy", np.float32): 1e6, ("native", np.float64): 3.5e6,
               ("native", np.float32): 10e6}
    rows = []
    for dtype in (np.float64, np.float32):
        steps = max(2, round((10 if engine == "numpy" else 60) * scale))
        rates = [_many(p, engine, dtype, steps) for p in (UPSTREAM_2024, PAPER)]
        name = f"vehicle: 10,000 cars, {'kernel' if engine == 'native' else engine}"
        rows.append(Figure(f"{name}, {_short(dtype)}", rates[0], "car-steps/s",
                           targets.get((engine, dtype)), note=_paper(rates)))
    return rows


def _limit(batch: list[Figure]) -> list[Figure]:
    """Share of the core's arithmetic that the batch uses."""
    flops, functions = work(UPSTREAM_2024)
    rows = []
    for row, bits in zip(batch, (64, 32), strict=True):
        peak = fma_peak(bits)
        limit = peak / (flops + PER_FUNCTION * functions)
        rows.append(Figure(f"vehicle: of the arithmetic limit, f{bits}", 100 * row.value / limit,
                           "%", note=f"{flops} flops + {functions} functions of {PER_FUNCTION}; "
                           f"{peak / 1e9:.0f} GFlop/s of multiply-add: {limit / 1e6:.0f} M/s"))
    return rows


def _windows(scale: float) -> Figure:
    """Open-loop predictions as evaluation and fits make them: 2 s, four substeps per sample."""
    n, samples = max(100, round(5000 * scale)), 200
    start = np.repeat(np.array(START[:6])[:, None], n, axis=1)
    held = np.full((samples, n), 0.3), np.full((samples, n), 0.1)
    best = best_cpu(lambda: rollout(PAPER, start, *held, output_samples=[50, 100, 200]), ROUNDS)
    return Figure("vehicle: windows of 2 s, 2.5 ms steps, f64", n / best, "windows/s",
                  note=f"{4 * n * samples / best / 1e6:.1f} M car-steps/s")


def _agreement() -> Figure:
    n, steps = 500, 200
    draw = np.random.default_rng(1)
    start = np.repeat(np.array(START)[:, None], n, axis=1) * draw.uniform(0.7, 1.3, (8, n))
    held = draw.uniform(0.2, 0.4, (steps, n)), draw.uniform(-0.4, 0.4, (steps, n))
    got, expected = (car_rollout(UPSTREAM_2024, start, *held, output_samples=[steps], engine=e)
                   for e in ("native", "numpy"))
    difference = float(np.max(np.abs(got - expected) / np.maximum(1.0, np.abs(expected))))
    return Figure("vehicle: kernel and numpy after 200 steps, f64", difference, "of scale",
                  high=1e-12)


def work(p: Vehicle) -> tuple[int, int]:
    """(flops, functions) of one car-step, as the kernel computes it; a fused pair counts two."""
    traced = trace(form_of(p), "car")
    given = set(traced.uniform)
    inside = [i for i in find_dependencies(traced.graph, traced.outputs)
              if i not in _behind(traced.graph, given)]
    count = Counter(traced.graph.nodes[i].op for i in inside)
    functions = sum(n for op, n in count.items() if op in FUNCTIONS and op not in CHEAP)
    flops = sum(n for op, n in count.items() if op in "+-*/" or op in CHEAP)
    return flops, functions


def _behind(graph: object, given: set[int]) -> set[int]:
    return set(find_dependencies(graph, tuple(given)))  # type: ignore[arg-type]


def fma_peak(bits: int) -> float:
    """Flops per second of independent multiply-adds in whole vectors on this core."""
    with tempfile.TemporaryDirectory() as folder:
        path = build.compile_kernel(PEAK, build.Variant(bits, False), Path(folder))
        peak = ctypes.CDLL(str(path)).peak
        peak.argtypes, peak.restype = (ctypes.c_long, *2 * (ctypes.c_double,)), ctypes.c_double
        n = 2_000_000
        best = best_cpu(lambda: peak(n, 0.999, 0.001), ROUNDS)
    return n * CHAINS * (512 // bits) * 2 / best


def _per_call(p: Vehicle, engine: str, steps: int) -> float:
    step = car_step(p, engine=engine)

    def drive() -> None:
        state = START
        for _ in range(steps):
            state = step(*state, 0.3, 0.2)

    return steps / best_cpu(drive, ROUNDS)


def _one_rollout(p: Vehicle, dtype: type, steps: int) -> float:
    start = np.array(START, dtype=dtype)[:, None]
    held = np.full((steps, 1), 0.3, dtype=dtype), np.full((steps, 1), 0.2, dtype=dtype)
    return steps / best_cpu(lambda: car_rollout(p, start, *held, output_samples=[steps],
                                                engine="native"),
                            ROUNDS)


def _many(p: Vehicle, engine: str, dtype: type, steps: int) -> float:
    batch = Batch(p, CARS, dtype=dtype, engine=engine)
    draw = np.random.default_rng(0)
    held = draw.uniform(0.2, 0.4, CARS).astype(dtype), draw.uniform(-0.5, 0.5, CARS).astype(dtype)

    def drive() -> None:
        batch.state[...] = np.array(START, dtype=dtype)[:, None]
        batch.advance(*held, steps=steps)

    return CARS * steps / best_cpu(drive, ROUNDS)


def _short(dtype: type) -> str:
    return f"f{8 * np.dtype(dtype).itemsize}"


def _paper(rates: list[float]) -> str:
    return f"set upstream-2024 with lags; paper {rates[1]:,.0f}"


def main() -> None:
    """Print the rows."""
    for f in figures():
        print(f"{f.name:<52}{f.measured:>26}{f.target:>14}  {f.note}")


if __name__ == "__main__":
    main()
