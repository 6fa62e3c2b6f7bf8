"""The loop through the pins: pulses in, motion, encoder and gyro out."""

from __future__ import annotations

import math

import pytest

from dart_hal.core.errors import UsageError
from dart_hal.devices.links.base import open_backend
from dart_hal.vehicle import PAPER, make_steering

EDGE = 0.0412918 / 20


@pytest.mark.slow
def test_left_steering_turns_left(raw_car):
    car = raw_car().arm().drive(0.5, 0.25, 0.8)
    assert car.truth.yaw > 0.05
    assert car.truth.y > 0.01
    assert car.truth.steering > 0.1
    assert car.states()[-1]["gyro"][2] > 0.1


@pytest.mark.slow
def test_right_is_the_mirror_image_with_a_symmetric_map(raw_car):
    left = raw_car().arm().drive(0.4, 0.25, 1.0).truth
    right = raw_car().arm().drive(-0.4 - 2 * PAPER.steering.s0, 0.25, 1.0).truth
    assert right.y < 0 < left.y
    assert right.x == pytest.approx(left.x, rel=0.1)


def test_a_car_without_pulses_stays_at_rest(raw_car):
    car = raw_car().run(2.0)
    assert (car.truth.x, car.truth.y, car.truth.yaw) == pytest.approx((0, 0, 0), abs=1e-9)
    assert car.states()[-1]["enc_count"] == 0


def test_no_drive_before_the_esc_has_armed(raw_car):
    assert raw_car().drive(0.0, 0.5, 1.0).truth.v_x == pytest.approx(0.0, abs=1e-9)


@pytest.mark.slow
def test_encoder_counts_the_distance(raw_car):
    car = raw_car().arm().drive(-PAPER.steering.s0, 0.3, 3.0)
    state = car.states()[-1]
    travelled = car.world.truth(state["t_ck"]).distance
    assert state["enc_count"] == pytest.approx(travelled / EDGE, abs=1.01)


@pytest.mark.slow
def test_steady_speed_is_that_of_the_equations(raw_car):
    """Straight on at tau 0.3 the paper's car settles at 2.195 m/s."""
    car = raw_car().arm().drive(-PAPER.steering.s0, 0.3, 12.0)
    tau = car.world.esc.throttle
    assert tau == pytest.approx(0.3, abs=0.006)
    assert car.truth.v_x == pytest.approx(2.195 + (tau - 0.3) * 14.0, abs=0.01)


def test_road_wheel_angle_is_the_map_of_the_pulse(raw_car):
    car = raw_car()
    car.pulses(1500 + 187.5, 1500)
    car.run(1.0)
    assert car.truth.steering == pytest.approx(make_steering(PAPER.steering)(0.5), abs=0.004)


@pytest.mark.slow
def test_gyro_and_accelerometer_agree_with_the_motion(raw_car):
    car = raw_car().arm().drive(0.5, 0.24, 4.0)
    state, truth = car.states()[-1], car.truth
    assert state["gyro"][2] == pytest.approx(truth.yaw_rate, abs=4e-3)
    assert state["lin_acc"][1] == pytest.approx(truth.yaw_rate * truth.v_x, abs=0.02)


def test_kinematic_car_follows_its_wheels(raw_car):
    car = raw_car("sim://?nano=mock&physics=kinematic").arm().drive(0.5, 0.25, 2.0)
    truth = car.truth
    assert truth.yaw_rate == pytest.approx(truth.v_x * math.tan(truth.steering) / 0.175, abs=1e-9)


@pytest.mark.slow
def test_brake_then_reverse(raw_car):
    car = raw_car().arm().drive(0.0, 0.3, 2.0)
    fast = car.truth.v_x
    car.drive(0.0, -0.4, 0.9)
    assert fast > 1.5
    assert car.truth.v_x == pytest.approx(0.0, abs=0.05)
    car.drive(0.0, 0.0, 0.3)
    car.drive(0.0, -0.4, 1.0)
    assert car.truth.v_x < -0.5
    assert car.states()[-1]["enc_count"] > car.states()[-100]["enc_count"]


@pytest.mark.slow
def test_lost_pulses_let_the_car_roll_out(raw_car):
    car = raw_car().arm().drive(0.0, 0.3, 2.0)
    car.backend.bus.writeto(0x40, b"\xfd\x10")
    car.run(3.0)
    assert car.truth.v_x == pytest.approx(0.0, abs=0.02)


@pytest.mark.slow
def test_looking_at_the_truth_changes_nothing(raw_car):
    one, two = raw_car(), raw_car()
    for car, look in ((one, False), (two, True)):
        car.arm().pulses(1600, 1640)
        for _ in range(40):
            car.run(0.0373)
            if look:
                car.world.truth()
    assert one.raw == two.raw


def test_truth_in_the_past(raw_car):
    car = raw_car().arm().drive(0.3, 0.3, 1.0)
    then, at = car.truth, car.world.t
    car.run(1.0)
    again = car.world.truth(at)
    assert (again.x, again.y, again.yaw) == pytest.approx((then.x, then.y, then.yaw), abs=3e-3)


def test_workshop_measures_as_well_as_a_person(raw_car):
    car = raw_car().arm()
    shop = car.backend.workshop
    shop.mark()
    before = car.truth
    car.drive(0.5, 0.25, 3.0)
    answers = [shop.distance() for _ in range(200)]
    true = car.truth.distance - before.distance
    assert sum(answers) / 200 == pytest.approx(true, abs=6e-4)
    assert max(abs(a - true) for a in answers) > 2e-3
    assert shop.turns() == pytest.approx(car.truth.yaw - before.yaw, abs=math.radians(2.5))


def test_clock_channel_reaches_the_input_capture(raw_car):
    from dart_hal.wire.codec import encode
    from dart_hal.wire.messages import CAPTURE_REQ

    car = raw_car("sim://?nano=mock&seed=4")
    car.backend.bus.writeto(0x40, bytes((0x06 + 60, 0, 0, 307 & 255, 307 >> 8)))
    car.run(0.1)
    car.backend.link.write(encode(CAPTURE_REQ, 0, (50,)))
    car.run(2.0)
    first, last, high, frames, low, longest = car.frames_named("CAPTURE")[0].values()
    mcu = 2e6 * (1 + car.world.car.clock_error)
    period = (last - first) / frames / mcu
    assert frames == 50
    assert period == pytest.approx(4096 * 122 / car.world.car.oscillator_hz, abs=2e-8)
    assert high / frames / mcu == pytest.approx(307 * 122 / car.world.car.oscillator_hz, abs=1e-6)
    assert longest - low <= 2


@pytest.mark.parametrize("url", [
    "sim://?seed=x", "sim://?seed=-1", "sim://?nano=real", "sim://?model=tank",
    "sim://?colour=red", "sim://car", "sim://?jitter=much", "sim://?ber=high", "sim://?ring=odd"])
def test_nonsense_is_refused(url):
    with pytest.raises(UsageError):
        open_backend(url + ("&nano=mock" if "nano" not in url and "?" in url else ""))
