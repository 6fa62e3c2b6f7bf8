"""One figure of a throttle calibration: the pulses of this car, and how far the paper's are off.

Needs matplotlib (the extra ``plot``).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dart_hal.control.measured import vehicle_for
from dart_hal.control.speed import SpeedLaw
from dart_hal.core.config import CarFiles, DriveTable
from dart_hal.core.figures import BLUE, INK, ORANGE, finish, new_figure, save_figure
from dart_hal.core.types import NINETY, FloatArray

SLOWEST = 0.1
"""m/s from which the model's pulses are drawn."""


def plot_throttle(table: DriveTable, files: CarFiles, path: str | Path) -> Path:
    """Write the figure to ``path``; the suffix (.png, .svg, .pdf) picks the format.

    Errors: UsageError when matplotlib is missing or the suffix is unknown.
    """
    speed, pulse, reach = (np.array(table.speed), np.array(table.pulse_us),
                           NINETY * np.array(table.std_us))
    name = files.model.name if files.model else "the paper's car"
    figure = new_figure((7.2, 5.6), path)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=[2.2, 1.0])
    fine = np.linspace(SLOWEST, 1.1 * speed[-1], 200)
    top.plot(fine, model_pulses(files, fine), color=ORANGE, lw=1.6, dashes=(6, 4),
             label=f"model of {name}, with this neutral")
    top.plot(speed, pulse, "o-", color=BLUE, lw=1.6, ms=5, label="this car, measured")
    finish(top, "", "pulse [us]", f"Pulse that holds a speed: {files.config.name}")
    off = pulse - model_pulses(files, speed)
    bottom.axhline(0.0, color=INK, lw=1.0)
    bottom.errorbar(speed, off, reach, fmt="o-", color=BLUE, capsize=4, lw=1.6, ms=4)
    finish(bottom, "speed [m/s]", "measured - model [us]\n90 % interval", legend=False)
    return save_figure(figure, path)


def model_pulses(files: CarFiles, speeds: FloatArray) -> FloatArray:
    """What the feed-forward would be without the table [us]."""
    law, span = SpeedLaw(vehicle_for(files)), files.config.throttle.span_us
    return np.array([files.neutral_us + span * law.feed_forward(float(v)) for v in speeds])
