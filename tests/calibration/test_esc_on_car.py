"""`calibrate esc` through the whole Car, against the hidden truth of simulated cars."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from esc_pin import FRAMES, Watched, without_stop
from fit_graphs import distance_from_fit

from dart_hal.calibration import esc, esc_fit
from dart_hal.calibration.esc import calibrate_esc
from dart_hal.calibration.esc_fit import find_knee, fit_force
from dart_hal.calibration.measured import write
from dart_hal.calibration.spin import PulseSpan
from dart_hal.car import Car
from dart_hal.core.errors import CalibrationFailed
from dart_lab.sim.esc import Esc
from dart_lab.sim.truth import reveal
from studies.calibration.hidden_errors import errors, worst

URL = "sim://?nano=mock&seed="
QUANTITIES = {f"throttle.{name}" for name in (
    "neutral_us", "deadband_forward_us", "deadband_reverse_us", "saturation_us", "reverse_rest",
    "signal_loss")}


class Spun(Watched):
    """One calibration of the ESC."""

    def calibrate(self, **options):
        return self.run(calibrate_esc, self.backend.workshop, **options)


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """(files, result, the same car) of hidden car 5."""
    tmp_path = tmp_path_factory.mktemp("esc")
    watched = Spun(f"{URL}5", tmp_path)
    result = watched.calibrate()
    yield watched.car.files, result, watched
    watched.car.close()


@pytest.mark.slow
def test_a_hidden_esc_is_found(measured):
    _, result, watched = measured
    true = reveal(5)["sensors"]
    assert set(result.quantities) == QUANTITIES
    for name, q in result.quantities.items():
        assert abs(q.value - true[name]) < 3.5 * q.std, name
    assert result.quantities["throttle.neutral_us"].std < 0.3
    assert result.quantities["throttle.signal_loss"].std < 0.02
    assert result.others == {"throttle.reverse": "after_brake"}
    graph = result.graph
    assert distance_from_fit(graph) < 0.01
    dead = result.quantities["throttle.deadband_forward_us"].value
    assert np.ptp(graph.fit_x[graph.fit_y == 0.0]) == pytest.approx(2.0 * dead)
    assert (np.sign(graph.y) == np.sign(graph.x - true["throttle.neutral_us"])).all()
    assert watched.world.lifted is None
    assert watched.pulled_after(watched.car._engine.now) < -0.4


@pytest.mark.slow
def test_what_is_written_is_read(measured, tmp_path):
    files, result, _ = measured
    assert not files.folder.exists()
    write(replace(files, folder=tmp_path / files.config.name), result)
    with Car.open(f"{URL}5", cars=tmp_path) as car:
        throttle = car.files.calibration.throttle
        assert throttle.reverse == "after_brake"
        assert car.files.neutral_us == pytest.approx(
            result.quantities["throttle.neutral_us"].value, abs=0.01)
        pins = [s.applied.throttle_us for s in car.states(duration=0.3)]
        assert pins[-1] == pytest.approx(throttle.neutral_us.value, abs=2.6)
        assert car.files.calibration.provenance["esc"]["residual"] == result.residual


def test_control_the_box_would_be_off():
    """Without the calibration neutral is known to 10 us, not to 0.2."""
    neutral = [reveal(seed)["sensors"]["throttle.neutral_us"] for seed in range(1, 31)]
    assert np.std(np.array(neutral) - 1500.0) > 3.0


def a_spin(rng, pulse, start, begin, pull, a, c, has=None, lag=0.0):
    """(one span of wheels of a law, its edges off by the printing of their marks; the speed and
    the pulse that the motor ``has`` at its end)."""
    has, keeps = pulse if has is None else has, float(np.exp(-1e-3 / lag)) if lag else 0.0
    v, x, t, rows = start, 0.0, 0.0, []
    while t < 0.6 and (v > 0.05 or lag):
        rows.append((t, x + 4e-5 * rng.normal()))
        for _ in range(10):
            has = pulse + (has - pulse) * keeps
            away = max(has - begin, 0.0)
            v = max(v + 1e-3 * (pull * away - a - (c + 0.004 * away) * v), 0.0)
            x, t = x + 1e-3 * v, t + 1e-3
    times, places = np.array(rows).T
    return PulseSpan(pulse, times, places, t), v, has


def spun(rng, begin, lag=0.0):
    """Twelve spans in sequence."""
    speed, has, spins = 0.6, 1500.0, []
    for pulse in (1640, 1605, 1620, 1595, 1500, 1640, 1605, 1500, 1620, 1595, 1640, 1500):
        spin, speed, has = a_spin(rng, float(pulse), speed if lag else max(speed, 0.4), begin,
                                  0.21, 4.3, 0.7, has, lag)
        spins.append(spin)
    return spins


@pytest.mark.slow
def test_interval_of_the_onset_is_what_the_marks_make_it(monkeypatch):
    """Fifty virtual ESCs: the 90 % intervals hold the onset, by their scatter alone."""
    monkeypatch.setattr(esc_fit, "MODEL_STD_US", 0.0)
    rng, inside = np.random.default_rng(1), []
    for _ in range(50):
        begin = 1560.0 + 20.0 * rng.random()
        found = fit_force(spun(rng, begin), 1500.0).begin
        inside.append(abs(found.value - begin) < 1.645 * found.std)
        assert found.std < 0.5
    assert 0.78 <= np.mean(inside) <= 0.98


@pytest.mark.parametrize("lag", [0.04, 0.084, 0.12])
@pytest.mark.slow
def test_the_lag_of_a_motor_is_separated_from_its_onset(lag):
    force = fit_force(spun(np.random.default_rng(1), 1565.0, lag), 1500.0)
    assert force.begin.value == pytest.approx(1565.0, abs=3.5 * force.begin.std)
    assert force.begin.std < 1.0
    assert force.lag == pytest.approx(lag, abs=0.01)


def test_control_without_its_lag_the_onset_is_off_or_refused(monkeypatch):
    monkeypatch.setattr(esc_fit, "_have_lag", lambda parts: False)
    off = 0
    for seed in range(3):
        try:
            begin = fit_force(spun(np.random.default_rng(seed), 1565.0, 0.084), 1500.0).begin
        except CalibrationFailed:
            off += 1
        else:
            off += abs(begin.value - 1565.0) > 3.0
    assert off == 3


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 4])
@pytest.mark.long_except("3")
def test_a_hidden_esc_with_the_lag_of_the_later_set_is_found(seed, tmp_path):
    """Both cars were refused before the lag was fitted."""
    watched = Spun(f"{URL}{seed}&effect=throttle_lag:0.084", tmp_path)
    with watched.car:
        result = watched.calibrate()
    true = reveal(seed)["sensors"]
    for name in ("throttle.neutral_us", "throttle.deadband_forward_us"):
        q = result.quantities[name]
        assert abs(q.value - true[name]) < 3.5 * q.std
        assert q.std < 1.5
    assert any("follows its pulses" in note for note in result.notes)


@pytest.mark.slow
@pytest.mark.parametrize("nano", ["mock", pytest.param("avr", marks=pytest.mark.emulator)])
@pytest.mark.long_except("mock")
def test_esc_of_the_car_without_a_seed_is_measured(nano, tmp_path):
    """It has a gyro without noise, whose samples with lifted wheels are zeros now and then."""
    result = Spun(f"sim://?nano={nano}", tmp_path).calibrate()
    assert result.quantities["throttle.neutral_us"].value == pytest.approx(1500.0, abs=1.0)


@pytest.mark.parametrize("seed", [1, 2, 9])
@pytest.mark.long
def test_more_hidden_escs(seed):
    assert {name: z for name, z in worst(errors("esc", seed)).items() if z > 3.5} == {}


@pytest.mark.slow
@pytest.mark.emulator
def test_the_firmware_counts_as_well(tmp_path):
    result = Spun("sim://?nano=avr&seed=3", tmp_path).calibrate()
    true = reveal(3)["sensors"]
    assert set(result.quantities) == QUANTITIES
    assert all(abs(q.value - true[n]) < 3.5 * q.std for n, q in result.quantities.items())


@pytest.mark.long
def test_intervals_of_30_hidden_cars_hold_the_truth():
    rows = [worst(errors("esc", seed)) for seed in range(1, 31)]
    for name in QUANTITIES:
        inside = np.mean([row[name] < 1.645 for row in rows])
        assert 0.8 <= inside <= 1.0, (name, inside)
    assert all(set(row) == QUANTITIES for row in rows)


@pytest.mark.slow
def test_control_coasting_separates_friction_from_the_dead_band(tmp_path, monkeypatch):
    """Without the segments at neutral, dry friction and dead band are the same thing."""
    segments = esc_fit._make_segments
    monkeypatch.setattr(esc_fit, "_make_segments",
                        lambda *given: [part for part in segments(*given) if part.drives])
    with pytest.raises(CalibrationFailed, match="accelerate and coast in the same way"):
        Spun(f"{URL}5", tmp_path).calibrate()


# -- another ESC -----------------------------------------------------------------


class AtOnce(Esc):
    """It knows no brake."""

    def _reverse(self, level: float) -> None:
        self._set(type(self.mode).REVERSE, -level)


class NoReverse(Esc):
    """A pull below neutral always brakes."""

    def _reverse(self, level: float) -> None:
        self._set(type(self.mode).BRAKING, 0.0, level)


class DragBrake(Esc):
    """It brakes a little at neutral."""

    def _neutral(self, t: float) -> None:
        super()._neutral(t)
        self.brake = 0.1


def as_esc(kind, **params):
    def alter(world):
        world.esc = kind(replace(world.esc.params, **params))
    return alter


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "params", "reverse", "absent"), [
    (AtOnce, {}, "at_once", {"reverse_rest"}),
    (NoReverse, {}, "never", {"reverse_rest", "neutral_us", "deadband_forward_us",
                              "deadband_reverse_us", "saturation_us"}),
    (Esc, {"reverse_gap": 0.3}, "after_brake", set()),
    (Esc, {"reverse_gap": 0.8}, "after_brake", set()),
    (Esc, {"signal_loss": 99.0}, "after_brake", {"signal_loss"}),
    (Esc, {"saturation_us": 600.0}, "after_brake", {"saturation_us"})])
@pytest.mark.long_except("*0", "*5")
def test_the_behaviour_of_another_esc_is_reported(tmp_path, kind, params, reverse, absent):
    result = Spun(f"{URL}5", tmp_path, as_esc(kind, **params)).calibrate()
    assert result.others["throttle.reverse"] == reverse
    assert set(result.quantities) == QUANTITIES - {f"throttle.{name}" for name in absent}
    for name, value in params.items():
        found = result.quantities.get("throttle.reverse_rest" if name == "reverse_gap"
                                      else f"throttle.{name}")
        assert found is None or abs(found.value - value) < 3.0 * found.std
    if absent - {"reverse_rest"}:
        assert any(note.startswith("caution:") for note in result.notes)


@pytest.mark.slow
@pytest.mark.parametrize("taken_off", [True, False])
def test_a_brake_at_neutral_is_no_friction(tmp_path, monkeypatch, taken_off):
    """Control: not taken off, it moves neutral by 4 us, for the motor pulls less in reverse."""
    if not taken_off:
        monkeypatch.setattr(esc, "MIN_NEUTRAL_BRAKE", float("inf"))
    result = Spun(f"{URL}5", tmp_path, as_esc(DragBrake)).calibrate()
    q, true = result.quantities["throttle.neutral_us"], reveal(5)["sensors"]["throttle.neutral_us"]
    assert (abs(q.value - true) < 3.5 * q.std) == taken_off
    assert (abs(q.value - true) > 3.0) != taken_off
    assert any("brakes at neutral" in note for note in result.notes) == taken_off


def test_a_knee_that_is_not_there_is_not_found():
    pulses = np.arange(300.0, 500.0, 10.0)
    law = (pulses - 60.0) / (0.2 * pulses + 20.0)
    assert find_knee(pulses, law) is None
    found = find_knee(pulses, np.minimum(law, law[14]))
    assert found.value == pytest.approx(pulses[14], abs=0.1)


# -- what is wrong is named, and the pin is at neutral -----------------------------


@pytest.mark.slow
@pytest.mark.parametrize(("fail", "why"), [
    pytest.param(fail, why, id=fail) for fail, why in (
        ("esc:wrong@0", "turns the wheels backward"), ("wheel:stuck@0", "a wheel is blocked"),
        ("wheel:stuck@14", "a wheel is blocked"), ("enc:off@0", "encoder does not count"),
        ("enc:off@12", "encoder does not count"), ("enc:off@58", "encoder does not count"),
        ("esc:off@0", "motor does not answer"), ("esc:off@14", "motor does not answer"),
        ("esc:off@25", "motor does not answer"), ("stand:off@0", "not off the ground"),
        ("stand:off@14", "not off the ground"), ("stand:off@55", "not off the ground"),
        ("imu:off@14", "no data of the IMU"), ("enc:wrong=0.5@14", "accelerate and coast in the"))
])
def test_what_is_wrong_is_named_and_nothing_written(tmp_path, fail, why):
    watched = Spun(f"{URL}5&fail={fail}", tmp_path)
    with watched.car, pytest.raises(CalibrationFailed, match=why):
        watched.calibrate()
    assert not list(tmp_path.rglob("calibration.toml"))
    assert watched.pulled_after(watched.world.t) < -0.4
    assert watched.world.lifted is None


@pytest.mark.slow
def test_edges_of_wheels_at_rest_are_not_motion(tmp_path):
    watched = Spun(f"{URL}5", tmp_path)
    watched.backend.workshop.wheels_turned = lambda: 0
    with watched.car, pytest.raises(CalibrationFailed, match="although the wheels are at rest"):
        watched.calibrate()


def test_nothing_turns_unless_it_was_agreed(tmp_path):
    watched, questions = Spun(f"{URL}2", tmp_path), []
    with watched.car, pytest.raises(CalibrationFailed, match="not agreed"):
        watched.calibrate(ask=lambda q: questions.append(q) or False)
    assert watched.pulled_after(0.0) == 0.0
    for word in ("neutral", " s, ", "stand", "fingers"):
        assert word in questions[0]


PRESSED = {"first motion": 8.0, "forward": 14.0, "brake": 21.5, "reverse": 46.0,
           "full throttle": 58.0, "no pulse": 67.9}
"""s of the car's time."""


