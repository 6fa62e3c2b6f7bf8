"""A camera's images in a data set of LeRobot; (slow) as the library itself sees them."""

from __future__ import annotations

import json
import subprocess
import sys
from io import BytesIO

import numpy as np
import pyarrow.parquet as pq
import pytest
from PIL import Image as Picture

from dart_hal.car import Car
from dart_hal.car.export import lerobot_images as pictures
from dart_hal.car.export.lerobot import episode, write_lerobot
from dart_hal.car.table import read_table
from dart_hal.core.errors import UsageError
from dart_hal.core.types import Image

QUANTILES = ("q01", "q10", "q50", "q90", "q99")


def record_drive(path, camera="&camera=top", seconds=0.5):
    with Car.open(f"sim://?seed=1&nano=mock{camera}", record=path) as car:
        for n, _ in enumerate(car.states(duration=seconds)):
            car.drive(steering=0.001 * n)
    return read_table(path)


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    return record_drive(tmp_path_factory.mktemp("runs") / "seen.mcap")


@pytest.fixture(scope="module")
def data_set(table, tmp_path_factory):
    path = tmp_path_factory.mktemp("set") / "laps"
    return path, write_lerobot([table, table], path, fps=20)


def jpeg(colours, size=(32, 16)):
    """Equal columns of some colours."""
    pixels = np.repeat(np.array(colours, np.uint8)[None], size[1], axis=0)
    pixels = np.repeat(pixels, size[0] // len(colours), axis=1)
    held = BytesIO()
    Picture.fromarray(pixels).save(held, "JPEG", quality=95, subsampling=0)
    return held.getvalue()


@pytest.mark.slow
def test_it_is_the_image_feature_of_the_format(data_set):
    path, made = data_set
    info = json.loads((path / "meta" / "info.json").read_text())
    assert info["features"][pictures.IMAGE_FEATURE] == {
        "dtype": "image", "shape": [240, 320, 3], "names": ["height", "width", "channels"]}
    assert info["video_path"] is None
    data = pq.read_table(path / info["data_path"].format(chunk_index=0, file_index=0))
    assert set(data.column_names) == set(info["features"])
    kind = data.schema.field(pictures.IMAGE_FEATURE).type
    assert str(kind) == "struct<bytes: binary, path: string>"
    shown = data.column(pictures.IMAGE_FEATURE).to_pylist()
    assert len(shown) == made.frames
    for one in (shown[0], shown[-1]):
        with Picture.open(BytesIO(one["bytes"])) as picture:
            assert (picture.size, picture.mode, one["path"]) == ((320, 240), "RGB", None)
    rows = pq.read_table(path / "meta" / "episodes" / "chunk-000" / "file-000.parquet").to_pylist()
    stats = json.loads((path / "meta" / "stats.json").read_text())[pictures.IMAGE_FEATURE]
    assert set(stats) == {"min", "max", "mean", "std", "count", *QUANTILES}
    for name in set(stats) - {"count"}:
        of_episode = rows[1][f"stats/{pictures.IMAGE_FEATURE}/{name}"]
        assert np.shape(stats[name]) == np.shape(of_episode) == (3, 1, 1)
    assert 0.0 <= np.min(stats["min"]) < np.min(stats["mean"]) < np.max(stats["max"]) <= 1.0


def test_a_frame_has_the_newest_image_that_had_come(table):
    images = [Image(image.arrival, image.t, b"%d" % n)
              for n, image in enumerate(table.run.images())]
    columns, held = episode(table, 50, images)
    t_command = table.columns["t"][np.isfinite(table.columns["command_steering"])][0]
    begin = max(t_command, images[0].arrival)
    assert held == 0
    for k, shown in enumerate(columns[pictures.IMAGE_FEATURE]):
        come = [image for image in images if image.arrival <= begin + k / 50 + 1e-9]
        assert shown == come[-1].jpeg, k
    assert set(columns[pictures.IMAGE_FEATURE]) == {image.jpeg for image in images}


def test_frames_of_a_camera_that_fell_silent_are_counted(table):
    images = list(table.run.images())
    late = [Image(image.arrival - 0.7, image.t, image.jpeg) for image in images[:1]]
    assert episode(table, 50, late)[1] > 20, "0.7 s are older than 0.5 s"


def test_statistics_are_those_of_the_pixels():
    jpegs = np.empty(2, object)
    jpegs[:] = [jpeg([(250, 0, 80), (10, 0, 80)]), jpeg([(250, 250, 80), (10, 0, 80)])]
    got = pictures.statistics(jpegs)
    pixels = np.concatenate([np.asarray(Picture.open(BytesIO(one)).convert("RGB")).reshape(-1, 3)
                             for one in jpegs]) / 255.0
    assert got["count"] == [2]
    for name, expected in {"min": pixels.min(0), "max": pixels.max(0), "mean": pixels.mean(0),
                           "std": pixels.std(0),
                           "q90": np.quantile(pixels, 0.9, axis=0, method="inverted_cdf")}.items():
        np.testing.assert_allclose(np.ravel(got[name]), expected, atol=1e-6, err_msg=name)


def test_runs_with_and_without_a_camera_make_no_data_set(table, tmp_path):
    blind = record_drive(tmp_path / "blind.mcap", camera="", seconds=0.2)
    for tables in ([table, blind], [blind, table]):
        with pytest.raises(UsageError, match="with and without a camera") as caught:
            write_lerobot(tables, tmp_path / "set")
        assert "blind.mcap has no image" in caught.value.found
    assert not (tmp_path / "set").exists()
    write_lerobot([blind, blind], tmp_path / "set")
    info = json.loads((tmp_path / "set" / "meta" / "info.json").read_text())
    assert pictures.IMAGE_FEATURE not in info["features"]


@pytest.mark.parametrize(("images", "why"), [
    ([jpeg([(1, 2, 3)]), jpeg([(1, 2, 3)], (64, 16))], "several sizes"),
    ([b"no picture"], "is damaged")])
def test_images_of_several_sizes_or_none_are_refused(table, images, why):
    class Run:
        path = table.run.path

        def images(self):
            return iter([Image(0.0, 0.0, one) for one in images])

    with pytest.raises(UsageError, match=why):
        pictures.images_of([type(table)(Run(), table.hello, 0, table.columns)])


def test_one_that_ends_early_is_refused():
    cut = np.empty(1, object)
    cut[:] = [jpeg([(250, 0, 80), (10, 0, 80)])[:-40]]
    with pytest.raises(UsageError, match="cannot be decoded"):
        pictures.statistics(cut)


LOAD = """
import sys
from lerobot.datasets.lerobot_dataset import LeRobotDataset
data = LeRobotDataset("dart/laps", root=sys.argv[1])
image = data[len(data) - 1]["observation.images.camera"]
print(data.num_episodes, data.meta.camera_keys, tuple(image.shape), image.dtype,
      0.0 <= image.min() < image.max() <= 1.0,
      data.meta.stats["observation.images.camera"]["mean"].shape)
"""


@pytest.mark.long
def test_the_library_itself_shows_the_images(data_set):
    """Needs lerobot and torch, some 2 GB: pip install lerobot."""
    pytest.importorskip("lerobot")
    done = subprocess.run([sys.executable, "-c", LOAD, str(data_set[0])], capture_output=True,
                          text=True, check=True).stdout.split("\n")[-2]
    assert done == ("2 ['observation.images.camera'] (3, 240, 320) torch.float32 tensor(True) "
                    "(3, 1, 1)")
