"""How often the 90 % intervals of the measuring procedures hold the hidden truth.

    python -m tests.calibration.coverage --seeds 40 [--first 1] [clock] [encoder] [imu] [latency]

Slow (1 to 10 s a car and verb). Each car of the latency has a delay and a lag of its motor drawn
from its seed, and its steering is calibrated before. Prints one row per quantity: how many
intervals hold it, rms of error by standard error, worst error. The clock's intervals are wide
here: the crystal of a simulated host has no error.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import defaultdict
from collections.abc import Callable

import numpy as np

from dart_hal.calibration.clock import calibrate_clock
from dart_hal.calibration.encoder import calibrate_encoder
from dart_hal.calibration.imu import calibrate_imu
from dart_hal.calibration.latency import calibrate_latency
from dart_hal.calibration.measured import Measured
from dart_hal.calibration.steering import calibrate_steering
from dart_hal.car import Car
from dart_hal.config import Quantity
from dart_hal.links.base import Url, open_backend
from dart_hal.ports import Workshop
from dart_hal.sim.truth import reveal_url
from dart_hal.types import NINETY

VERBS: dict[str, Callable[[Car, Workshop], Measured]] = {
    "clock": lambda car, workshop: calibrate_clock(car),
    "encoder": calibrate_encoder, "imu": calibrate_imu,
    "latency": lambda car, workshop: calibrate_latency(car)}


def url_of(verb: str, seed: int) -> str:
    """The hidden car of a seed."""
    url = f"sim://?seed={seed}&nano=mock"
    if verb != "latency":
        return url
    rng = np.random.default_rng([seed, 500])
    delay, lag = rng.uniform(0.0, 0.04), rng.uniform(0.015, 0.1)
    return f"{url}&effect=throttle_delay:{delay:.4f},throttle_lag:{lag:.4f}"


def true_sensors(url: str) -> dict[str, float]:
    """The truth of ``sim --reveal`` with the effects of the URL on top."""
    found = reveal_url(Url.parse(url))
    sensors = found["sensors"]
    for effect in found["effects"]:
        name = {"throttle_delay": "latency.pulse_to_wheel",
                "throttle_lag": "latency.pulse_to_wheel_lag"}[effect["name"]]
        sensors[name] += next(iter(effect["parameters"].values()))["value"]
    return dict(sensors)


def errors(verb: str, seed: int) -> dict[str, tuple[float, float]]:
    """(error, standard error) of each scalar quantity of one hidden car."""
    url = url_of(verb, seed)
    with tempfile.TemporaryDirectory() as folder:
        if verb == "latency":
            with Car.open(url, cars=folder) as car:
                calibrate_steering(car)
        backend = open_backend(url)
        with Car.over(backend, cars=folder) as car:
            found = VERBS[verb](car, backend.workshop)
    true = true_sensors(url)
    return {name: (q.value - true[name], q.std) for name, q in found.quantities.items()
            if isinstance(q, Quantity)}


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
        print(f"{name:26s} {int(np.sum(np.abs(z) < NINETY)):3d} of {len(z)} inside 90 %, "
              f"z rms {np.sqrt(np.mean(z**2)):.2f}, worst {np.max(np.abs(z)):.1f} sigma, "
              f"worst error {np.max(np.abs(error)):.3g}")


if __name__ == "__main__":
    main()
