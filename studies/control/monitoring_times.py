"""How long a team takes to spread, by what is called spread and where it begins.

    python -m studies.control.monitoring_times [--starts 400]

k = 0.1 rad/s, steps of 0.1 s by RK4. Of each way to begin and each measure that has to fall below
0.01 rad: the median time over the starts, what it is over the time that was to be reached, and
which share of the starts is as quick as that.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np

from dart_hal.control.monitoring.kuramoto import evenly_spread
from dart_hal.core.types import FloatArray

K, DT, WITHIN, MOST = 0.1, 0.1, 0.01, 400.0
TIMES = {(9, 5): 66.0, (9, 4): 66.0, (5, 2): 23.0, (3, 1): 26.0, (4, 2): 20.0, (25, 11): 188.0}
"""s that were to be reached, each of one start that is not named; for nine robots 61 to 71."""
STARTS: dict[str, Callable[[np.random.Generator, tuple[int, int]], FloatArray]] = {
    "within 0.5 rad": lambda rng, shape: rng.uniform(-0.5, 0.5, shape),
    "0 to 0.5 rad": lambda rng, shape: rng.uniform(0.0, 0.5, shape),
    "normal, 0.5 rad": lambda rng, shape: rng.normal(0.0, 0.5, shape)}


def rates(theta: FloatArray) -> FloatArray:
    """Of many teams (m, n) at once, seen by who goes round at Omega."""
    return np.asarray(K * (np.sin(theta - np.roll(theta, 1, axis=1))
                           + np.sin(theta - np.roll(theta, -1, axis=1))))


def stepped(theta: FloatArray) -> FloatArray:
    a = rates(theta)
    b = rates(theta + 0.5 * DT * a)
    c = rates(theta + 0.5 * DT * b)
    d = rates(theta + DT * c)
    return np.asarray(theta + DT / 6.0 * (a + 2.0 * b + 2.0 * c + d))


def wrapped(x: FloatArray) -> FloatArray:
    return np.asarray(np.remainder(x + np.pi, 2.0 * np.pi) - np.pi)


def measures(theta: FloatArray, p: int) -> dict[str, FloatArray]:
    """[rad] of teams (m, n): of differences between neighbours, and of phases from the even spread
    of the mean phase."""
    n = theta.shape[1]
    between = wrapped(np.roll(theta, -1, axis=1) - theta - 2.0 * np.pi * p / n)
    off = wrapped(theta - evenly_spread(n, p) - theta[:, :1])
    off -= off.mean(axis=1, keepdims=True)
    return {f"{name} of {what}": fold(error)
            for what, error in (("differences", between), ("phases", off))
            for name, fold in (("largest", lambda e: np.abs(e).max(axis=1)),
                               ("rms", lambda e: np.sqrt((e**2).mean(axis=1))),
                               ("norm", lambda e: np.sqrt((e**2).sum(axis=1))))}


def times(n: int, p: int, begin: str, starts: int, seed: int = 0) -> dict[str, FloatArray]:
    """s of each start (starts,) by each measure; inf: not by ``MOST``."""
    theta = evenly_spread(n, p) + STARTS[begin](np.random.default_rng(seed), (starts, n))
    found = {name: np.full(starts, np.inf) for name in measures(theta, p)}
    for step in range(round(MOST / DT)):
        for name, error in measures(theta, p).items():
            found[name][(error < WITHIN) & np.isinf(found[name])] = step * DT
        if all(np.isfinite(one).all() for one in found.values()):
            break
        theta = stepped(theta)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--starts", type=int, default=400)
    starts = parser.parse_args().starts
    for begin in STARTS:
        found = {team: times(*team, begin, starts) for team in TIMES}
        for name in found[3, 1]:
            row = []
            for team, wanted in TIMES.items():
                of = found[team][name]
                row.append(f"{team[0]},{team[1]}: {np.median(of):.1f} s = "
                           f"{np.median(of) / wanted:.2f}, {np.mean(of <= wanted):.0%}")
            print(f"{begin}, {name}: " + "; ".join(row), flush=True)


if __name__ == "__main__":
    main()