def pressed(tmp_path, t: float) -> Spun:
    """Ctrl-C at a time."""
    watched = Spun(f"{URL}5", tmp_path)
    watched.press(lambda state: watched.world.t > t, calibrate_esc, watched.backend.workshop)
    return watched


@pytest.mark.slow
@pytest.mark.parametrize("when", PRESSED)
@pytest.mark.long_except("full throttle", "reverse")
def test_ctrl_c_is_neutral_at_the_pin_within_two_frames(tmp_path, when):
    watched = pressed(tmp_path, PRESSED[when])
    assert watched.pulled_after(PRESSED[when]) < FRAMES
    assert watched.pulses[-1][0] > watched.world.t - 0.03
    assert watched.car.mode == "DISARMED"
    assert not list(tmp_path.rglob("calibration.toml"))
    watched.car.close()


@pytest.mark.slow
def test_control_without_the_stop_the_pin_pulls_on(tmp_path, monkeypatch):
    without_stop(monkeypatch)
    watched = pressed(tmp_path, PRESSED["forward"])
    assert watched.pulled_after(PRESSED["forward"]) > 0.15
    watched.car.close()


def test_neutral_follows_the_highest_level():
    """Wheels that stop soon show the friction only from there, and the friction decides P."""
    before = [esc.LEVEL_ORDER[k - 1] for k, level in enumerate(esc.LEVEL_ORDER) if level is None]
    assert before == [len(esc.PULSE_LEVELS) - 1] * 4
