"""The page that ``dart-hal demo`` writes: one self-contained HTML file."""

from __future__ import annotations

import base64
import html
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from dart_hal.calibration.result import SteeringResult
from dart_hal.control.paths import Path as Track
from dart_hal.diagnose.report.style import CSS
from dart_hal.types import FloatArray, State

INK, BLUE, ORANGE = "#222222", "#0072b2", "#d55e00"
NINETY = 1.645

@dataclass
class Drive:
    """The figure of eight: States, and the truth at their times, shape (n, 4): x, y, yaw, v."""

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
        """Metres really driven."""
        return float(np.hypot(*np.diff(self.true[:, :2], axis=0).T).sum())



def write_page(path: Path, url: str, hello: dict[str, Any], result: SteeringResult,
               known: dict[str, Any], drive: Drive, numbers: dict[str, float],
               notices: tuple[str, ...], chapters: str = "") -> None:
    """Write the page; chapters: HTML at its end. Needs matplotlib."""
    last = drive.states[-1]
    rows = {
        "firmware": f"{hello['firmware']} ({'MockNano' if hello['mock'] else 'emulated ATmega328P'}"
                    f"), schema {hello['schema']}",
        "frames decoded": f"{len(drive.states)}, {last.health.lost} lost",
        "steering map": f"{numbers['steering_rms_deg']:.2f} deg rms beside the hidden truth",
        "backlash": _backlash(result, known),
        "driven": f"{numbers['distance_m']:.1f} m at {np.mean(drive.true[:, 3]):.2f} m/s",
        "odometry at the end": f"{100 * numbers['odometry_error_m']:.1f} cm off, stated one sigma "
                               f"{100 * _sigma(last):.1f} cm",
        "beside the path": f"{100 * np.sqrt(np.mean(np.square(drive.offsets))):.1f} cm rms",
    }
    body = "".join(f"<p class=notice>{html.escape(n)}</p>" for n in notices)
    body += "<table class=facts>" + "".join(f"<tr><th>{k}</th><td>{html.escape(v)}</td></tr>"
                                for k, v in rows.items()) + "</table>"
    for title, draw in _drawings(result, known, drive).items():
        body += f"<h2>{title}</h2><img alt='{title}' src='{_picture(draw)}'>"
    body += SIGMA + chapters
    path.write_text(PAGE.format(url=html.escape(url), css=CSS, body=body), encoding="utf-8")


def _backlash(result: SteeringResult, known: dict[str, Any]) -> str:
    true = math.degrees(known["sensors"]["steering.backlash"])
    if result.backlash is None:
        return f"not seen (true {true:.2f} deg)"
    found = math.degrees(result.backlash.value), math.degrees(result.backlash.std)
    return f"{found[0]:.2f} +- {found[1]:.2f} deg (true {true:.2f} deg)"


def _sigma(state: State) -> float:
    return float(np.sqrt(np.linalg.eigvalsh(state.pose.cov[:2, :2])[-1]))


def write_summary(path: Path, result: SteeringResult, known: dict[str, Any],
                  drive: Drive) -> None:
    """The three pictures of the page side by side, as a PNG."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14.0, 3.9), dpi=100, layout="constrained")
    panels = figure.subplots(1, 3, width_ratios=(1.0, 1.35, 1.0))
    for axes, draw in zip(panels, _drawings(result, known, drive).values(), strict=True):
        draw(axes)
        _tidy(axes)
    figure.savefig(path, metadata={"Software": None})


def _drawings(result: SteeringResult, known: dict[str, Any],
              drive: Drive) -> dict[str, Callable[[Any], None]]:
    return {
        "What the calibration found, and what is true": lambda a: _map(a, result, known),
        "The figure of eight": lambda a: _eight(a, drive),
        "How far odometry is off": lambda a: _error(a, drive),
    }


def _tidy(axes: Any) -> None:
    axes.grid(alpha=0.25)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _picture(draw: Callable[[Any], None]) -> str:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.4), dpi=140, layout="constrained")
    axes = figure.add_subplot()
    draw(axes)
    _tidy(axes)
    buffer = BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def _map(axes: Any, result: SteeringResult, known: dict[str, Any]) -> None:
    grid = np.array(known["steering"]["command"])
    true = np.degrees(known["steering"]["angle_rad"])
    angle, std = np.degrees(result.angle), np.degrees(result.angle_std)
    axes.plot(grid, true, color=ORANGE, lw=4, alpha=0.5, label="hidden truth")
    axes.fill_between(result.command, angle - NINETY * std, angle + NINETY * std, color=BLUE,
                      alpha=0.25, lw=0, label="stated 90 % interval")
    axes.plot(result.command, angle, "o-", color=BLUE, ms=4, lw=1, label="measured")
    axes.set(xlabel="steering command", ylabel="road-wheel angle [deg], left positive")
    axes.legend(frameon=False)
    inset = axes.inset_axes((0.58, 0.13, 0.41, 0.32))
    inset.fill_between(result.command, -NINETY * std, NINETY * std, color=BLUE, alpha=0.25, lw=0)
    inset.plot(result.command, angle - np.interp(result.command, grid, true), "o-", color=BLUE,
               ms=3, lw=1)
    inset.axhline(0.0, color=ORANGE, lw=2, alpha=0.5)
    inset.set_title("error [deg]", fontsize="small")
    inset.tick_params(labelsize="small")


def _eight(axes: Any, drive: Drive) -> None:
    track = drive.track
    axes.plot(track.y, track.x, color=INK, lw=1, ls=":", label="path")
    axes.plot(drive.true[:, 1], drive.true[:, 0], color=ORANGE, lw=3, alpha=0.5, label="truth")
    axes.plot(drive.poses[:, 1], drive.poses[:, 0], color=BLUE, lw=1, label="odometry")
    axes.set(xlabel="y [m], left", ylabel="x [m], forward", aspect="equal")
    axes.invert_xaxis()  # seen from above with x up, left is left
    axes.legend(frameon=False, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))


def _error(axes: Any, drive: Drive) -> None:
    t = np.array([s.t for s in drive.states])
    axes.plot(t - t[0], 100 * drive.errors, color=BLUE, label="distance from the truth")
    axes.plot(t - t[0], [200 * _sigma(s) for s in drive.states], color=INK, ls="--", lw=1,
              label="two sigma, as stated in every State")
    axes.set(xlabel="time [s]", ylabel="[cm]", ylim=(0, None))
    axes.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0))


SIGMA = """<p>The stated sigma is that of a car whose wheel travel per edge and gyro scale nobody
has measured: it must hold for every seed, and is often larger than the error of this one.</p>"""

PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>DART-HAL demo</title>
<style>{css}
body {{ max-width: 46rem }}
img {{ max-width: 100%; height: auto; background: #fff }}
.s {{ white-space: normal }} .facts {{ width: 100%; font-size: 1rem }}
.facts th {{ border-bottom-color: var(--rule) }}
</style></head><body>
<h1>A car in a box</h1>
<p>The firmware ran in an emulated ATmega328P, its serial bytes were decoded by the HAL, commands
went through ServoKit into a register model of the PCA9685, and a simulated car
(<code>{url}</code>) moved. Only the table and the pictures below know what was hidden in it.</p>
{body}
</body></html>
"""
