"""Picture of ``dart-hal map``: the grid, the path and the loop closures."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dart_hal.core.figures import BLUE, GREEN, INK, finish, new_figure, save_figure
from dart_hal.estimation.localisation.grid import Grid
from dart_hal.estimation.mapping.keyframes import Survey


def draw_map(survey: Survey, grid: Grid, file: Path) -> Path:
    """Draw a map and write the picture.

    Raises UsageError without matplotlib or for another suffix.
    """
    rows, columns = grid.occupied.shape
    figure = new_figure((8.0, 8.0 * min(max(rows / columns, 0.4), 1.4)), file)
    axes = figure.add_subplot()
    # Light grey: not observed; white: free.
    shades = np.full((rows, columns), 0.85)
    shades[grid.free] = 1.0
    x, y = grid.origin
    axes.imshow(shades, origin="lower", cmap="gray", vmin=0.0, vmax=1.0, interpolation="none",
                extent=(x, x + columns * grid.cell, y, y + rows * grid.cell))
    row, column = np.nonzero(grid.occupied)
    axes.plot(x + (column + 0.5) * grid.cell, y + (row + 0.5) * grid.cell, "s", color=INK, ms=1.0,
              label="walls")
    path = survey.path()
    axes.plot(path[:, 1], path[:, 2], color=BLUE, lw=1.2, label="path")
    for k, edge in enumerate(survey.closures):
        ends = survey.poses[[edge.a, edge.b]]
        axes.plot(ends[:, 0], ends[:, 1], "o-", color=GREEN, lw=0.8, ms=2.0, alpha=0.6,
                  label=None if k else f"{len(survey.closures)} loop closures")
    axes.plot(*survey.poses[0, :2], "o", color=BLUE, ms=6, label="start")
    axes.set_aspect("equal")
    finish(axes, "x [m]", "y [m]")
    return save_figure(figure, file)
