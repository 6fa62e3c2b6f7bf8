"""Figures of the calibrations of steering and throttle. They need matplotlib (the extra ``plot``).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dart_hal.control.measured import vehicle_for
from dart_hal.control.speed import SpeedLaw
from dart_hal.core.config import CarFiles, DriveTable
from dart_hal.core.figures import (
    BLUE,
    GREY,
    INK,
    ORANGE,
    band,
    finish,
    new_figure,
    save_figure,
)
from dart_hal.core.types import INTERVAL_90, FloatArray
from dart_hal.vehicle.parameters import Steering
from dart_hal.vehicle.sets import PAPER
from dart_hal.vehicle.steering import make_steering

from .measured import Measured
from .result import SteeringResult

RISING_COLOUR = BLUE
FALLING_COLOUR = ORANGE
FIRST_COLOUR = GREY
PAPER_LINE = "#56d364"
FORM_LINE = "#ff4fc3"
# rad; from recordings the form is the map itself.
SAME_MAP_TOLERANCE = 1e-9
# Points; more of them are drawn small and pale.
MAX_LARGE_MARKERS = 500
# m/s from which the pulses of the model are drawn.
MIN_PLOTTED_SPEED = 0.1


def plot_steering(result: SteeringResult, path: str | Path) -> Path:
    """Write the figure to ``path``; the suffix (.png, .svg, .pdf) picks the format.

    Raises UsageError if matplotlib is missing or the suffix is unknown.
    """
    figure = new_figure((7.2, 6.4), path)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=[2.2, 1.0])
    _draw_map(top, result)
    _draw_residuals(bottom, result)
    # Below the panels: inside, it would cover data.
    figure.legend(fontsize=8, loc="outside lower center", ncols=3, markerscale=1.5)
    return save_figure(figure, path)


def _draw_map(axes: Any, result: SteeringResult) -> None:
    _points(axes, result, np.zeros_like, labelled=True)
    angle = np.degrees(result.angle)
    reach = np.degrees(INTERVAL_90 * result.angle_std)
    axes.plot(result.command, angle, color=INK, lw=2.4, label="this car, middle of the backlash")
    band(axes, result.command, angle, reach, INK, "90 % interval")
    fine = np.linspace(result.command[0], result.command[-1], 201)
    axes.plot(fine, np.degrees(make_steering(PAPER.steering, np)(fine)), color=PAPER_LINE,
              lw=1.1, dashes=(6, 4), zorder=5, label="map of the paper's code")
    finish(axes, "", "road-wheel angle [deg], + = left", _title(result), legend=False)


def _draw_residuals(axes: Any, result: SteeringResult) -> None:
    _points(axes, result, lambda s: np.interp(s, result.command, result.angle))
    reach = np.degrees(INTERVAL_90 * result.angle_std)
    band(axes, result.command, np.zeros_like(reach), reach, INK)
    form = make_steering(Steering(**result.paper_form), np)(result.command)
    same = np.abs(form - result.angle).max() < SAME_MAP_TOLERANCE
    axes.axhline(0.0, color=INK, lw=2.0)
    axes.plot(result.command, np.degrees(form - result.angle), color=FORM_LINE, lw=1.3,
              dashes=(3, 3), zorder=5,
              label="five-parameter form" + (" (is the map)" if same else ""))
    finish(axes, "steering command, +1 = full left", "data - map [deg]", legend=False)


def _points(axes: Any, result: SteeringResult, baseline: Any,
            labelled: bool = False) -> None:
    if result.samples is None:
        return
    command, angle, direction = result.samples
    value = np.degrees(angle - baseline(command))
    small = len(command) > MAX_LARGE_MARKERS
    for side, marker, color, label in ((1.0, "^", RISING_COLOUR, "reached from the right"),
                                       (-1.0, "v", FALLING_COLOUR, "reached from the left"),
                                       (0.0, "o", FIRST_COLOUR, "first command of a run")):
        rows = direction == side
        if rows.any():
            axes.plot(_spread(command[rows], side, small), value[rows], marker, color=color,
                      ms=2.0 if small else 5.0, alpha=0.3 if small else 0.9, lw=0,
                      label=label if labelled else None)


def _spread(command: FloatArray, side: float, small: bool) -> FloatArray:
    """Move the two approaches of one level to the left and to the right."""
    return command + side * (0.004 if small else 0.0)


def _title(result: SteeringResult) -> str:
    backlash = ("backlash unknown" if result.backlash is None else
                f"backlash {np.degrees(result.backlash.value):.2f} "
                f"± {np.degrees(result.backlash.std):.2f} deg")
    return f"Steering of {result.car}: {result.n} samples, {backlash}"


def plot_throttle(result: Measured, files: CarFiles, path: str | Path) -> Path:
    """Write the figure to ``path``; the suffix (.png, .svg, .pdf) picks the format.

    Raises UsageError if matplotlib is missing or the suffix is unknown.
    """
    table = result.others["throttle.drive"]
    assert isinstance(table, DriveTable)
    speed = np.array(table.speed)
    pulse = np.array(table.pulse_us)
    reach = INTERVAL_90 * np.array(table.std_us)
    name = files.model.name if files.model else "the paper's car"
    figure = new_figure((7.2, 5.6), path)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=[2.2, 1.0])
    fine = np.linspace(MIN_PLOTTED_SPEED, 1.1 * speed[-1], 200)
    top.plot(fine, model_pulses(files, fine), color=ORANGE, lw=1.6, dashes=(6, 4),
             label=f"model of {name}, with this neutral")
    top.plot(speed, pulse, "o-", color=BLUE, lw=1.6, ms=5, label="this car, measured")
    finish(top, "", "pulse [us]", f"Pulse that keeps a speed: {files.config.name}")
    difference = pulse - model_pulses(files, speed)
    bottom.axhline(0.0, color=INK, lw=1.0)
    bottom.errorbar(speed, difference, reach, fmt="o-", color=BLUE, capsize=4, lw=1.6, ms=4)
    finish(bottom, "speed [m/s]", "measured - model [us]\n90 % interval", legend=False)
    return save_figure(figure, path)


def model_pulses(files: CarFiles, speeds: FloatArray) -> FloatArray:
    """Pulses [us] of the feed-forward without the measured table."""
    law = SpeedLaw(vehicle_for(files))
    span = files.config.throttle.span_us
    return np.array([files.neutral_us + span * law.feed_forward(float(v)) for v in speeds])
