"""`calibrate lidar` on emulated cars: what is hidden is found and used, what is wrong is named."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from esc_pin import FRAMES, Watched, without_stop

from dart_hal.calibration.lidar import calibrate_lidar, check_and_fit
from dart_hal.calibration.lidar_fit import LidarDrive, fit_lidar
from dart_hal.calibration.measured import write
from dart_hal.calibration.order import make_steps
from dart_hal.car import Car
from dart_hal.car.lidar import mount_of
from dart_hal.cli.main import main
from dart_hal.core.config import Quantity, load_car, parse_calibration
from dart_hal.core.errors import CalibrationFailed, ConfigError
from dart_hal.devices.links.base import open_backend
from dart_hal.estimation.localisation.field import map_of_lines
from dart_lab.sim.lidar.maps import room_of
from dart_lab.sim.truth import truth
from studies.calibration.hidden_errors import room_map

URL = "sim://?seed=4&nano=mock&lidar=scale=1.015&map=room"
WAIVED = ("--waive", "CALIBRATION_MISSING", "--waive", "PWM_CLOCK_UNCALIBRATED", "--json")


@pytest.fixture(scope="module")
def drive_log():
    """States and scans of the drive, by listening to it."""
    class Listening:
        def __init__(self, car):
            self.car, self.drive = car, LidarDrive([], [])

        def __getattr__(self, name):
            return getattr(self.car, name)

        def states(self, **limits):
            for state in self.car.states(**limits):
                self.drive.states.append(state)
                yield state

        @property
        def lidar(self):
            return self

        def scans(self):
            some = self.car.lidar.scans()
            self.drive.scans.extend(some)
            return some

    with Car.open(URL) as car:
        listening = Listening(car)
        calibrate_lidar(listening, chart=room_map(URL))
    return listening.drive


def test_without_a_lidar_the_car_does_not_move():
    backend = open_backend("sim://?seed=4&nano=mock")
    with Car.over(backend) as car:
        with pytest.raises(CalibrationFailed, match="no scans") as refused:
            calibrate_lidar(car, chart=room_map(URL))
        assert "--lidar" in refused.value.remedy
        assert truth(backend).distance == pytest.approx(0.0, abs=1e-9)


def test_what_is_measured_counts_before_car_toml():
    files = load_car("dart-01", ["cars"])
    cal = parse_calibration('schema = "dart-hal/calibration/1"\ncar = "dart-01"\n', "none")
    cal = cal.with_quantities({"lidar.mount_yaw": Quantity(0.02, 1e-4),
                               "lidar.scale": Quantity(1.01, 1e-4)})
    given, measured = mount_of(files), mount_of(replace(files, calibration=cal))
    assert (measured.yaw, measured.scale) == (0.02, 1.01)
    assert (measured.x, measured.y, measured.inverted) == (given.x, given.y, given.inverted)


def test_a_scale_that_cannot_be_is_refused():
    with pytest.raises(ConfigError, match=r"lidar\.scale"):
        parse_calibration('schema = "dart-hal/calibration/1"\ncar = "dart-01"\n[lidar]\n'
                          "scale = { value = 1015.0, std = 1.0 }\n", "mine")


@pytest.mark.slow
def test_it_is_part_of_all_only_with_a_map():
    files = load_car("dart-01", ["cars"])
    assert "lidar" not in [s.verb for s in make_steps(files)]
    assert make_steps(files, chart=room_map(URL))[-1].verb == "lidar"


@pytest.mark.slow
def test_distances_off_by_a_percent_and_a_half_are_corrected_end_to_end(tmp_path, capsys):
    """Poses of the localiser before and after; what is hidden is near what was found."""
    def localised():
        with pytest.raises(SystemExit) as done:
            main(["localize", "--url", URL, "--cars", str(tmp_path), "--duration", "10",
                  "--speed", "1", "--steering", "0.3", *WAIVED])
        assert done.value.code == 0
        return json.loads(capsys.readouterr().out)["error"]

    before = localised()
    backend = open_backend(URL)
    with Car.over(backend, cars=tmp_path) as car:
        found = calibrate_lidar(car, chart=room_map(URL))
        write(car.files, found)
    hidden = backend_lidar(URL)
    for name, true in hidden.items():
        got = found.quantities[f"lidar.{name}"]
        assert abs(got.value - true) < 4.0 * got.std
    assert found.quantities["lidar.mount_yaw"].std < np.radians(0.05)
    # With the mount measured, the offset that is left is none.
    assert np.hypot(np.median(found.graph.x), np.median(found.graph.y)) < 0.5  # mm
    after = localised()
    assert after["max_m"] <= 0.01
    assert after["yaw_rms_rad"] < np.radians(0.2)        # while delay and slip are learnt
    assert before["yaw_rms_rad"] > 5.0 * np.radians(0.2), "control: five times the limit without it"


def backend_lidar(url):
    from dart_hal.core.url import Url
    from dart_lab.sim.truth import reveal_url
    unit = reveal_url(Url.parse(url))["lidar"]
    return {"mount_x": unit["x"], "mount_y": unit["y"], "mount_yaw": unit["yaw"],
            "scale": unit["scale"]}


@pytest.mark.slow
def test_what_is_wrong_with_the_mount_is_named(drive_log):
    chart = room_map(URL)

    def refused(**wrong):
        mount = replace(drive_log.scans[0].mount, **wrong)
        scans = [s.mounted(mount) for s in drive_log.scans]
        with pytest.raises(CalibrationFailed) as why:
            check_and_fit(LidarDrive(drive_log.states, scans), chart)
        return f"{why.value} {why.value.remedy}"

    assert "turn against the gyro" in (why := refused(inverted=False))
    assert "inverted = true" in why
    assert "points in another direction" in (why := refused(yaw=np.pi / 2.0))
    assert float(why.split()[-1]) == pytest.approx(backend_lidar(URL)["mount_yaw"], abs=0.09)
    assert "is not mounted as in car.toml: yaw" in refused(yaw=0.3)
    assert "is not mounted as in car.toml: scale" in refused(scale=1.08)
    found = fit_lidar(drive_log, chart)                       # the control: nothing is wrong
    assert found.found["yaw"].value == pytest.approx(backend_lidar(URL)["mount_yaw"], abs=1e-3)


def read_with_gyro(drive, scale):
    """The drive, its heading and places by a gyro whose scale is ``scale`` times as large."""
    car = np.array([(s.pose.x, s.pose.y, s.pose.yaw) for s in drive.states])
    yaw = car[0, 2] + scale * (car[:, 2] - car[0, 2])
    step = np.hypot(*np.diff(car[:, :2], axis=0).T) * np.exp(0.5j * (yaw[1:] + yaw[:-1]))
    place = car[0, 0] + 1j * car[0, 1] + np.concatenate([[0.0], np.cumsum(step)])
    states = [replace(s, pose=replace(s.pose, x=float(p.real), y=float(p.imag), yaw=float(w)))
              for s, p, w in zip(drive.states, place, yaw, strict=True)]
    return LidarDrive(states, drive.scans)


@pytest.mark.slow
def test_the_yaw_follows_the_gyro_scale_within_its_standard_error(drive_log):
    chart = room_map(URL)
    any_gyro, calibrated = fit_lidar(drive_log, chart), fit_lidar(drive_log, chart, 3e-4)
    moved = fit_lidar(read_with_gyro(drive_log, 1.01), chart).found["yaw"].value
    shift = abs(moved - calibrated.found["yaw"].value)
    assert shift == pytest.approx(5e-4, rel=0.2)
    assert shift < 1.65 * any_gyro.found["yaw"].std
    assert shift > 1.65 * calibrated.found["yaw"].std, "control: no calibrated gyro does that"
    assert any_gyro.found["x"].std == calibrated.found["x"].std


@pytest.mark.long
def test_a_map_of_another_room_is_refused(drive_log):
    with pytest.raises(CalibrationFailed, match="not of this map"):
        check_and_fit(drive_log, map_of_lines(room_of("room", 999).lines))


@pytest.mark.slow
def test_a_unit_upside_down_is_named_and_nothing_is_written(tmp_path, capsys):
    with pytest.raises(SystemExit) as done:
        main(["calibrate", "lidar", "--url", "sim://?seed=4&nano=mock&lidar=clockwise=0&map=room",
              "--cars", str(tmp_path)])
    assert done.value.code != 0
    assert "turn against the gyro" in capsys.readouterr().err
    assert not list(tmp_path.rglob("calibration.toml"))


@pytest.mark.slow
def test_ctrl_c_is_neutral_at_the_pin_within_two_frames(tmp_path):
    watched = Watched(URL, tmp_path)
    when = watched.press(lambda state: state.speed > 0.3, calibrate_lidar, chart=room_map(URL))
    assert watched.pulled_after(when) < FRAMES
    assert watched.car.mode == "DISARMED"
    assert not list(tmp_path.rglob("calibration.toml"))
    watched.car.close()


@pytest.mark.slow
def test_control_without_the_stop_the_pin_pulls_on(tmp_path, monkeypatch):
    without_stop(monkeypatch)
    watched = Watched(URL, tmp_path)
    when = watched.press(lambda state: state.speed > 0.3, calibrate_lidar, chart=room_map(URL))
    assert watched.pulled_after(when) > 0.15
    watched.car.close()
