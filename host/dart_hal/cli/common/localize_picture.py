"""Picture of ``dart-hal localize``: the map, the estimated path and the true one."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dart_hal.core.figures import BLUE, GREY, INK, ORANGE, finish, new_figure, save_figure
from dart_hal.core.types import FloatArray
from dart_hal.estimation.localisation.field import Map
from dart_hal.estimation.localisation.localiser import Located


def draw_localization(chart: Map, poses: list[Located], truth: FloatArray | None,
                      file: Path) -> Path:
    """Draw the localisation and write the picture.

    poses: one for each scan. truth (n, 3): the true pose at each scan, None if not known.
    Raises UsageError without matplotlib or for another suffix.
    """
    figure = new_figure((10.0, 5.0), file)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.2, 1.0))
    plan = figure.add_subplot(grid[:, 0])
    above = figure.add_subplot(grid[0, 1])
    below = figure.add_subplot(grid[1, 1], sharex=above)
    for x1, y1, x2, y2 in chart.lines:
        plan.plot((x1, x2), (y1, y2), color=INK, lw=1.2)
    if truth is not None:
        plan.plot(truth[:, 0], truth[:, 1], color=ORANGE, lw=2.5, label="true")
    # Scans without a pose are in no line, but in the share that the map explains.
    located = [k for k, pose in enumerate(poses) if pose.pose is not None]
    points = np.array([(p.x, p.y) for k in located if (p := poses[k].pose)]).reshape(-1, 2)
    plan.plot(*points.T, color=BLUE, lw=1.0, label="localised")
    plan.set_aspect("equal", adjustable="datalim")
    finish(plan, "x [m]", "y [m]", loc="lower center")
    if truth is not None:
        error = points - truth[located, :2]
        above.plot([poses[k].t for k in located], 100.0 * np.hypot(*error.T), color=BLUE, lw=1.0)
    finish(above, "", "error [cm]", legend=False)
    below.plot([pose.t for pose in poses], [100.0 * pose.agreement for pose in poses], color=GREY)
    below.set_ylim(0.0, 105.0)
    finish(below, "t [s]", "explained by the map [%]", legend=False)
    return save_figure(figure, file)
