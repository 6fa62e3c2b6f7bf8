"""A camera's images as the image feature of LeRobot: JPEG in Parquet, and their statistics."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dart_hal.car.table import RunTable, missing
from dart_hal.core.errors import UsageError
from dart_hal.core.types import Image

NAME = "observation.images.camera"
SAMPLED = 300
"""Images by which the statistics are made, evenly taken: LeRobot takes a sample, too. Some 4 ms
each at 640 x 480, and the mean of a drive changes little from one image to the next."""
QUANTILES = (0.01, 0.1, 0.5, 0.9, 0.99)


def images_of(tables: Sequence[RunTable]) -> list[list[Image]]:
    """Of each run, none at all where no run has a camera.

    Errors: UsageError for runs with and without images, or of several sizes, in one data set.
    """
    images = [list(table.run.images()) for table in tables]
    sizes = {size for table, of_run in zip(tables, images, strict=True)
             for size in sizes_of(table, of_run)}
    without = [table for table, of_run in zip(tables, images, strict=True) if not of_run]
    if without and sizes:
        raise UsageError("runs with and without a camera make no data set",
                         found=f"{without[0].run.path} has no image, others have",
                         expected="images in all runs, or in none",
                         remedy="two exports: one of the runs with images, one of the others")
    if len(sizes) > 1:
        raise UsageError("images of several sizes make no data set", expected="one size",
                         found=", ".join(f"{w} x {h}" for w, h in sorted(sizes)),
                         remedy="an export for each size")
    return images


def sizes_of(table: RunTable, images: Sequence[Image]) -> set[tuple[int, int]]:
    """Widths and heights [px]. Errors: UsageError for one that is no JPEG."""
    try:
        return {image.size for image in images}
    except ValueError as error:
        raise UsageError(f"{table.run.path}: an image is damaged", found=str(error),
                         expected="JPEG") from error


def newest(images: Sequence[Image], grid: NDArray[Any]) -> NDArray[Any]:
    """Indices (n,) of the newest image that had arrived at each time of ``grid`` (n,) [s];
    -1 before the first."""
    row: NDArray[Any] = np.searchsorted([image.arrival for image in images], grid + 1e-9,
                                        side="right") - 1
    return row


def column(images: Sequence[Image], rows: NDArray[Any]) -> NDArray[Any]:
    """JPEG (n,) by index (n,): an array of bytes objects."""
    jpegs = np.empty(len(rows), dtype=object)
    jpegs[:] = [images[row].jpeg for row in rows]
    return jpegs


def statistics(jpegs: NDArray[Any]) -> dict[str, list[Any]]:
    """Of each colour, (3, 1, 1), in 0..1, over the pixels of ``SAMPLED`` images; count: images.

    Errors: UsageError without Pillow, or for an image that cannot be decoded.
    """
    try:
        from PIL import Image as Picture
    except ImportError as error:
        raise missing("Pillow", "a data set with images", "camera") from error
    chosen = np.unique(np.linspace(0, len(jpegs) - 1, SAMPLED).round().astype(int))
    counts = np.zeros((3, 256))
    for jpeg in jpegs[chosen]:
        try:
            with Picture.open(BytesIO(jpeg)) as picture:
                counts += np.reshape(picture.convert("RGB").histogram(), (3, 256))
        except (OSError, Picture.DecompressionBombError) as error:
            raise UsageError("an image cannot be decoded", found=str(error), expected="JPEG",
                             remedy="dart-hal export ros2 keeps it as it is") from error
    return of_histogram(counts) | {"count": [len(chosen)]}


def of_histogram(counts: NDArray[Any]) -> dict[str, list[Any]]:
    """Of pixels (3, 256), how many of each colour have each of the values 0, 1/255, .. 1."""
    value, share = np.arange(256) / 255.0, counts / counts.sum(axis=1, keepdims=True)
    mean = share @ value
    there = [np.flatnonzero(row) / 255.0 for row in counts]
    told = {"min": [row[0] for row in there], "max": [row[-1] for row in there], "mean": mean,
            "std": np.sqrt(np.maximum(share @ value ** 2 - mean ** 2, 0.0))}
    below = np.cumsum(share, axis=1) - 1e-12
    told |= {f"q{round(100 * q):02d}": (below >= q).argmax(axis=1) / 255.0 for q in QUANTILES}
    return {name: np.reshape(values, (3, 1, 1)).tolist() for name, values in told.items()}


def feature(jpegs: NDArray[Any]) -> dict[str, Any]:
    """What ``info.json`` says of it."""
    width, height = Image(0.0, 0.0, jpegs[0]).size
    return {"dtype": "image", "shape": [height, width, 3],
            "names": ["height", "width", "channels"]}


def arrow(pa: Any, jpegs: NDArray[Any]) -> Any:
    """As the library ``datasets`` keeps an image: its bytes, and no path."""
    return pa.StructArray.from_arrays(
        [pa.array(list(jpegs), pa.binary()), pa.nulls(len(jpegs), pa.string())],
        names=["bytes", "path"])
