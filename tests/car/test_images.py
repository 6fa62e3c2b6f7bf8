"""The emulated camera: images with the States, in the recording, and the same in a replay."""

from __future__ import annotations

import io
from itertools import pairwise

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from PIL import Image as PILImage

from dart_hal.car import Car
from dart_hal.core.errors import UsageError
from dart_hal.recording.run import RunReader
from dart_lab.sim.camera import IMAGE_LATENCY, IMAGE_PERIOD, IMAGE_SIZE
from tests.common import KINEMATIC_3_URL

TOPIC = "/camera/image/compressed"


def drive(url, seconds=3.0, **options):
    """(States, images) of a circle to the left."""
    states = []
    images = []
    with Car.open(url, **options) as car:
        car.arm()
        car.camera.images()
        for state in car.states(duration=seconds):
            states.append(state)
            images += car.camera.images()
            car.drive(steering=0.35, throttle=0.25)
        assert car.camera.trouble is None
    return states, images


def pixels(image):
    return np.asarray(PILImage.open(io.BytesIO(image.jpeg)).convert("RGB")).astype(int)


def find_red_body(image):
    """Where the car's body is: middle (x, y) [px]."""
    r, g, b = np.moveaxis(pixels(image), 2, 0)
    rows, columns = np.nonzero((r > 150) & (g < 80) & (b < 100))
    assert len(rows) > 20, "the car is in the image"
    return np.array((columns.mean(), rows.mean()))


@pytest.mark.slow
def test_it_sees_the_car_where_it_is_and_a_replay_has_the_same(tmp_path):
    path = tmp_path / "run.mcap"
    states, images = drive(f"{KINEMATIC_3_URL}&camera=top&map=hall", record=path)
    assert len(images) == pytest.approx(3.0 / IMAGE_PERIOD, abs=1)
    for a, b in pairwise(images):
        assert b.t - a.t == pytest.approx(IMAGE_PERIOD)
    for image in images:
        assert image.arrival - image.t == pytest.approx(IMAGE_LATENCY)
        assert image.size == IMAGE_SIZE
    walls = pixels(images[0])[:, :, 2] < 90
    assert walls.sum() > 500, "and its room"
    way = find_red_body(images[-1]) - find_red_body(images[0])
    poses = [next(s for s in states if s.t >= image.t).pose for image in (images[0], images[-1])]
    moved = np.hypot(poses[1].x - poses[0].x, poses[1].y - poses[0].y)
    scale = min(np.array(IMAGE_SIZE) / (6.5 + 0.6))  # the hall is 6.5 m square
    assert np.hypot(*way) / scale == pytest.approx(moved, abs=0.08)
    live = {state.seq: state.image for state in states if state.image}
    with Car.open(f"replay://{path}") as car:
        again = {state.seq: state.image for state in car.states() if state.image}
        assert car.camera.health.rate == pytest.approx(1.0 / IMAGE_PERIOD)
    assert all(again[seq] == image for seq, image in live.items())


@pytest.mark.slow
def test_the_same_run_has_the_same_images_and_another_car_others():
    first, again = (drive(KINEMATIC_3_URL, 0.4, camera="top")[1] for _ in range(2))
    assert first == again
    other = drive(KINEMATIC_3_URL.replace("seed=3", "seed=4"), 0.4, camera="top")[1]
    assert other[-1].jpeg != first[-1].jpeg


@pytest.mark.slow
def test_other_tools_read_them(tmp_path):
    path = tmp_path / "run.mcap"
    _, images = drive(KINEMATIC_3_URL, 0.4, camera="top", record=path)
    with path.open("rb") as file:
        messages = [d for s, c, m, d in make_reader(
            file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(topics=[TOPIC])
            if s.name == "sensor_msgs/msg/CompressedImage"]
    assert len(messages) >= len(images)
    assert {message.format for message in messages} == {"jpeg"}
    assert {message.header.frame_id for message in messages} == {"camera"}
    stamped = {round(m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec, 5): bytes(m.data)
               for m in messages}
    for image in images:
        assert stamped[round(image.t, 5)] == image.jpeg


@pytest.mark.slow
def test_other_cars_of_its_world_are_in_the_image():
    placed = f"{KINEMATIC_3_URL}&camera=top&world=filmed&at="
    with Car.open(f"{placed}0,0,0") as car, Car.open(f"{placed}0.8,0.5,1"):
        for state in car.states(duration=0.5):
            pass
        r, g, b = np.moveaxis(pixels(state.image), 2, 0)
        brown = (abs(r - 0x8A) < 30) & (abs(g - 0x6D) < 30) & (abs(b - 0x3B) < 30)
        assert brown.sum() > 20
    _, images = drive(f"{KINEMATIC_3_URL}&camera=top", 0.5)
    r, g, b = np.moveaxis(pixels(images[-1]), 2, 0)
    assert ((abs(r - 0x8A) < 30) & (abs(g - 0x6D) < 30) & (abs(b - 0x3B) < 30)).sum() == 0


@pytest.mark.slow
def test_a_recording_begun_midway_has_them_and_one_without_a_camera_has_no_channel(tmp_path):
    path = tmp_path / "run.mcap"
    with Car.open(KINEMATIC_3_URL, camera="top") as car:
        for _ in car.states(duration=0.3):
            pass
        car.recorder.start(path)
        for _ in car.states(duration=0.5):
            pass
        car.recorder.end()
        for _ in car.states(duration=0.3):
            pass
    assert len(list(RunReader(path).images())) == pytest.approx(0.5 / IMAGE_PERIOD, abs=1)
    with Car.open(KINEMATIC_3_URL, record=tmp_path / "without.mcap") as car:
        assert [state.image for state in car.states(duration=0.3)].count(None) > 20
    with (tmp_path / "without.mcap").open("rb") as file:
        assert TOPIC not in {c.topic for c in make_reader(file).get_summary().channels.values()}


@pytest.mark.slow
def test_without_reads_the_newest_is_kept():
    with Car.open(KINEMATIC_3_URL, camera="top") as car:
        for state in car.states(duration=2.5):
            pass
        came = car.camera.images()
        assert len(came) == 16
        assert came[-1] is state.image
        assert car.camera.images() == ()


def test_a_real_camera_does_not_wait_for_a_program_in_virtual_time(monkeypatch):
    with pytest.raises(UsageError, match="waits while its program") as refused:
        Car.open(KINEMATIC_3_URL, camera="usb:0")
    assert "pace=1" in refused.value.remedy
    monkeypatch.setenv("DART_HAL_CAMERA", "colour://red")
    with pytest.raises(UsageError):
        Car.open(KINEMATIC_3_URL)
    with pytest.raises(UsageError, match="is no camera"):
        Car.open(f"{KINEMATIC_3_URL}&pace=1")
    with Car.open(f"{KINEMATIC_3_URL}&camera=top") as car:  # which has one of its own
        assert car.has_camera


def test_without_pillow_it_names_what_to_install(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "PIL", None)
    with pytest.raises(UsageError, match="needs Pillow") as no:
        Car.open(KINEMATIC_3_URL, camera="top")
    assert "pillow>=" in no.value.remedy
    with pytest.raises(UsageError, match="camera='side'"):
        Car.open(f"{KINEMATIC_3_URL}&camera=side")
