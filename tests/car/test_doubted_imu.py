"""An IMU that lies: what of it reaches a State, and what the pose then states."""

from __future__ import annotations

import math

import pytest

from dart_hal.car import Car
from dart_hal.core.errors import NotArmed
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.truth import world_of

pytestmark = pytest.mark.usefixtures("armed_esc")
GYRO_STD = 0.05
"""rad/s: mounting and scale of a hidden car at 1 rad/s, filter and age in a bend that begins."""


def drive(tmp_path, fault, *, believed: bool = False, seconds: float = 2.0, struck: float = 1.5):
    """(States, truths) from the fault on; a bend at 0.8 m/s. believed: nothing is checked."""
    backend = open_backend("sim://?nano=mock&seed=5")
    rows = []
    with Car.over(backend, cars=tmp_path) as car:
        world = world_of(backend)
        car.arm(waive=["CALIBRATION_MISSING"])
        if believed:
            check = car._engine.telemetry.imu
            check.judge = lambda now, t, gyro, *_: gyro is not None
        start = None
        done = False
        for state in car.states(duration=struck + seconds):
            start = state.t if start is None else start
            if not done and state.t - start >= struck:
                fault(world)
                done = True
            if done:
                rows.append((state, world.truth(state.t)))
            car.drive_speed(steering=0.2, speed=0.8)
    return rows


def garbage(world) -> None:
    world.nano.set_imu_fault("garbage")


def wrong_side(world) -> None:
    inner = world.nano.imu.set
    world.nano.imu.set = lambda t, gyro, acc: inner(t, [-g for g in gyro], acc)


def zeros(world) -> None:
    world.nano.imu.sample = lambda t: (0, 0, 0, 0, 0, 0)


def wrong(rows) -> list[float]:
    """Errors [rad/s] of those States that give a yaw rate out."""
    return [abs(s.yaw_rate - truth.yaw_rate) for s, truth in rows if s.yaw_rate is not None]


def yaw_sigmas(rows) -> float:
    """Largest error of the pose's yaw since the fault, in stated deviations."""
    (s0, t0), *rest = rows
    return max(abs((s.pose.yaw - s0.pose.yaw) - (t.yaw - t0.yaw)) / math.sqrt(s.pose.cov[2, 2])
               for s, t in rest)


@pytest.mark.slow
def test_garbage_is_never_given_out_and_the_pose_states_its_deviation(tmp_path):
    rows = drive(tmp_path, garbage)
    assert max(wrong(rows), default=0.0) <= 3.0 * GYRO_STD
    assert yaw_sigmas(rows) <= 3.0
    assert sum(s.yaw_rate is None for s, _ in rows) > 0.95 * len(rows)
    named = set().union(*(s.health.doubts for s, _ in rows))
    assert named & {"IMU_RANGE", "IMU_STEP"}
    assert not named & {"ENCODER_LOW", "ENCODER_HIGH"}, "the encoder is not to blame"


@pytest.mark.slow
def test_control_without_the_checks_garbage_is_believed(tmp_path):
    rows = drive(tmp_path, garbage, believed=True)
    assert max(wrong(rows)) > 10.0
    assert yaw_sigmas(rows) > 3.0


@pytest.mark.slow
def test_a_gyro_that_turns_the_other_way_is_found(tmp_path):
    rows = drive(tmp_path, wrong_side)
    late = [s for s, _ in rows[60:]]
    assert all(s.yaw_rate is None for s in late)
    assert all("IMU_DISAGREES" in s.health.doubts for s in late)


@pytest.mark.slow
def test_zeros_are_no_data(tmp_path):
    rows = drive(tmp_path, zeros)
    assert all(s.yaw_rate is None for s, _ in rows[5:]), "the last sample may live for 15 ms"
    assert yaw_sigmas(rows) <= 3.0


@pytest.mark.slow
def test_a_doubted_imu_refuses_to_arm(tmp_path):
    backend = open_backend("sim://?nano=mock&seed=5")
    with Car.over(backend, cars=tmp_path) as car:
        for _ in car.states(duration=1.0):
            pass
        world_of(backend).nano.imu.sample = lambda t: (5, 0, 0, 0, 0, 20_000 * (-1)**int(t * 100))
        with pytest.raises(NotArmed) as refused:
            car.arm(waive=["CALIBRATION_MISSING"])
        assert "IMU_DOUBTED" in refused.value.reasons
