"""Understeer gradient K from one steering command at several speeds.

Encoder, gyro and steering measure one combination of the tyre parameters:

    atan(l omega / v) = delta - kappa v^2 sin(2 delta) / 2

A car at constant throttle is slower in tighter turns, so speed and command are correlated, and an
error of the map's shape would look like slip. Hence only differences between stretches of the
same command count. Without any, the prior of 1:10 cars (0 +- 0.06 s2/m2) remains.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dart_hal.calibration.loop import UNDERSTEER_STD
from dart_hal.calibration.samples import LEVEL_WIDTH, Samples, concatenate
from dart_hal.core.types import FloatArray, IntArray
from dart_hal.recording.dart import Recording, Reference
from dart_hal.vehicle import Vehicle
from dart_hal.vehicle.scale import Scale, find_scale
from dart_lab.identification.submodels.report import Ledger
from dart_lab.identification.submodels.steady import steady_samples

# Samples of one stretch: 2 s.
STRETCH_SAMPLES = 20
# Samples of the shortest stretch that counts.
MIN_MEAN_SAMPLES = 5
# [m/s] of a car of 1:10. Least difference between the speeds of one command; less is counting
# noise.
MIN_SPEED_RANGE = 0.2
# [rad] Least error of a stretch's mean angle (backlash, floor).
MIN_ANGLE_STD = 0.01


def estimate_slip_with_prior(samples: Samples, square: FloatArray, owner: IntArray, scale: Scale
                             ) -> tuple[float, float]:
    """Estimate (kappa, std) [s2/m2] from data and prior; arguments as ``estimate_slip``."""
    found = estimate_slip(samples, square, owner, scale)
    prior_std = UNDERSTEER_STD * scale.factor("s2/m2")
    if found is None:
        return 0.0, prior_std
    value, std = found
    precision = 1.0 / prior_std**2 + 1.0 / std**2
    return value / std**2 / precision, float(precision**-0.5)


def estimate_slip(samples: Samples, square: FloatArray, owner: IntArray, scale: Scale
                  ) -> tuple[float, float] | None:
    """Estimate (kappa, std) [s2/m2]; None if no command was driven at two speeds.

    square (n,): v^2; owner (n,): recording of each sample. scale: of the car.
    """
    # 1. Means over stretches, so that the counting noise of v does not enter both sides.
    index = _label_stretches(samples.block)
    count = np.bincount(index).astype(np.float64)

    def mean(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(index, values) / count)

    angle = mean(samples.angle)
    level = np.round(mean(samples.command) / LEVEL_WIDTH)
    effect = -0.5 * mean(square) * np.sin(2.0 * angle)
    group = np.unique(np.stack([mean(owner.astype(np.float64)), level], axis=1), axis=0,
                      return_inverse=True)[1].reshape(-1)
    # 2. Group by command level and recording; use groups whose speeds span MIN_SPEED_RANGE.
    speed = np.sqrt(mean(square))
    top = np.zeros(group.max() + 1)
    low = np.full(group.max() + 1, np.inf)
    np.maximum.at(top, group, np.where(count >= MIN_MEAN_SAMPLES, speed, 0.0))
    np.minimum.at(low, group, np.where(count >= MIN_MEAN_SAMPLES, speed, np.inf))
    least = MIN_SPEED_RANGE * scale.speed
    weight = ((count >= MIN_MEAN_SAMPLES) & (top - low > least)[group]).astype(np.float64)
    # 3. Regress the angle on -v^2 sin(2 delta) / 2, both centred within their group.
    total = np.maximum(np.bincount(group, weight), 1e-12)
    x = effect - (np.bincount(group, weight * effect) / total)[group]
    y = angle - (np.bincount(group, weight * angle) / total)[group]
    information = float(weight @ x**2)
    if information <= 0.0:
        return None
    value = float(weight @ (x * y)) / information
    # 4. Error over groups, at least that of MIN_ANGLE_STD.
    score = np.bincount(group, weight * x * (y - value * x))
    variance = max(float(score @ score) / information**2, MIN_ANGLE_STD**2 / information)
    return value, float(np.sqrt(variance))


def _label_stretches(block: IntArray) -> IntArray:
    """Label the stretches (n,) of 2 s of each block: the speed may drift at one command."""
    _, first, label = np.unique(block, return_index=True, return_inverse=True)
    place = (np.arange(len(block)) - first[label]) // STRETCH_SAMPLES
    return np.asarray(np.unique(label * len(block) + place, return_inverse=True)[1])


def estimate_understeer(recordings: Sequence[Recording], reference: Reference | None, car: Vehicle
                        ) -> tuple[float, float] | None:
    """Estimate (K, std) [s2/m2] of omega = v tan(delta) / (l (1 + K v^2)).

    K = m / l^2 (l_r / C_f - l_f / C_r): one equation for two stiffnesses. None if no command was
    driven at two speeds.
    """
    parts: list[tuple[Samples, FloatArray]] = []
    for recording in recordings:
        found = steady_samples(recording, car.body.wheelbase, reference, Ledger())
        if found is not None:
            parts.append(found)
    if not parts:
        return None
    owner = np.repeat(np.arange(len(parts)), [len(s) for s, _ in parts])
    return estimate_slip(concatenate([s for s, _ in parts]),
                         np.concatenate([q for _, q in parts]), owner, find_scale(car.body))


def describe_understeer(recordings: Sequence[Recording], reference: Reference | None, car: Vehicle
                        ) -> str:
    """Describe the combination, or the drive that would identify it."""
    found = estimate_understeer(recordings, reference, car)
    if found is None:
        return ("on-board sensors identify at most the understeer gradient, and that from one "
                "steering command held at two speeds that differ by "
                f"{MIN_SPEED_RANGE * find_scale(car.body).speed:.2g} m/s and more: drive that")
    value, std = found
    scale = car.body.wheelbase**2 / car.body.mass
    return (f"on-board sensors identify one combination: understeer gradient {value:+.4f} +- "
            f"{std:.4f} s2/m2, so l_r/C_f - l_f/C_r = {value * scale:+.6f} +- {std * scale:.6f} "
            "m rad/N; neither stiffness by itself, and nothing of D")
