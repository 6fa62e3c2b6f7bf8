"""The picture of the demo in the README: a car drives, then a diagnosis names what changed.

    dart-hal demo --out demo --json > demo.json
    python docs/demo_animation.py demo demo.json docs/pictures/demo.gif

The drive is the recorded figure of eight, replayed; the bars are what the diagnosis measured.
"""

from __future__ import annotations

import argparse
import io
import json
from math import cos, sin
from pathlib import Path
from typing import Any

import matplotlib
from PIL import Image

matplotlib.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.patches import Polygon

from dart_hal import Car, State

EVERY = 25  # frames of the firmware, 10 ms each, from picture to picture
STEP_MS, STEPS_OF_ANSWER, LAST_MS = 60, 8, 4000
SIZE, DPI = (8.0, 3.2), 100
CAR = ((-0.06, -0.09), (0.24, -0.09), (0.24, 0.09), (-0.06, 0.09))  # m, from the rear axle
WHEEL = ((-0.035, -0.015), (0.035, -0.015), (0.035, 0.015), (-0.035, 0.015))
AXLES = ((0.0, 0.1), (0.0, -0.1), (0.175, 0.1), (0.175, -0.1))
INK, PATH, BEFORE, AFTER = "#22313f", "#2a78b8", "#c0504d", "#2e8b57"


def main() -> None:
    """Read what the demo left, draw, write a GIF."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("demo", type=Path, help="folder that `dart-hal demo` wrote")
    parser.add_argument("answer", type=Path, help="what it printed with --json")
    parser.add_argument("out", type=Path, help="the GIF")
    given = parser.parse_args()
    answer = json.loads(given.answer.read_text(encoding="utf-8"))["summary"]
    with Car.open(f"replay://{given.demo / 'eight.mcap'}") as car:
        states = [s for i, s in enumerate(car.states()) if i % EVERY == 0]
    pictures = [drawn(states[:i + 1], answer, 0.0) for i in range(len(states))]
    pictures += [drawn(states, answer, (i + 1) / STEPS_OF_ANSWER) for i in range(STEPS_OF_ANSWER)]
    palette = pictures[-1].quantize(64)
    frames = [p.quantize(64, palette=palette, dither=Image.Dither.NONE) for p in pictures]
    frames[0].save(given.out, save_all=True, append_images=frames[1:], loop=0, optimize=True,
                   duration=[STEP_MS] * (len(frames) - 1) + [LAST_MS])


def drawn(states: list[State], answer: dict[str, Any], share: float) -> Image.Image:
    """One picture: the path so far, and ``share`` of the answer (0: it still drives)."""
    figure, (left, right) = plt.subplots(1, 2, figsize=SIZE, dpi=DPI,
                                         gridspec_kw={"width_ratios": (1.9, 1.0)})
    drive(left, states)
    diagnosis(right, answer, share)
    figure.tight_layout()
    data = io.BytesIO()
    figure.savefig(data, format="png")
    plt.close(figure)
    return Image.open(data).convert("RGB")


def drive(axes: Any, states: list[State]) -> None:
    """Path and car by the car's own odometry; forward at the start is up."""
    last = states[-1]
    axes.plot(*zip(*(seen(s.pose.x, s.pose.y) for s in states), strict=True), color=PATH, lw=1.5)
    x, y, yaw = last.pose.x, last.pose.y, last.pose.yaw
    axes.add_patch(Polygon(placed(CAR, x, y, yaw), closed=True, fc="#d9e4ec", ec=INK, zorder=3))
    for at, side in AXLES:
        wheel = yaw + (last.applied.steering if at else 0.0)
        wx, wy = x + cos(yaw) * at - sin(yaw) * side, y + sin(yaw) * at + cos(yaw) * side
        axes.add_patch(Polygon(placed(WHEEL, wx, wy, wheel), closed=True, fc=INK, zorder=4))
    axes.plot((-0.5, 0.5), (-1.2, -1.2), color=INK, lw=2)
    axes.text(0.0, -1.17, "1 m", ha="center", va="bottom", fontsize=9, color=INK)
    axes.set(xlim=(-2.0, 2.0), ylim=(-1.3, 1.15), aspect="equal")
    axes.axis("off")
    axes.set_title(f"real firmware, simulated car: {last.speed:.1f} m/s", fontsize=10, color=INK)


def seen(x: float, y: float) -> tuple[float, float]:
    """Right and up in the picture, of a point with x forward and y to the left."""
    return -y, x


def placed(points: Any, x: float, y: float, yaw: float) -> list[tuple[float, float]]:
    """Points of the car in the picture."""
    return [seen(x + cos(yaw) * a - sin(yaw) * b, y + sin(yaw) * a + cos(yaw) * b)
            for a, b in points]


def diagnosis(axes: Any, answer: dict[str, Any], share: float) -> None:
    """What was hidden, what was named, and the error that it takes away."""
    axes.axis("off")
    axes.set(xlim=(0, 1), ylim=(0, 1))
    if not share:
        axes.text(0.0, 0.96, "calibrated, it drives by itself", fontsize=11, color=INK, va="top")
        return
    axes.text(0.0, 0.96, "then something in the car changes", fontsize=11, color=INK, va="top")
    told = answer["diagnosis"]
    hidden = {one["effect"]: sizes(one) for one in told["hidden"]}
    for cause, top in zip(told["causes"][:2], (0.86, 0.42), strict=False):
        removed(axes, cause, hidden.get(cause["effect"], "nothing"), top, share)


def removed(axes: Any, cause: dict[str, Any], hidden: str, top: float, share: float) -> None:
    """A cause, its size beside the true one, and the error with it and without."""
    gain, sensor = cause["gain"]["test"], cause["gain"]["channel"]
    axes.text(0.0, top, cause["effect"], fontsize=13, color=AFTER, weight="bold", va="top")
    axes.text(0.0, top - 0.08, f"found   {sizes(cause)}\nhidden  {hidden}", fontsize=9, color=INK,
              va="top", family="monospace")
    axes.barh(top - 0.25, 1.0, 0.05, color=BEFORE)
    axes.barh(top - 0.32, 1.0 - gain * share, 0.05, color=AFTER)
    axes.text(0.98, top - 0.25, f"{sensor} error before", fontsize=8, color="white", va="center",
              ha="right")
    if share == 1.0:
        axes.text(1.0 - gain + 0.02, top - 0.32, f"{100 * gain:.0f} % less", fontsize=8, color=INK,
                  va="center")


def sizes(entry: dict[str, Any]) -> str:
    """Parameters of an effect with their units."""
    return ", ".join(f"{v['value']:.3g} {v['unit']}" for v in entry["parameters"].values())


if __name__ == "__main__":
    main()
