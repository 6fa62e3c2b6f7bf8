"""How often the 90 % intervals of the measuring procedures hold the hidden truth.

    python -m tests.calibration.coverage --seeds 40 [--first 1] [clock] [encoder] [imu]
        [esc] [throttle] [circle] [latency] [mocap]

Slow (1 to 10 s a car and verb). Each car of the latency has a delay and a lag of its motor drawn
from its seed, and its steering is calibrated before. Prints one row per quantity: how many
intervals hold it, rms of error by standard error, worst error. The clock's intervals are wide
here: the crystal of a simulated host has no error.
"""

from __future__ import annotations

import argparse
from collections import defaultdict

import numpy as np
from tests.calibration.hidden_errors import VERBS, errors

from dart_hal.types import NINETY


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("verbs", nargs="*", default=list(VERBS), metavar="VERB")
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--first", type=int, default=1)
    given = parser.parse_args()
    rows: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for seed in range(given.first, given.first + given.seeds):
        for verb in given.verbs:
            for name, pair in errors(verb, seed).items():
                rows[name].append(pair)
    for name, pairs in rows.items():
        error, std = np.array(pairs).T
        z = error / std
        print(f"{name:34s} {int(np.sum(np.abs(z) < NINETY)):3d} of {len(z)} inside 90 %, "
              f"z rms {np.sqrt(np.mean(z**2)):.2f}, worst {np.max(np.abs(z)):.1f} sigma, "
              f"worst error {np.max(np.abs(error)):.3g}")


if __name__ == "__main__":
    main()
