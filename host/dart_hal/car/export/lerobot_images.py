"""Images of a camera as the image feature of LeRobot: JPEG in Parquet, and their statistics."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dart_hal.car.table import RunTable, missing_package_error
from dart_hal.core.errors import UsageError
from dart_hal.core.types import Image

IMAGE_FEATURE = "observation.images.camera"
# Images of the statistics, evenly spaced: LeRobot uses a sample too. About 4 ms each at 640 x 480,
# and the mean changes little from one image to the next.
MAX_STATISTICS_IMAGES = 300
QUANTILES = (0.01, 0.1, 0.5, 0.9, 0.99)


def images_of(tables: Sequence[RunTable]) -> list[list[Image]]:
    """Return the images of each run, none at all if no run has a camera.

    Raises UsageError for runs with and without images, or of several sizes, in one data set.
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
    """Return the widths and heights [px]. Raises UsageError for an image that is not JPEG."""
    try:
        return {image.size for image in images}
    except ValueError as error:
        raise UsageError(f"{table.run.path}: an image is damaged", found=str(error),
                         expected="JPEG") from error


def newest(images: Sequence[Image], grid: NDArray[Any]) -> NDArray[Any]:
    """Return the index (n,) of the newest image at each time of ``grid`` (n,) [s].

    -1 before the first image.
    """
    row: NDArray[Any] = np.searchsorted([image.arrival for image in images], grid + 1e-9,
                                        side="right") - 1
    return row


def column(images: Sequence[Image], rows: NDArray[Any]) -> NDArray[Any]:
    """Return the JPEGs (n,) of images by index (n,): an array of bytes objects."""
    jpegs = np.empty(len(rows), dtype=object)
    jpegs[:] = [images[row].jpeg for row in rows]
    return jpegs


def statistics(jpegs: NDArray[Any]) -> dict[str, list[Any]]:
    """Return statistics of each colour, (3, 1, 1), in 0..1, over a sample of the images.

    count: images of the sample. Raises UsageError without Pillow, or for an image that cannot be
    decoded.
    """
    try:
        from PIL import Image as Picture
    except ImportError as error:
        raise missing_package_error("Pillow", "a data set with images", "camera") from error
    chosen = np.unique(np.linspace(0, len(jpegs) - 1, MAX_STATISTICS_IMAGES).round().astype(int))
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
    """Return the statistics of pixels by their counts (3, 256): colour, value 0, 1/255, .. 1."""
    value = np.arange(256) / 255.0
    share = counts / counts.sum(axis=1, keepdims=True)
    mean = share @ value
    there = [np.flatnonzero(row) / 255.0 for row in counts]
    moments = {"min": [row[0] for row in there], "max": [row[-1] for row in there], "mean": mean,
               "std": np.sqrt(np.maximum(share @ value ** 2 - mean ** 2, 0.0))}
    below = np.cumsum(share, axis=1) - 1e-12
    moments |= {f"q{round(100 * q):02d}": (below >= q).argmax(axis=1) / 255.0 for q in QUANTILES}
    return {name: np.reshape(values, (3, 1, 1)).tolist() for name, values in moments.items()}


def feature(jpegs: NDArray[Any]) -> dict[str, Any]:
    """Return the feature's entry in ``info.json``."""
    width, height = Image(0.0, 0.0, jpegs[0]).size
    return {"dtype": "image", "shape": [height, width, 3],
            "names": ["height", "width", "channels"]}


def arrow(pa: Any, jpegs: NDArray[Any]) -> Any:
    """Return the column as the library ``datasets`` stores images: bytes without a path."""
    return pa.StructArray.from_arrays(
        [pa.array(list(jpegs), pa.binary()), pa.nulls(len(jpegs), pa.string())],
        names=["bytes", "path"])
