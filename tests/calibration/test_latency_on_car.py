"""`calibrate latency` through the whole Car, against the hidden truth of simulated cars."""

from __future__ import annotations

import numpy as np
import pytest
from esc_pin import FRAMES, Watched, without_stop
from fit_graphs import distance_from_fit

from dart_hal.calibration.latency import calibrate_latency
from dart_hal.calibration.latency_fit import GRID_STEP, mean_pulse
from dart_hal.calibration.latency_log import PwmGrid, Traffic, TrafficLog, assume_grid
from dart_hal.calibration.measured import Measured, write
from dart_hal.car import Car
from dart_hal.control.tuning import make_speed_response
from dart_hal.core.config import Quantity
from dart_hal.core.config.calibration import Calibration
from dart_hal.core.errors import CalibrationFailed
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.truth import world_of
from studies.calibration.hidden_errors import true_sensors

URL = "sim://?nano=mock&seed="
LATE = "&effect=throttle_delay:0.02,throttle_lag:0.06"


def measured(url, tmp_path, begin=lambda backend: None):
    backend = open_backend(url)
    begin(backend)
    with Car.over(backend, cars=tmp_path) as car:
        try:
            return car.files, calibrate_latency(car, backend.workshop)
        finally:
            assert car.mode != "RAW"
            assert not list(tmp_path.rglob("calibration.toml"))


@pytest.mark.slow
def test_what_is_measured_is_near_the_truth_and_tunes_the_speed_loop(tmp_path):
    url = f"{URL}5{LATE}"
    files, result = measured(url, tmp_path)
    true = true_sensors(url)
    for name, found in result.quantities.items():
        assert abs(found.value - true[name]) < 3.5 * found.std, name
    assert distance_from_fit(result.graph) < 0.03
    assert np.ptp(result.graph.fit_y) == pytest.approx(1.0, abs=0.1)
    assert not make_speed_response(files).is_lag_known
    write(files, result)
    with Car.open(url, cars=tmp_path) as car:
        answer = make_speed_response(car.files)
    assert answer.is_lag_known
    assert answer.lag == pytest.approx(0.06, abs=0.004)
    assert answer.delay == pytest.approx(0.02, abs=0.004)


@pytest.mark.slow
def test_the_age_of_the_gyro_is_known_although_the_clocks_are_in_step(tmp_path):
    """Gyro and Nano of car 18 differ by less than 0.01 %: 4 ms off without the looks."""
    url = f"{URL}18"
    _, result = measured(url, tmp_path)
    found = result.quantities["latency.pulse_to_yaw"]
    assert abs(found.value - true_sensors(url)["latency.pulse_to_yaw"]) < 2e-3
    assert not any("in step" in note for note in result.notes)


@pytest.mark.parametrize("looks", [True, False])
@pytest.mark.slow
def test_the_log_follows_the_clock_of_the_gyro_where_the_firmware_looks(
        tmp_path, monkeypatch, looks):
    if not looks:
        monkeypatch.setattr("dart_hal.estimation.frames.GYRO_LOOK", 0)
    with Car.open(f"{URL}5", cars=tmp_path) as car:
        log = TrafficLog(car)
        for _ in car.states(duration=3.0):
            pass
        assert (log.age_std is not None) == looks
        assert (np.ptp(log.take().column("age_std")) > 0.0) == looks


@pytest.mark.slow
def test_without_the_wire_the_wait_is_derived_and_reported(tmp_path):
    def cut(backend):
        world_of(backend)._capture_edges = list

    _, result = measured(f"{URL}3", tmp_path, cut)
    wait = result.quantities["latency.command_to_pulse"]
    assert wait.method.startswith("derived")
    assert any("D8 received no pulse" in note for note in result.notes)
    assert result.quantities["latency.pulse_to_wheel"].std > 0.005


@pytest.mark.slow
@pytest.mark.parametrize(("fail", "why"), [
    pytest.param(fail, why, id=fail) for fail, why in (
        ("enc:off@0", "encoder does not count"), ("enc:off@24", "encoder does not count"),
        ("wheel:stuck@0", "a wheel is blocked"), ("wheel:stuck@24", "a wheel is blocked"),
        ("esc:off@0", "motor does not answer"), ("esc:off@24", "motor does not answer"),
        ("esc:wrong@0", "drives the car backward"))])
def test_what_is_wrong_is_named_and_the_pin_is_at_neutral(tmp_path, fail, why):
    watched = Watched(f"{URL}2&fail={fail}", tmp_path)
    with watched.car, pytest.raises(CalibrationFailed, match=why):
        watched.run(calibrate_latency, watched.backend.workshop)
    assert watched.pulled_after(watched.world.t) < -0.4
    assert not list(tmp_path.rglob("calibration.toml"))


@pytest.mark.slow
@pytest.mark.parametrize(("table", "line"), [("steering", "direction = -1"),
                                             ("imu", "mount_roll = 3.1416")])
def test_wrong_wiring_is_noticed(tmp_path, table, line):
    def turn_round(backend):
        text = backend.car_toml
        text += "" if f"[{table}]" in text else f"\n[{table}]\n"
        backend.car_toml = text.replace(f"[{table}]", f"[{table}]\n{line}")

    with pytest.raises(CalibrationFailed, match=r"the right|the other way"):
        measured(f"{URL}2", tmp_path, turn_round)


