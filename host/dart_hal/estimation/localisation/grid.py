"""Grid maps of ROS's map_server, a YAML file and an image, as the outlines of what is occupied."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from itertools import pairwise
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dart_hal.core.errors import UsageError
from dart_hal.core.process.extras import install_command
from dart_hal.core.text_file import read_text
from dart_hal.core.types import MAX_COORDINATE, BoolArray, FloatArray, IntArray

_PGM = re.compile(rb"P5\s(?:\s*#[^\n]*\n)*\s*(\d+)\s(?:\s*#[^\n]*\n)*\s*(\d+)\s"
                  rb"(?:\s*#[^\n]*\n)*\s*(\d+)\s")

# Shade of unobserved cells, between the thresholds of map_server.
UNKNOWN_SHADE = 205


# m: allowed cells of a map.
CELL_RANGE = (1e-4, 100.0)
# Cells of a map, 250 m by 250 m at 5 cm: an image of some kB may expand to gigabytes.
MAX_CELLS = 25e6
# Characters, and lists with tables, of the YAML file of a map: deep ones take the parser seconds.
MAX_YAML = 1 << 16
MAX_BRACKETS = 100
# Modes of an image. Both define occupied and free cells by two thresholds.
MODES = ("trinary", "scale")
# Thickness of walls that ``dart-hal map`` draws, in cells.
MAX_DRAWN_CELLS = 2.0


@dataclass(frozen=True, slots=True)
class Grid:
    """Occupancy grid. occupied, free (rows, columns), row 0 at the bottom; cell [m];

    origin (2,) [m] of the lower left corner.
    """

    occupied: BoolArray
    free: BoolArray
    cell: float
    origin: FloatArray

    def is_free(self, x: float, y: float) -> bool:
        """Whether the cell at x, y [m] is known to be free."""
        column, row = ((np.array((x, y)) - self.origin) / self.cell).astype(int)
        rows, columns = self.free.shape
        return bool(0 <= row < rows and 0 <= column < columns and self.free[row, column])


def read_grid(path: Path) -> Grid:
    """Read a map of map_server. Raises UsageError naming the file."""
    try:
        table = read_map_table(path)
        shades = read_image(path.parent / str(table["image"]))
        x, y, yaw = (float(v) for v in table["origin"])
        cell = float(table["resolution"])
        high = float(table.get("occupied_thresh", 0.65))
        low = float(table.get("free_thresh", 0.196))
        negate = int(table.get("negate", 0))
    except UsageError:
        raise
    except (OSError, KeyError, TypeError, ValueError, OverflowError, MemoryError) as why:
        raise UsageError(f"{path} is no map of map_server", found=repr(why)[:200], read=str(path),
                         expected="image, resolution, origin; the image a binary PGM (P5) or PNG"
                         ) from why
    if yaw or not CELL_RANGE[0] <= cell <= CELL_RANGE[1]:
        raise UsageError(f"{path}: the map cannot be used", read=str(path),
                         found=f"origin turned by {yaw:g} rad, cells of {cell:g} m",
                         expected="a map that is not turned, resolution from "
                                  f"{CELL_RANGE[0]:g} to {CELL_RANGE[1]:g} m")
    if not max(abs(x), abs(y)) <= MAX_COORDINATE:
        raise UsageError(f"{path}: the map cannot be used", read=str(path),
                         found=f"origin: [{x:g}, {y:g}, {yaw:g}]",
                         expected=f"an origin within {MAX_COORDINATE:g} m")
    if not 0.0 <= low <= high <= 1.0:
        raise UsageError(f"{path}: the map cannot be used", read=str(path),
                         found=f"free_thresh {low:g}, occupied_thresh {high:g}",
                         expected="0 <= free_thresh <= occupied_thresh <= 1")
    share = shades / 255.0 if negate else 1.0 - shades / 255.0
    return Grid(share[::-1] > high, share[::-1] < low, cell, np.array((x, y)))


def read_map_table(path: Path) -> dict[str, Any]:
    """Read the keys of a map's YAML file. Raises OSError, ValueError, UsageError without PyYAML."""
    try:
        import yaml
    except ImportError as error:
        raise UsageError(f"{path.name}: a map needs PyYAML", read=str(path),
                         expected="the Python package yaml",
                         remedy=install_command("map")) from error
    text = read_text(path)
    if len(text) > MAX_YAML or text.count("[") + text.count("{") > MAX_BRACKETS:
        raise ValueError(f"a file of {len(text)} characters and {text.count('[')} lists, where ten "
                         "lines are expected")
    try:
        table = yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError) as why:
        raise ValueError(f"no YAML: {why}") from why
    if not isinstance(table, dict):
        raise ValueError("no keys")
    if (mode := table.get("mode", "trinary")) not in MODES:
        found = mode if isinstance(mode, str) else type(mode).__name__
        raise ValueError(f"mode: {found[:80]}, expected {' or '.join(MODES)}")
    return table


