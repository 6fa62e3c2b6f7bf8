"""The page of ``dart-hal demo``, and its summary picture."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from dart_hal.calibration.result import SteeringResult
from dart_hal.control.paths import Path as Track
from dart_hal.core.figures import (
    BLUE,
    INK,
    LEGEND_ABOVE,
    ORANGE,
    band,
    finish,
    new_figure,
)
from dart_hal.core.types import INTERVAL_90, FloatArray, State
from dart_lab.report import page
from dart_lab.report.html import Html, el, join, table
from dart_lab.report.page import image


@dataclass
class EightDrive:
    """Drive of a figure of eight: States, and the truth at their times, (n, 4): x, y, yaw, v."""

    track: Track
    states: list[State] = field(default_factory=list)
    offsets: list[float] = field(default_factory=list)
    true: FloatArray = field(default_factory=lambda: np.empty((0, 4)))

    @property
    def poses(self) -> FloatArray:
        """Odometry at each State, shape (n, 2) [m]."""
        return np.array([(s.pose.x, s.pose.y) for s in self.states])

    @property
    def errors(self) -> FloatArray:
        """Distance of odometry from the truth at each State [m]."""
        return np.asarray(np.hypot(*(self.poses - self.true[:, :2]).T))

    @property
    def distance(self) -> float:
        """True distance driven [m]."""
        return float(np.hypot(*np.diff(self.true[:, :2], axis=0).T).sum())


@dataclass(frozen=True)
class DemoResults:
    """Results of the first chapters; hello: of the firmware, known: the hidden truth."""

    url: str
    hello: dict[str, Any]
    result: SteeringResult
    known: dict[str, Any]
    drive: EightDrive
    numbers: dict[str, float]
    notices: tuple[str, ...]


def write_page(path: Path, results: DemoResults, chapters: page.Sections) -> None:
    """Write the page; chapters: the following ones. Errors: OSError, UsageError."""
    lead = el("p", "The firmware ran in an emulated ATmega328P, its serial bytes were decoded by "
              "the HAL, commands went through ServoKit into a register model of the PCA9685, and "
              "a simulated car (", el("code", results.url), ") moved. Only the table and the "
              "pictures below know what was hidden in it.")
    drawn = []
    for title, draw in _drawings(results).items():
        figure = new_figure((7.0, 4.4))
        draw(figure.add_subplot())
        drawn.append(page.figure(title, image(figure, title)))
    first = join([page.notices(results.notices), _facts(results), *drawn, page.small_print(SIGMA)])
    page.write(path, page.page("demo", "A car in a box", lead, {
        "box": ("Calibrate, then drive a figure of eight", first), **chapters}))


def write_summary(path: Path, results: DemoResults) -> None:
    """Write the three pictures of the page side by side, as a PNG."""
    figure = new_figure((14.0, 3.9))
    panels = figure.subplots(1, 3, width_ratios=(1.0, 1.35, 1.0))
    for axes, draw in zip(panels, _drawings(results).values(), strict=True):
        draw(axes)
    figure.savefig(path, metadata={"Software": None})


def _facts(results: DemoResults) -> Html:
    drive = results.drive
    hello = results.hello
    numbers = results.numbers
    last = drive.states[-1]
    nano = "MockNano" if hello["mock"] else "emulated ATmega328P"
    return table(("", ""), [
        ("firmware", f"{hello['firmware']} ({nano}), schema {hello['schema']}"),
        ("frames decoded", f"{len(drive.states)}, {last.health.lost} lost"),
        ("steering map", f"{numbers['steering_rms_deg']:.2f} deg rms against ground truth"),
        ("backlash", _backlash(results.result, results.known)),
        ("driven", f"{numbers['distance_m']:.1f} m at {np.mean(drive.true[:, 3]):.2f} m/s"),
        ("odometry at the end", f"{100 * numbers['odometry_error_m']:.1f} cm off, stated one sigma "
                                f"{100 * _sigma(last):.1f} cm"),
        ("path offset", f"{100 * np.sqrt(np.mean(np.square(drive.offsets))):.1f} cm rms")])


def _backlash(result: SteeringResult, known: dict[str, Any]) -> str:
    true = math.degrees(known["sensors"]["steering.backlash"])
    if result.backlash is None:
        return f"not detected (true {true:.2f} deg)"
    measured = math.degrees(result.backlash.value), math.degrees(result.backlash.std)
    return f"{measured[0]:.2f} +- {measured[1]:.2f} deg (true {true:.2f} deg)"


def _sigma(state: State) -> float:
    """Standard deviation of the position along its least certain direction [m]."""
    # Largest eigenvalue of the covariance of x and y.
    return float(np.sqrt(np.linalg.eigvalsh(state.pose.cov[:2, :2])[-1]))


def _drawings(results: DemoResults) -> dict[str, Callable[[Any], None]]:
    return {
        "What the calibration found, and what is true":
            lambda axes: _map(axes, results.result, results.known["steering"]),
        "The figure of eight": lambda axes: _eight(axes, results.drive),
        "How far odometry is off": lambda axes: _error(axes, results.drive),
    }


def _map(axes: Any, result: SteeringResult, known: dict[str, Any]) -> None:
    grid = np.array(known["command"])
    true = np.degrees(known["angle_rad"])
    angle = np.degrees(result.angle)
    reach = INTERVAL_90 * np.degrees(result.angle_std)
    axes.plot(grid, true, color=ORANGE, lw=4, alpha=0.5, label="hidden truth")
    band(axes, result.command, angle, reach, label="stated 90 % interval")
    axes.plot(result.command, angle, "o-", color=BLUE, ms=4, lw=1, label="measured")
    finish(axes, "steering command", "road-wheel angle [deg], left positive", frameon=False)
    # The curve hides errors of a few tenths of a degree; the inset shows them alone.
    inset = axes.inset_axes((0.58, 0.13, 0.41, 0.32))
    band(inset, result.command, np.zeros_like(reach), reach)
    inset.plot(result.command, angle - np.interp(result.command, grid, true), "o-", color=BLUE,
               ms=3, lw=1)
    inset.axhline(0.0, color=ORANGE, lw=2, alpha=0.5)
    inset.set_title("error [deg]", fontsize="small")
    inset.tick_params(labelsize="small")


def _eight(axes: Any, drive: EightDrive) -> None:
    axes.plot(drive.track.y, drive.track.x, color=INK, lw=1, ls=":", label="path")
    axes.plot(drive.true[:, 1], drive.true[:, 0], color=ORANGE, lw=3, alpha=0.5, label="truth")
    axes.plot(drive.poses[:, 1], drive.poses[:, 0], color=BLUE, lw=1, label="odometry")
    axes.set_aspect("equal")
    axes.invert_xaxis()  # seen from above with x up, left is left
    finish(axes, "y [m], left", "x [m], forward", ncols=3, **LEGEND_ABOVE)


def _error(axes: Any, drive: EightDrive) -> None:
    t = np.array([s.t for s in drive.states])
    axes.plot(t - t[0], 100 * drive.errors, color=BLUE, label="distance from the truth")
    axes.plot(t - t[0], [200 * _sigma(s) for s in drive.states], color=INK, ls="--", lw=1,
              label="two sigma, as stated in every State")
    axes.set_ylim(0, None)
    finish(axes, "time [s]", "[cm]", **LEGEND_ABOVE)


SIGMA = ("The stated sigma is that of a car with unmeasured wheel travel per edge and gyro scale: "
         "it must hold for every seed, and is often larger than the error of this one.")