@pytest.mark.slow
def test_an_encoder_that_dies_under_a_held_pulse_is_neutral_within_300_ms(tmp_path):
    """The steps of the throttle are held by no speed loop, which could see it."""
    watched = Watched(f"{URL}2&fail=enc:off@24", tmp_path)
    with watched.car, pytest.raises(CalibrationFailed):
        watched.run(calibrate_latency, _Absent())
    assert watched.pulled_after(24.0) <= 0.3


@pytest.mark.slow
def test_control_believed_the_dead_encoder_would_pull_on(tmp_path, monkeypatch):
    watched = Watched(f"{URL}2&fail=enc:off@24", tmp_path)
    watched.car._engine.telemetry.encoder.judge = lambda *_: None
    with watched.car, pytest.raises(CalibrationFailed):
        watched.run(calibrate_latency, _Absent())
    assert watched.pulled_after(24.0) > 1.0


class _Absent:
    """An operator who is absent: the procedure ends if it needs one."""

    def push(self) -> bool:
        raise CalibrationFailed("no operator")


@pytest.mark.slow
def test_ctrl_c_is_neutral_at_the_pin_within_two_frames(tmp_path):
    watched = Watched(f"{URL}2", tmp_path)
    when = watched.press(lambda state: state.speed > 0.6, calibrate_latency,
                         watched.backend.workshop)
    assert watched.pulled_after(when) < FRAMES
    assert watched.car.mode == "DISARMED"
    watched.car.close()


@pytest.mark.slow
def test_control_without_the_stop_the_pin_pulls_on(tmp_path, monkeypatch):
    without_stop(monkeypatch)
    watched = Watched(f"{URL}2", tmp_path)
    when = watched.press(lambda state: state.speed > 0.6, calibrate_latency,
                         watched.backend.workshop)
    assert watched.pulled_after(when) > 0.15
    watched.car.close()


def test_of_two_writes_within_a_frame_the_second_counts():
    grid = PwmGrid(0.0, 0.02, 0.0, 0.0, 0.0, measured=True)
    ends, widths = grid.pulses(np.array([0.001, 0.019, 0.021]), np.array([1500.0, 1600.0, 1700.0]))
    assert widths.tolist() == [1600.0, 1700.0]
    assert ends == pytest.approx([0.0216, 0.0417])
    assert grid.is_ambiguous(np.array([0.0001, 0.01, 0.0199])).tolist() == [True, False, True]


def test_an_unmeasured_grid_is_known_to_a_frame(files):
    grid = assume_grid(files)
    assert grid.phase_std == pytest.approx(grid.period / np.sqrt(12.0))
    assert not grid.measured


def test_a_pulse_that_ends_between_two_points_counts_for_its_share():
    """Taken from the next point on it would be up to 1 ms late."""
    grid, t = PwmGrid(0.0, 0.0204, 0.0, 0.0, 0.0, measured=True), np.arange(0.0, 0.3, GRID_STEP)
    written = np.array([[0.0, 1500.0, 1500.0], [0.1003, 1500.0, 1600.0], [0.2, 1500.0, 1500.0]])
    (_, up, down), _ = grid.pulses(written[:, 0], written[:, 2])
    pulse = mean_pulse(grid, Traffic(written, np.zeros((0, 0)), 0.0), t)
    assert np.sum(pulse - 1500.0) * GRID_STEP == pytest.approx(100.0 * (down - up))
    assert set(pulse[np.abs(t - up) > GRID_STEP].round(6)) == {1500.0, 1600.0}


@pytest.mark.slow
def test_rates_that_a_state_withholds_are_in_the_log(tmp_path):
    """At the begin of a turn each rate jumps: the log has the sample, the State the one before."""
    with Car.open(f"{URL}5", cars=tmp_path) as car:
        log, shown = TrafficLog(car), []
        car.on_state(lambda state: shown.append(state.yaw_rate))
        with car.raw():
            for k, _ in enumerate(car.states(duration=6.0)):
                car.pulses(steering_us=1900.0 if k > 400 else 1500.0, throttle_us=1600.0)
        logged = log.take().column("yaw_rate")
    ahead = np.abs(logged - np.array(shown[-len(logged):], dtype=float))
    assert np.nanmedian(ahead) < 1e-3
    assert 0 < np.count_nonzero(ahead > 0.03) < 20


def test_a_servo_without_lag_removes_the_old_lag():
    """The controllers used the lag of the servo before."""
    old = Calibration(car="one").with_quantities({"latency.pulse_to_yaw_lag": Quantity(0.08, 0.003),
                                              "latency.pulse_to_yaw": Quantity(0.1, 0.003)})
    found = Measured("one", "test", "latency", {"latency.pulse_to_yaw": Quantity(0.02, 0.001)}, "",
                     1.0, absent=("latency.pulse_to_yaw_lag",))
    new = found.put_into(old)
    assert new.latency.pulse_to_yaw_lag is None
    assert new.latency.pulse_to_yaw.value == 0.02