def write_grid(grid: Grid, path: Path) -> Path:
    """Write the YAML file ``path`` and a PGM with the same stem; return the path of the PGM.

    ``read_grid`` and map_server read them.
    """
    image = path.with_suffix(".pgm")
    shades = np.full(grid.occupied.shape, UNKNOWN_SHADE, np.uint8)
    shades[grid.free] = 254
    shades[grid.occupied] = 0
    rows = len(shades)
    columns = len(shades[0])
    path.parent.mkdir(parents=True, exist_ok=True)
    image.write_bytes(b"P5\n%d %d\n255\n" % (columns, rows) + shades[::-1].tobytes())
    x, y = grid.origin.tolist()
    # JSON is YAML, and a name may have characters that mean something there.
    name = json.dumps(image.name, ensure_ascii=False)
    path.write_text(f"image: {name}\nresolution: {grid.cell:g}\n"
                    f"origin: [{x:.6f}, {y:.6f}, 0.0]\nnegate: 0\noccupied_thresh: 0.65\n"
                    "free_thresh: 0.196\n", encoding="utf-8")
    return image


def read_image(path: Path) -> NDArray[np.uint8]:
    """Read the shades (rows, columns) of an image; colours are averaged, as map_server does.

    A binary PGM needs nothing else, PNG and others need Pillow.
    Raises UsageError without Pillow, OSError, ValueError.
    """
    if path.exists() and not path.is_file():
        raise ValueError(f"{path.name} is no file")  # a device may have no end
    with path.open("rb") as file:
        if file.read(2) == b"P5":
            return read_pgm(path)
    try:
        from PIL import Image, UnidentifiedImageError
    except ImportError as error:
        raise UsageError(f"{path.name}: this image needs Pillow", read=str(path),
                         expected="a binary PGM (P5), or Pillow to read it",
                         remedy=install_command("camera")) from error
    try:
        with Image.open(path) as picture:
            if picture.width * picture.height > MAX_CELLS:
                raise ValueError(f"{path.name} has {picture.width} x {picture.height} cells, at "
                                 f"most {MAX_CELLS:.0f} can be used")
            if picture.mode.startswith("I"):  # 16 bits
                shades = np.asarray(picture, dtype=np.float64) / 257.0
            else:
                shades = np.asarray(picture.convert("RGB")).mean(axis=2)
    except (UnidentifiedImageError, Image.DecompressionBombError, SyntaxError) as error:
        raise ValueError(f"{path.name} is no image: {error}") from error
    rounded: NDArray[np.uint8] = shades.round().astype(np.uint8)
    return rounded


def read_pgm(path: Path) -> NDArray[np.uint8]:
    """Read the shades (rows, columns) of a binary PGM. Raises OSError, ValueError."""
    raw = path.read_bytes()
    head = _PGM.match(raw)
    if head is None or int(head[3]) > 255:
        raise ValueError(f"{path.name} is no binary PGM of 8 bits")
    columns = int(head[1])
    rows = int(head[2])
    shades = np.frombuffer(raw, np.uint8, offset=head.end(), count=rows * columns)
    return shades.reshape(rows, columns)


def lines_of_grid(grid: Grid) -> FloatArray:
    """Outlines (m, 4) [m] of the occupied cells; adjacent edges in a row are one line."""
    level = _horizontal_edges(grid.occupied)
    upright = _horizontal_edges(grid.occupied.T)
    cells = np.vstack((level, upright[:, [1, 0, 3, 2]]))
    scaled: FloatArray = cells * grid.cell + np.tile(grid.origin, 2)
    return scaled


def middle_lines_of_grid(grid: Grid) -> FloatArray:
    """Lines (m, 4) [m] through the middles of the occupied cells that are neighbours.

    A cell is occupied where a wall passes anywhere through it: on average the wall is at its
    middle, and it has no sides. An occupied cell without neighbours in its row or column is a line
    of no length.
    """
    level, in_level_run = _horizontal_runs(grid.occupied)
    upright, in_upright_run = _horizontal_runs(grid.occupied.T)
    cells = np.vstack((level, upright[:, [1, 0, 3, 2]], _diagonal_steps(grid.occupied),
                       _single_cells(grid.occupied & ~in_level_run & ~in_upright_run.T)))
    scaled: FloatArray = (cells + 0.5) * grid.cell + np.tile(grid.origin, 2)
    return scaled


