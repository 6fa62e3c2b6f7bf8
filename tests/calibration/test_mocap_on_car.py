"""`calibrate mocap` on emulated cars: hidden markers are found, wrong sources are named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from esc_pin import FRAMES, Watched, without_stop

from dart_hal.calibration.measured import write
from dart_hal.calibration.mocap import calibrate_mocap
from dart_hal.car import Car
from dart_hal.car.runs import read_run
from dart_hal.core.errors import CalibrationFailed
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.mocap import hidden_mocap
from dart_lab.sim.truth import truth

URL = "sim://?seed=4&nano=mock"


class AlteredSource:
    """A source whose poses are changed."""

    name, on_board = "an altered source", False

    def __init__(self, source, change) -> None:
        self._source, self._change = source, change
        self.close = source.close

    def poll(self, now):
        return [self._change(p) for p in self._source.poll(now)]


def measured(url: str, change=None, cars=None):
    backend = open_backend(url)
    if change is not None:
        backend.poses = AlteredSource(backend.poses, change)
    with Car.over(backend, cars=cars) as car:
        return calibrate_mocap(car), car.files


@pytest.mark.slow
@pytest.mark.parametrize("seed", [4, 61])
@pytest.mark.long_except("61")
def test_a_hidden_marker_is_found_and_used(seed, tmp_path):
    url = f"sim://?seed={seed}&nano=mock&mocap=1"
    found, files = measured(url, cars=tmp_path)
    true = hidden_mocap(seed)
    for name, value in (("marker_x", true.lx), ("marker_y", true.ly), ("marker_yaw", true.theta),
                        ("latency", true.latency)):
        got = found.quantities[f"mocap.{name}"]
        assert abs(got.value - value) < 4.0 * got.std
        assert got.std < (3e-3 if name == "latency" else 1e-3)
    assert np.median(found.graph.x) == pytest.approx(1e3 * true.lx, abs=1.0)
    assert np.median(found.graph.y) == pytest.approx(1e3 * true.ly, abs=1.0)
    write(files, found)
    with Car.open(url, cars=tmp_path, record=tmp_path / "run.mcap") as car:
        car.arm()
        for _ in car.states(duration=3.0):
            car.drive(throttle=0.25)  # straight on, which does not determine the marker
    run = read_run(tmp_path / "run.mcap")
    assert run.marker.source == "calibrate mocap"
    assert run.marker.lx == pytest.approx(true.lx, abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [11, 8801])
@pytest.mark.long
def test_the_latency_is_unbiased_on_the_real_firmware(seed):
    """The gyro is read after the acceleration: not counted, that was 2.4 ms on every car."""
    found, _ = measured(f"sim://?seed={seed}&mocap=1")
    assert abs(found.quantities["mocap.latency"].value - hidden_mocap(seed).latency) < 0.8e-3


@pytest.mark.slow
@pytest.mark.parametrize(("change", "words", "remedy"), [
    (lambda p: replace(p, x=1e3 * p.x, y=1e3 * p.y), "poses are in mm", "units=mm"),
    (lambda p: replace(p, y=-p.y, yaw=-p.yaw), "left-handed", "hand=left"),
    (lambda p: replace(p, x=1.0, y=2.0, yaw=0.3), "do not move while the car drives", "settings"),
])
@pytest.mark.long_except("*-left-handed-*")
def test_a_wrong_source_is_named_and_nothing_comes_of_it(change, words, remedy):
    with pytest.raises(CalibrationFailed, match=words) as refused:
        measured(f"{URL}&mocap=1", change)
    assert remedy in str(refused.value.remedy)


@pytest.mark.slow
def test_without_a_source_the_car_does_not_move():
    backend = open_backend(URL)
    with Car.over(backend) as car:
        with pytest.raises(CalibrationFailed, match="no external poses"):
            calibrate_mocap(car)
        assert truth(backend).distance == pytest.approx(0.0, abs=1e-9)


@pytest.mark.slow
def test_ctrl_c_is_neutral_at_the_pin_within_two_frames(tmp_path):
    watched = Watched(f"{URL}&mocap=1", tmp_path)
    when = watched.press(lambda state: state.speed > 0.3, calibrate_mocap)
    assert watched.pulled_after(when) < FRAMES
    assert watched.car.mode == "DISARMED"
    assert not list(tmp_path.rglob("calibration.toml"))
    watched.car.close()


@pytest.mark.slow
def test_control_without_the_stop_the_pin_pulls_on(tmp_path, monkeypatch):
    without_stop(monkeypatch)
    watched = Watched(f"{URL}&mocap=1", tmp_path)
    when = watched.press(lambda state: state.speed > 0.3, calibrate_mocap)
    assert watched.pulled_after(when) > 0.15
    watched.car.close()
