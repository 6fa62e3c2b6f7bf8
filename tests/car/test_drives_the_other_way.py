"""A car that drives against its throttle is disarmed: swapped motor leads, an IMU turned round."""

from __future__ import annotations

import itertools

import pytest

from dart_hal.calibration.steering import calibrate_steering
from dart_hal.calibration.throttle import calibrate_throttle
from dart_hal.car import Car
from dart_hal.core.errors import BadCommand, CalibrationFailed, Disarmed
from dart_hal.devices.actuation.direction_watch import DirectionWatch
from dart_hal.devices.links.base import open_backend
from dart_lab.sim import car_file
from dart_lab.sim.truth import world_of
from tests.car.pin_witness import Witness

pytestmark = pytest.mark.usefixtures("armed_esc")

SWAPPED_URL = "sim://?seed={seed}&fail=esc:wrong@0"
SAMPLE_TIME = 0.01
VALID_FOR = 0.2
"""s for which a command counts, the default of ``drive``."""


class Drive:
    """A drive of 2 s, and one more without commands; ``fastest`` [m/s] and ``rolled`` [m]: true.

    Every pulse at the ESC is compared with the mode at its time.
    """

    def __init__(self, url, command):
        backend = open_backend(url)
        world = world_of(backend)
        self.witness = Witness(world)
        self.fastest = 0.0
        self.causes = ()
        with Car.over(backend) as car:
            car.arm(waive=("CALIBRATION_MISSING",))
            try:
                for _ in car.states(duration=2.0):
                    self._record(car)
                    self.witness.record_command(world.t, world.t + VALID_FOR)
                    command(car)
                    self._record(car)
            except Disarmed as error:
                self.causes = error.causes
            for state in car.states(duration=1.0):
                self._record(car)
                assert state.applied.throttle == 0.0 or not self.causes
            self.rolled = abs(world.truth().x)
        self.witness.check(cutoff="none")

    def _record(self, car):
        world = self.witness.world
        self.witness.record_mode(world.t, car.mode)
        self.fastest = max(self.fastest, abs(world.truth().v_x))


@pytest.mark.parametrize("speed", [0.3, 1.0, -0.5])
@pytest.mark.parametrize("nano", ["&nano=mock", pytest.param("", marks=pytest.mark.slow)])
def test_swapped_leads_end_a_drive_at_a_speed(speed, nano):
    drive = Drive(SWAPPED_URL.format(seed=3) + nano,
                  lambda car: car.drive_speed(steering=0.0, speed=speed))
    assert drive.causes == ("AGAINST_THROTTLE",)
    assert drive.fastest < 0.8
    assert drive.rolled < 0.4


def test_control_without_the_watch_the_car_runs_away(monkeypatch):
    monkeypatch.setattr(DirectionWatch, "update", lambda *values: False)
    drive = Drive(SWAPPED_URL.format(seed=3) + "&nano=mock",
                  lambda car: car.drive_speed(steering=0.0, speed=0.5))
    assert drive.causes == ()
    assert drive.fastest > 3.0
    drive.witness.modes = [(0.0, "DISARMED")]
    drive.witness._checked = 0
    with pytest.raises(AssertionError, match="while"):
        drive.witness.check(cutoff="none")


def test_a_constant_throttle_trips_too():
    drive = Drive(SWAPPED_URL.format(seed=3) + "&nano=mock",
                  lambda car: car.drive(steering=0.0, throttle=0.4))
    assert drive.causes == ("AGAINST_THROTTLE",)
    assert drive.fastest < 1.0


def test_pauses_of_the_throttle_hide_nothing():
    """Each push of 0.2 s is too short for a rise of its own."""
    count = itertools.count()
    drive = Drive(SWAPPED_URL.format(seed=3) + "&nano=mock", lambda car: car.drive(
        steering=0.0, throttle=0.4 if next(count) % 30 < 20 else 0.0))
    assert drive.causes == ("AGAINST_THROTTLE",)
    assert drive.fastest < 1.0


def command_raw_pulses():
    """Command a pulse above neutral in ``raw()``; return the greatest true speed and the error."""
    backend = open_backend(SWAPPED_URL.format(seed=3) + "&nano=mock")
    world = world_of(backend)
    witness = Witness(world)
    fastest = 0.0
    message = ""
    with Car.over(backend) as car:
        try:
            with car.raw():
                for _ in car.states(duration=1.5):
                    witness.record_mode(world.t, car.mode)
                    witness.record_command(world.t, world.t + VALID_FOR)
                    car.pulses(steering_us=1500.0, throttle_us=1650.0)
                    fastest = max(fastest, abs(world.truth().v_x))
        except BadCommand as error:
            message = str(error)
        for state in car.states(duration=0.5):
            witness.record_mode(world.t, car.mode)
            assert state.applied.throttle == 0.0 or not message
    assert any(length > 1600.0 for *_, length in witness.pulses), "control: it drove at the pin"
    witness.check(cutoff="none")
    return fastest, message