def _horizontal_runs(occupied: BoolArray) -> tuple[FloatArray, BoolArray]:
    """Runs x1, y, x2, y in cells of two or more occupied cells of a row, and the cells in them."""
    change = np.diff(np.pad(occupied, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    row, first = np.nonzero(change > 0)
    last = np.nonzero(change < 0)[1] - 1
    padded = np.pad(occupied, ((0, 0), (1, 1)))
    in_run = occupied & (padded[:, :-2] | padded[:, 2:])
    runs = np.column_stack((first, row, last, row)).astype(np.float64)
    return runs[last > first], in_run


def _diagonal_steps(occupied: BoolArray) -> FloatArray:
    """Lines x1, y1, x2, y2 between occupied cells that touch at a corner alone."""
    steps = []
    for side in (1, -1):
        cells = occupied[:, ::side]
        corner = cells[:-1, :-1] & cells[1:, 1:] & ~cells[:-1, 1:] & ~cells[1:, :-1]
        row, column = np.nonzero(corner)
        ends = np.column_stack((column, column + 1))
        x1, x2 = (ends if side == 1 else cells.shape[1] - 1 - ends).T
        steps.append(np.column_stack((x1, row, x2, row + 1)))
    return np.vstack(steps).astype(np.float64)


def compute_wall_std(grid: Grid) -> float:
    """Return the standard error [m] of a pose, in x or y, by the places of walls in their cells.

    1. A wall along a row of cells is anywhere in it: its standard error is the cell / sqrt(12).
    2. Two such walls hold the car in x or y: sqrt(2) less.
    3. A wall at an angle to the rows crosses each of them, and its errors add up to none: only the
       share of the runs that do not continue one row up at one end and one row down at the other
       counts, by the square of their lengths, in rows and in columns.
    4. A wall of many cells, as other programs draw it, is anywhere in its thickness.
    """
    shares = []
    for occupied in (grid.occupied, grid.occupied.T):
        # Runs of occupied cells: their row, first and last column.
        cells = np.pad(occupied, ((1, 1), (2, 2)))
        change = np.diff(cells.astype(np.int8), axis=1)
        row, first = np.nonzero(change > 0)
        first += 1
        last = np.nonzero(change < 0)[1]

        def continues(rows: IntArray, end: IntArray, outward: int,
                      cells: BoolArray = cells) -> BoolArray:
            found: BoolArray = cells[rows, end] | cells[rows, end + outward]
            return found

        # Runs that leave their row upwards at one end and downwards at the other.
        left_up = continues(row + 1, first, -1)
        left_down = continues(row - 1, first, -1)
        right_up = continues(row + 1, last, 1)
        right_down = continues(row - 1, last, 1)
        crosses = ((left_up & right_down & ~left_down & ~right_up)
                   | (left_down & right_up & ~left_up & ~right_down))
        size = np.where(last > first, (last - first + 1.0)**2, 0.0)
        shares.append(size[~crosses].sum() / max(size.sum(), 1.0))
    thicker = max(_find_thickness(grid.occupied) - MAX_DRAWN_CELLS, 0.0)
    return float(grid.cell / sqrt(24.0) * sqrt(max(shares) + thicker**2))


def _find_thickness(occupied: BoolArray) -> float:
    """Return the thickness of walls in cells: the median at their surfaces, at least 1."""
    along_rows = _find_run_lengths(occupied)
    along_columns = _find_run_lengths(occupied.T).T
    padded = np.pad(occupied, 1)
    enclosed = padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    found = np.minimum(along_rows, along_columns)[occupied & ~enclosed]
    return float(np.median(found)) if len(found) else 1.0


def _find_run_lengths(occupied: BoolArray) -> FloatArray:
    """Return at each occupied cell the number of cells of its run in the row, else 0."""
    change = np.diff(np.pad(occupied, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    row, first = np.nonzero(change > 0)
    last = np.nonzero(change < 0)[1]
    lengths = np.zeros((len(occupied), len(occupied[0]) + 1))
    lengths[row, first] = last - first
    lengths[row, last] -= last - first
    return np.cumsum(lengths, axis=1)[:, :-1]


def _single_cells(occupied: BoolArray) -> FloatArray:
    """Lines x1, y1, x2, y2 of no length at occupied cells."""
    row, column = np.nonzero(occupied)
    return np.column_stack((column, row, column, row)).astype(np.float64)


def _horizontal_edges(occupied: BoolArray) -> FloatArray:
    """Horizontal edges x1, y, x2, y in cells: borders of occupied and other cells."""
    padded = np.pad(occupied, ((1, 1), (0, 0))).astype(np.int8)
    edge = np.pad(np.diff(padded, axis=0), ((0, 0), (1, 1)))
    change = np.diff(edge, axis=1) != 0
    found = []
    for y in np.flatnonzero(change.any(axis=1)):
        at = np.flatnonzero(change[y])
        found += [(a, y, b, y) for a, b in pairwise(at) if edge[y, a + 1]]
    return np.array(found, dtype=np.float64).reshape(-1, 4)
