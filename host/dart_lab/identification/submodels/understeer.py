"""How tyre slip changes the turn with speed: K, from one command at several speeds.

It is what encoder, gyro and steering alone tell of the tyres: one combination of them.

atan(l W/v) = delta - kappa v^2 sin(2 delta)/2. A car that drives at constant
throttle is slower in tighter turns, so speed goes with the command, and a
wrong shape of the map would look like slip. Hence only differences between
stretches of the same command count, and a prior of what 1:10 cars do (0 +-
0.06 s2/m2) stands in where there are none.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dart_hal.calibration.loop import UNDERSTEER_STD
from dart_hal.calibration.samples import LEVEL_WIDTH, Samples, concatenate
from dart_hal.core.types import FloatArray, IntArray
from dart_hal.recording.dart import Recording, Reference
from dart_hal.vehicle import Vehicle
from dart_lab.identification.submodels.report import Ledger
from dart_lab.identification.submodels.steady import steady_samples

STRETCH = 20  # samples
MIN_SAMPLES = 5  # of a stretch
MIN_RANGE = 0.2  # m/s between the speeds of one command; less is counting noise
MISFIT = 0.01  # rad; no stretch's mean angle is better than that (backlash, floor)


def slip_of(samples: Samples, square: FloatArray, owner: IntArray) -> tuple[float, float]:
    """(kappa, std) [s2/m2] of data and prior together; arguments as ``slip_in_data``."""
    found = slip_in_data(samples, square, owner)
    if found is None:
        return 0.0, UNDERSTEER_STD
    value, std = found
    precision = 1.0 / UNDERSTEER_STD**2 + 1.0 / std**2
    return value / std**2 / precision, float(precision**-0.5)


def slip_in_data(samples: Samples, square: FloatArray, owner: IntArray
                 ) -> tuple[float, float] | None:
    """(kappa, std) [s2/m2]; None: no command at two speeds.

    square (n,) v^2; owner (n,): recording of each sample. Means of stretches,
    so that the counting noise of v does not enter both sides; levels are
    compared within one recording.
    """
    index = _stretches(samples.block)
    count = np.bincount(index).astype(np.float64)

    def mean(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(index, values) / count)

    angle, level = mean(samples.angle), np.round(mean(samples.command) / LEVEL_WIDTH)
    effect = -0.5 * mean(square) * np.sin(2.0 * angle)
    group = np.unique(np.stack([mean(owner.astype(np.float64)), level], axis=1), axis=0,
                      return_inverse=True)[1].reshape(-1)
    speed = np.sqrt(mean(square))
    top, low = np.zeros(group.max() + 1), np.full(group.max() + 1, np.inf)
    np.maximum.at(top, group, np.where(count >= MIN_SAMPLES, speed, 0.0))
    np.minimum.at(low, group, np.where(count >= MIN_SAMPLES, speed, np.inf))
    weight = ((count >= MIN_SAMPLES) & (top - low > MIN_RANGE)[group]).astype(np.float64)
    total = np.maximum(np.bincount(group, weight), 1e-12)
    x = effect - (np.bincount(group, weight * effect) / total)[group]
    y = angle - (np.bincount(group, weight * angle) / total)[group]
    information = float(weight @ x**2)
    if information <= 0.0:
        return None
    value = float(weight @ (x * y)) / information
    score = np.bincount(group, weight * x * (y - value * x))
    variance = max(float(score @ score) / information**2, MISFIT**2 / information)
    return value, float(np.sqrt(variance))


def _stretches(block: IntArray) -> IntArray:
    """Blocks (n,) cut into stretches of 2 s: within one command the speed may change slowly."""
    _, first, label = np.unique(block, return_index=True, return_inverse=True)
    place = (np.arange(len(block)) - first[label]) // STRETCH
    return np.asarray(np.unique(label * len(block) + place, return_inverse=True)[1])


def understeer(recordings: Sequence[Recording], reference: Reference | None, car: Vehicle
               ) -> tuple[float, float] | None:
    """(K, std) [s2/m2] of yaw rate = v tan(delta)/(l (1 + K v^2)); None: no command at two speeds.

    K = m/l^2 (l_r/C_f - l_f/C_r): one equation for two stiffnesses.
    """
    parts: list[tuple[Samples, FloatArray]] = []
    for recording in recordings:
        found = steady_samples(recording, car.body.wheelbase, reference, Ledger())
        if found is not None:
            parts.append(found)
    if not parts:
        return None
    owner = np.repeat(np.arange(len(parts)), [len(s) for s, _ in parts])
    return slip_in_data(concatenate([s for s, _ in parts]),
                        np.concatenate([q for _, q in parts]), owner)


def understeer_note(recordings: Sequence[Recording], reference: Reference | None, car: Vehicle
                    ) -> str:
    """The combination in words, or which drive would tell it."""
    found = understeer(recordings, reference, car)
    if found is None:
        return ("on-board sensors tell at most the understeer gradient, and that from one steering "
                "command held at two speeds that differ by 0.2 m/s and more: drive that")
    value, std = found
    scale = car.body.wheelbase**2 / car.body.mass
    return (f"on-board sensors tell one combination: understeer gradient {value:+.4f} +- "
            f"{std:.4f} s2/m2, so l_r/C_f - l_f/C_r = {value * scale:+.6f} +- {std * scale:.6f} "
            "m rad/N; neither stiffness by itself, and nothing of D")