def test_raw_pulses_end_too():
    fastest, error = command_raw_pulses()
    assert "AGAINST_THROTTLE" in error
    assert "leads" in error
    assert fastest < 1.0


def test_control_without_the_watch_raw_pulses_go_on(monkeypatch):
    monkeypatch.setattr(DirectionWatch, "update", lambda *values: False)
    fastest, error = command_raw_pulses()
    assert fastest > 1.5
    assert error == ""


def test_an_imu_turned_round_ends_a_drive(monkeypatch):
    usual = "[imu]\n"
    assert usual in car_file._CAR_TOML
    monkeypatch.setattr(car_file, "_CAR_TOML", car_file._CAR_TOML.replace(
        usual, f"{usual}mount_yaw = 3.1416\n"))
    drive = Drive("sim://?seed=3&nano=mock", lambda car: car.drive_speed(steering=0.0, speed=0.5))
    assert drive.causes == ("AGAINST_THROTTLE",)
    assert drive.fastest < 0.8


@pytest.mark.slow
@pytest.mark.parametrize("calibrate", [
    lambda car, workshop: calibrate_steering(car, dry_run=True), calibrate_throttle])
def test_a_calibration_ends_with_the_remedy(calibrate, tmp_path):
    backend = open_backend(SWAPPED_URL.format(seed=3) + "&nano=mock")
    world = world_of(backend)
    with Car.over(backend, cars=tmp_path) as car:
        speeds = []
        car.on_state(lambda state: speeds.append(abs(world.truth().v_x)))
        with pytest.raises(CalibrationFailed, match="leads"):
            calibrate(car, backend.workshop)
    assert max(speeds) < 0.8


def run_watch(speeds, throttles):
    watch = DirectionWatch()
    return [watch.update(k * SAMPLE_TIME, v, u) for k, (v, u) in enumerate(zip(speeds, throttles,
                                                                      strict=True))]


def ramp(begin, end, seconds):
    steps = round(seconds / SAMPLE_TIME)
    return [begin + (end - begin) * k / steps for k in range(steps)]


def test_speeding_up_backward_under_a_forward_throttle_is_noticed():
    assert any(run_watch(ramp(0.0, -0.5, 0.4), [0.3] * 40))


def test_a_reversal_is_no_fault():
    """The throttle changes its sign while the car still rolls the other way."""
    speeds = [*ramp(0.0, -1.0, 1.0), *ramp(-1.0, 0.0, 0.5), *ramp(0.0, 1.0, 1.0)]
    assert not any(run_watch(speeds, [-0.4] * 100 + [0.4] * 150))


def test_a_brake_downhill_is_no_fault():
    """It brakes as long as the car has not come to rest, however weakly."""
    assert not any(run_watch(ramp(1.0, 2.0, 2.0), [-0.1] * 200))


def test_a_wrong_sign_at_a_constant_speed_is_no_rise():
    """A bump of the floor or a slip of the wheels may exchange the sign for a moment."""
    speeds = [*ramp(0.0, 1.0, 1.0), *[1.0] * 500, *[-1.0] * 50, *[1.0] * 50]
    assert not any(run_watch(speeds, [0.3] * 700))


def test_pauses_do_not_end_a_rise():
    """Of four pushes of 0.15 m/s, the third is enough."""
    speeds = []
    throttles = []
    for k in range(4):
        speeds += [*ramp(-0.15 * k, -0.15 * (k + 1), 0.1), *[-0.15 * (k + 1)] * 10]
        throttles += [0.3] * 10 + [0.0] * 10
    assert run_watch(speeds, throttles).index(True) < 60


def test_rolling_down_a_slope_at_neutral_is_no_fault():
    """A throttle too small to hold it follows, in either direction."""
    speeds = [*ramp(0.0, -1.0, 1.0), *ramp(-1.0, -0.5, 1.0)]
    assert not any(run_watch(speeds, [0.0] * 100 + [0.2] * 100))
    assert not any(run_watch([-v for v in speeds], [0.0] * 100 + [-0.2] * 100))


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "speed"), [(8, 1.0), (11, 1.2), (19, 1.0)])
def test_a_sound_car_that_reverses_without_a_pause_is_not_disarmed(seed, speed):
    """The acceleration of the last 0.4 s confirmed the old sign of a wheel that had passed zero."""
    backend = open_backend(f"sim://?seed={seed}&nano=mock")
    world = world_of(backend)
    errors = []
    with Car.over(backend) as car:
        car.arm(waive=("CALIBRATION_MISSING",))
        start = car.now
        for state in car.states(duration=6.0):
            going_back = state.t - start < 3.0
            car.drive_speed(steering=0.0, speed=-speed if going_back else speed)
            if not going_back:
                error = state.speed - world.truth(state.t).v_x
                errors.append(abs(error) / max(state.speed_std, 0.02))
        assert car.mode == "ARMED"
    assert sum(error > 3.0 for error in errors) <= 0.01 * len(errors)
