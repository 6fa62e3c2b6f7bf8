"""What the IMU measures: mounting, place, scale, bias, noise."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_lab.sim.esc import EscMode
from dart_lab.sim.hidden import hidden_car
from dart_lab.sim.imu import Imu, ImuParams, rotation
from dart_lab.sim.mock_imu import MockImu
from dart_lab.sim.mock_nano import MockNano
from dart_lab.sim.truth import reveal
from dart_lab.sim.world import World

ANGLE = st.floats(-0.5, 0.5)
L_R = 0.0945


def make(dt=1e-3, seed=0, **options):
    return Imu(ImuParams(**options), L_R, dt, np.random.default_rng(seed))


@given(yaw=ANGLE, pitch=ANGLE, roll=ANGLE)
def test_mounting_is_a_rotation_that_the_host_can_undo(yaw, pitch, roll):
    rows = np.array(rotation(yaw, pitch, roll))
    np.testing.assert_allclose(rows @ rows.T, np.eye(3), atol=1e-12)
    gyro, accel = make(mount_yaw=yaw, mount_pitch=pitch, mount_roll=roll).sense(1.0, -2.0, 0.7, 0.0)
    assert rows @ gyro == pytest.approx([0, 0, 0.7], abs=1e-12)
    assert rows @ accel == pytest.approx([1.0, -2.0, 0.0], abs=1e-12)


@given(yaw=ANGLE, pitch=ANGLE, roll=ANGLE)
def test_on_a_tilted_plate_a_host_that_knows_the_mounting_reads_the_tilt(yaw, pitch, roll):
    """One angle of the plate at a time, by the equations of imu_yaw, imu_pitch, imu_roll."""
    mount = {"mount_yaw": 0.3, "mount_pitch": -0.2, "mount_roll": 0.1}
    rows = np.array(rotation(*mount.values()))

    def read(*tilt):
        gyro, accel = make(tilt=tilt, **mount).sense(1.0, -2.0, 0.7, 0.0)
        return (rows @ gyro)[2], *(rows @ accel)[:2]

    s, c = math.sin, math.cos
    assert read(yaw, 0.0, 0.0) == pytest.approx(
        (0.7, c(yaw) - 2.0 * s(yaw), -2.0 * c(yaw) - s(yaw)), abs=1e-12)
    assert read(0.0, pitch, 0.0) == pytest.approx(
        (0.7 * c(pitch), c(pitch) - 9.81 * s(pitch), -2.0), abs=1e-12)
    assert read(0.0, 0.0, roll) == pytest.approx(
        (0.7 * c(roll), 1.0, -2.0 * c(roll) + 9.81 * s(roll)), abs=1e-12)


def test_yaw_comes_first_observed_from_the_body():
    """body = Rz(yaw) Ry(pitch) Rx(roll) sensor: the sensor's x axis in the body."""
    forward = np.array(rotation(0.1, 0.2, 0.3)) @ [1.0, 0.0, 0.0]
    assert forward == pytest.approx(
        [math.cos(0.1) * math.cos(0.2), math.sin(0.1) * math.cos(0.2), -math.sin(0.2)])


def test_a_sensor_ahead_measures_the_turn():
    """0.1 m ahead at omega 2: centripetal -0.4; omega' 5: +0.5 to the left."""
    _, accel = make(x=L_R + 0.1).sense(0.0, 0.0, 2.0, 5.0)
    assert accel == pytest.approx((-0.4, 0.5, 0.0))
    _, accel = make(x=L_R, y=0.1).sense(0.0, 0.0, 2.0, 5.0)
    assert accel == pytest.approx((-0.5, -0.4, 0.0))


def test_the_world_passes_on_the_yaw_acceleration():
    """Two sensors at a distance of 0.2 m differ by 0.2 omega': summed up, by 0.2 of the yaw
    rate."""
    def lateral(x):
        accelerations = []
        car = replace(hidden_car(0), imu=ImuParams(x=x))
        world = World(car, MockNano())
        world.nano.set_imu = lambda gyro, accel: accelerations.append(accel[1])
        world.servo.pulse((0.1 - 1.7e-3, 0.1))
        world.esc.throttle, world.esc.mode = 0.3, EscMode.FORWARD
        world.esc.check = lambda t: None
        while world.t < 1.5:
            world.advance(1.5)
        return np.array(accelerations), world.truth().yaw_rate

    (near, rate), (far, _) = lateral(L_R), lateral(L_R + 0.2)
    assert rate > 0.5
    assert (far - near).sum() * 1e-3 == pytest.approx(0.2 * rate, rel=1e-6)


def test_noise_has_the_density_of_the_data_sheet():
    imu = make(gyro_noise=2e-4, accel_noise=1.5e-3)
    drawn = np.array([np.concatenate(imu.sense(0, 0, 0, 0)) for _ in range(20_000)])
    expected = np.array([2e-4] * 3 + [1.5e-3] * 3) * math.sqrt(500.0)
    assert drawn.std(axis=0) == pytest.approx(expected, rel=0.03)
    assert abs(drawn.mean(axis=0)) == pytest.approx(0.0, abs=4 * expected.max() / math.sqrt(2e4))


def test_noise_repeats_with_the_seed():
    runs = [[make(seed=s, gyro_noise=1e-3).sense(0, 0, 0, 0) for _ in range(3)] for s in (1, 1, 2)]
    assert runs[0] == runs[1] != runs[2]


@pytest.mark.parametrize("seed", [1, 5, 9])
def test_revealed_bias_is_what_a_calibrated_host_is_left_with(seed):
    car, shown = hidden_car(seed), reveal(seed)["sensors"]
    p = car.imu
    imu = Imu(ImuParams(**{f: getattr(p, f) for f in p.__dataclass_fields__
                           if not f.endswith("noise")}), L_R, 1e-3, np.random.default_rng(0))
    rows = np.array(rotation(shown["imu.mount_yaw"], shown["imu.mount_pitch"],
                             shown["imu.mount_roll"]))
    for omega in (0.0, 1.5):
        gyro, _ = imu.sense(0.0, 0.0, omega, 0.0)
        yaw_rate = (rows @ gyro)[2] / shown["imu.gyro_scale"] - shown["imu.gyro_bias"]
        assert yaw_rate == pytest.approx(omega, abs=1e-12)


def test_the_mock_shows_nothing_before_it_happens():
    """As the emulated chip: its filter follows what was, not what the tick brings."""
    imu = MockImu()
    for k in range(31):
        imu.set(1e-3 * k, (0.0, 0.0, 1.0 if k >= 20 else 0.0), (0.0, 0.0, 0.0))
    assert imu.sample(0.020)[5] == 0
    assert imu.sample(0.030)[5] == round(900.0 * -math.expm1(-2.0 * math.pi * 32.0 * 0.010))
