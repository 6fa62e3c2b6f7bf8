"""Errors of real parts that the simulator's cars lack, drawn from the seed of a hidden car.

The calibrations state them in their standard errors. Drawn here, they are in the errors too:

- the host's crystal, by which a car's seconds are measured,
- the filter of the gyro, whose delay is taken for that of the data sheet,
- the rear tyre, whose force bends before it ends where the model's is a straight line.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from dart_hal.calibration.measured import QUANTITY_UNITS
from dart_hal.core.types import FloatArray
from dart_lab.sim import mock_imu

CRYSTAL = (50e-6, 50e-6, 25e-6)
"""Largest relative errors of a plain quartz: as it is sold, from 0 to 70 C, by five years of age.
Each is uniform, so one sigma of all is 43 ppm."""
FILTER = 0.1
"""One sigma of the filter's delay, relative: the data sheet states its bandwidth, not its form."""
GRIP = (0.7, 1.1)
"""Coefficients of friction of rubber on floors."""
REAR_LOAD = 7.5
"""N on the rear axle: 1.67 kg, of which 0.46 are carried behind."""
POWER_OF_TIME = {"Hz": -1, "rad/s": -1, "s": 1, "us": 1}
"""Of a unit; units without time, and us/s, have 0."""


def host_second(seed: int) -> float:
    """How many seconds a second of the host's crystal lasts. The simulator counts the host's."""
    rng = np.random.default_rng([seed, 610])
    return 1.0 + float(np.sum(rng.uniform(-1.0, 1.0, len(CRYSTAL)) * CRYSTAL))


def in_seconds(name: str, value: FloatArray, second: float) -> FloatArray:
    """Convert a true value of the simulator from the host's seconds, which last ``second`` s.

    A gyro of so many rad per second of the host senses fewer in a shorter second: its scale has
    the dimension of time, though no unit.
    """
    power = 1 if name == "imu.gyro_scale" else POWER_OF_TIME.get(QUANTITY_UNITS[name], 0)
    return value * second**power


@contextmanager
def filtered_gyro(seed: int) -> Iterator[None]:
    """Let simulated gyros have the filter of the car of a seed, not that of the data sheet."""
    hertz = mock_imu.GYRO_HZ
    delay = 1.0 + FILTER * float(np.random.default_rng([seed, 620]).normal())
    mock_imu.GYRO_HZ = hertz / delay
    try:
        yield
    finally:
        mock_imu.GYRO_HZ = hertz


def rear_bend(seed: int) -> float:
    """Parameter k [1/N] of the effect ``rear_saturation`` of a seed: the end of its rear tyre."""
    grip = np.random.default_rng([seed, 630]).uniform(*GRIP)
    return float(1.0 / (grip * REAR_LOAD))
