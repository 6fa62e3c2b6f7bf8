"""What encoder, gyro and steering alone tell of the tyres: one combination of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dart_hal.identify.submodels.report import Ledger
from dart_hal.identify.submodels.samples import Samples, concatenate
from dart_hal.identify.submodels.slip import slip_in_data
from dart_hal.identify.submodels.steady import steady_samples
from dart_hal.recording.dart import Recording, Reference
from dart_hal.types import FloatArray
from dart_hal.vehicle import Vehicle


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
