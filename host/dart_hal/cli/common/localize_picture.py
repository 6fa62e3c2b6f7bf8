"""The picture of ``dart-hal localize``: the map, the path that was told, the true one."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dart_hal.core.figures import BLUE, GREY, INK, ORANGE, finish, new_figure, save_figure
from dart_hal.core.types import FloatArray
from dart_hal.estimation.localisation.field import Map
from dart_hal.estimation.localisation.localiser import Located


def draw(chart: Map, told: list[Located], truth: FloatArray | None, file: Path) -> Path:
    """Write the picture. Raises UsageError without matplotlib or for another suffix."""
    figure = new_figure((10.0, 5.0), file)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.2, 1.0))
    floor, above = figure.add_subplot(grid[:, 0]), figure.add_subplot(grid[0, 1])
    below = figure.add_subplot(grid[1, 1], sharex=above)
    for x1, y1, x2, y2 in chart.lines:
        floor.plot((x1, x2), (y1, y2), color=INK, lw=1.2)
    if truth is not None:
        floor.plot(truth[:, 0], truth[:, 1], color=ORANGE, lw=2.5, label="true")
    placed = [k for k, seen in enumerate(told) if seen.pose is not None]
    at = np.array([(p.x, p.y) for k in placed if (p := told[k].pose)]).reshape(-1, 2)
    floor.plot(*at.T, color=BLUE, lw=1.0, label="localised")
    floor.set_aspect("equal", adjustable="datalim")
    finish(floor, "x [m]", "y [m]", loc="lower center")
    if truth is not None:
        off = at - truth[placed, :2]
        above.plot([told[k].t for k in placed], 100.0 * np.hypot(*off.T), color=BLUE, lw=1.0)
    finish(above, "", "off [cm]", legend=False)
    below.plot([seen.t for seen in told], [100.0 * seen.agreement for seen in told], color=GREY)
    below.set_ylim(0.0, 105.0)
    finish(below, "t [s]", "explained by the map [%]", legend=False)
    return save_figure(figure, file)
