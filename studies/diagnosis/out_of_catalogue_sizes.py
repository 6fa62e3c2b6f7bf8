"""How large a cause outside the catalogue must be to disturb as much as a medium steering lag.

    python -m studies.diagnosis.out_of_catalogue_sizes [NAME ...]

For what no list gives sizes, medium is what raises the loss of the right model
as much as a lag of 0.06 s does, in the mean over drives. ``out_of_catalogue.FAR`` has
what this prints, rounded; between two sizes that were tried where the loss is steep.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np

from dart_hal.vehicle import PAPER
from dart_lab.diagnosis.run import make_evidence
from dart_lab.identification.evidence.noise import Noise, estimate_noise
from dart_lab.identification.evidence.residuals import Evidence
from dart_lab.identification.evidence.space import MessageTiming, Space
from dart_lab.identification.objective import Point, refit
from studies.diagnosis.known_frame import read
from studies.diagnosis.out_of_catalogue import FAR
from studies.diagnosis.stranger import Car
from studies.diagnosis.stranger_causes import SIZES, hide
from studies.diagnosis.stranger_files import Habits, pair

MEASURE, MEDIUM = "steering_lag", 1
DRIVES = tuple(product(("steps", "waves", "laps"), (1, 2)))  # style, seed
SECONDS = (120.0, 10.0)
ROUNDS = 3
Prepare = Callable[[Car], None]


def evidence(prepare: Prepare, style: str, seed: int) -> Evidence:
    """Of one drive of a car with something in it."""
    car = Car()
    prepare(car)
    with tempfile.TemporaryDirectory() as folder:
        train, _ = pair(Path(folder), car, Habits(style=style), SECONDS, seed)
        return make_evidence([read(train)], PAPER.body.l_r)[0]


def fitted(seen: Evidence, noise: Noise) -> Point:
    """The right model but for the cause, with timing alone free."""
    space = Space(PAPER, ())
    return refit(seen, noise, space, space.point(MessageTiming()))


class Drops:
    """Rise of the loss by a cause, in the mean over drives, each by the noise it has without it."""

    def __init__(self) -> None:
        self._without = {}
        for drive in DRIVES:
            seen = evidence(lambda car: None, *drive)
            blocks = seen.blocks()
            noise = estimate_noise(seen.residuals(PAPER, MessageTiming()), blocks, seen.overlap)
            timing = fitted(seen, noise).timing
            noise = estimate_noise(seen.residuals(PAPER, timing), blocks, seen.overlap)
            self._without[drive] = noise, fitted(seen, noise).loss()

    def of(self, prepare: Prepare) -> float:
        return float(np.mean([fitted(evidence(prepare, *drive), noise).loss() - nothing
                              for drive, (noise, nothing) in self._without.items()]))


def main(names: list[str]) -> None:
    drops = Drops()
    wanted = drops.of(partial(hide, name=MEASURE, size=SIZES[MEASURE][MEDIUM]))
    print(f"{MEASURE} {SIZES[MEASURE][MEDIUM]}: {wanted:.0f}")
    for name in names or FAR:
        act, size = FAR[name]
        tried = []
        for _ in range(ROUNDS):
            drop = drops.of(partial(act, k=size))
            tried.append(f"{size:.3g}: {drop:.0f}")
            size *= (wanted / max(drop, 1.0)) ** 0.5
        print(f"{name}: {size:.2g}   ({', '.join(tried)})", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
