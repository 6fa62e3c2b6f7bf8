"""Dead reckoning: geometry, gyro bias, honest covariance."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dart_hal.estimation import Odometry, OdometryNoise

ODOMETRY_PERIOD = 0.01
AGE = 0.004
LATENCY = 0.010


def drive(odometry, speed, yaw_rate, seconds, *, bias=0.0, gyro=True, start=0.0, travelled=0.0):
    """Feed a constant motion; returns (now, distance) to go on with."""
    steps = round(seconds / ODOMETRY_PERIOD)
    for k in range(1, steps + 1):
        now = start + k * ODOMETRY_PERIOD
        odometry.update(now, travelled + speed * k * ODOMETRY_PERIOD, speed,
                        yaw_rate + bias if gyro else None, now - AGE, 1.0, yaw_rate)
    return start + seconds, travelled + speed * seconds


@pytest.mark.parametrize("gyro", [True, False])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_circle_closes(gyro, sign):
    odometry = Odometry()
    odometry.update(0.0, 0.0, 1.0, sign * 2.0, -AGE, 1.0, sign * 2.0)
    drive(odometry, 1.0, sign * 2.0, 100 * ODOMETRY_PERIOD, gyro=gyro)
    radius = 0.5
    yaw = sign * 2.0
    assert odometry.yaw == pytest.approx(yaw)
    pose = odometry.pose
    assert math.hypot(pose.x, pose.y - sign * radius) == pytest.approx(radius)
    drive(odometry, 1.0, sign * 2.0, math.pi - 1.0, gyro=gyro, start=1.0, travelled=1.0)
    assert math.hypot(odometry.x, odometry.y) < 0.01


def test_an_arc_is_exact_for_any_frame_length():
    fine = Odometry()
    coarse = Odometry()
    for odometry, count in ((fine, 1000), (coarse, 10)):
        for k in range(count + 1):
            now = k / count
            odometry.update(now, now * 1.5, 1.5, None, 0.0, 1.0, 1.2)
    assert coarse.x == pytest.approx(fine.x, abs=1e-9)
    assert coarse.y == pytest.approx(fine.y, abs=1e-9)
    assert fine.x == pytest.approx(1.25 * math.sin(1.2), abs=1e-9)
    assert fine.y == pytest.approx(1.25 * (1 - math.cos(1.2)), abs=1e-9)


def test_left_and_right_are_mirror_images():
    left = Odometry()
    right = Odometry()
    drive(left, 1.0, 1.5, 3.0)
    drive(right, 1.0, -1.5, 3.0)
    assert right.x == pytest.approx(left.x)
    assert right.y == pytest.approx(-left.y)
    assert right.pose.cov == pytest.approx(left.pose.cov * np.array(
        [[1, -1, -1], [-1, 1, 1], [-1, 1, 1]]))


def test_standstill_teaches_the_bias_and_does_not_turn():
    odometry = Odometry()
    now, at = drive(odometry, 0.0, 0.0, 5.0, bias=0.012)
    assert odometry.yaw == 0.0
    assert odometry.bias.value == pytest.approx(0.012, abs=1e-3)
    assert odometry.bias.std < 1e-3
    drive(odometry, 1.0, 0.0, 10.0, bias=0.012, start=now, travelled=at)
    assert abs(odometry.yaw) < 0.012
    assert abs(odometry.y) < 3 * math.sqrt(odometry.pose.cov[1, 1])


def test_carrying_the_car_teaches_no_bias():
    odometry = Odometry(gyro_bias=0.0, gyro_bias_std=0.002)
    drive(odometry, 0.0, 0.8, 3.0)
    assert odometry.bias.value == 0.0


def test_restart_keeps_the_pose():
    odometry = Odometry()
    drive(odometry, 1.0, 0.5, 2.0)
    before = odometry.pose
    odometry.restart()
    odometry.update(0.02, 900.0, 1.0, 0.5, 0.016)
    after = odometry.pose
    assert math.hypot(after.x - before.x, after.y - before.y) < 1e-9
    drive(odometry, 1.0, 0.5, 1.0, start=0.02, travelled=900.0)
    assert math.hypot(odometry.x - before.x, odometry.y - before.y) == pytest.approx(1.0, rel=0.05)


def test_a_known_slip_turns_the_path_outwards():
    """Left circle, radius R: the axle points inwards of its path by the slip angle."""
    plain = Odometry()
    sliding = Odometry(slip_gain=0.03)
    for odometry in (plain, sliding):
        odometry.update(0.0, 0.0, 1.0, 1.0, -AGE)
        drive(odometry, 1.0, 1.0, 0.1)
    assert plain.y - sliding.y == pytest.approx(0.03 * 0.1, rel=0.02)
    assert sliding.yaw == plain.yaw


def test_pose_is_read_only():
    with pytest.raises(ValueError, match="read-only"):
        Odometry().pose.cov[0, 0] = 1.0


def simulate(seed, noise, seconds=20.0, rest_seconds=3.0):
    """A car with drawn errors drives a bent way; (error, covariance) at the end."""
    rng = np.random.default_rng(seed)
    bias = noise.gyro_bias * rng.standard_normal()
    gyro_scale = 1 + noise.gyro_scale * rng.standard_normal()
    travel_scale = 1 + noise.travel_scale * rng.standard_normal()
    slip_gain = noise.slip_gain * rng.standard_normal()
    odometry = Odometry(noise)
    x = y = yaw = measured = 0.0

    def omega(t):
        return 1.2 * math.sin(0.5 * t) + 0.3

    def change(t):
        return 0.6 * math.cos(0.5 * t)

    for k in range(-round(rest_seconds / ODOMETRY_PERIOD),
                   1):  # the ESC requires 2 s of neutral anyway
        now = k * ODOMETRY_PERIOD
        noisy = noise.gyro_noise / math.sqrt(ODOMETRY_PERIOD) * rng.standard_normal()
        odometry.update(now, 0.0, 0.0, round((bias + noisy) * 900) / 900, now - AGE)
    odometry.update(0.0, 0.0, 1.2, gyro_scale * omega(-AGE - LATENCY) + bias, -AGE)
    for k in range(1, round(seconds / ODOMETRY_PERIOD) + 1):
        now = k * ODOMETRY_PERIOD
        ds = 1.2 * ODOMETRY_PERIOD
        turn = 0.5 * (omega(now - ODOMETRY_PERIOD) + omega(now)) * ODOMETRY_PERIOD
        slide = noise.slip * math.sqrt(ds) * rng.standard_normal()
        slide -= slip_gain * 1.2 * omega(now) * ds
        x += ds * math.cos(yaw + turn / 2) - slide * math.sin(yaw)
        y += ds * math.sin(yaw + turn / 2) + slide * math.cos(yaw)
        yaw += turn
        measured += travel_scale * (ds + noise.travel * math.sqrt(ds) * rng.standard_normal())
        reading = (gyro_scale * omega(now - AGE - LATENCY) + bias
                   + math.hypot(noise.gyro_noise, noise.gyro_age * change(now))
                   / math.sqrt(ODOMETRY_PERIOD) * rng.standard_normal())
        odometry.update(now, measured, 1.2, reading, now - AGE)
    pose = odometry.pose
    return np.array([pose.x - x, pose.y - y, pose.yaw - yaw]), pose.cov


def nees(noise, seeds):
    values = []
    for seed in seeds:
        error, cov = simulate(seed, noise)
        values.append(error @ np.linalg.solve(cov, error))
    return float(np.mean(values))


@pytest.mark.parametrize("noise", [
    OdometryNoise(),
    OdometryNoise(gyro_noise=2e-3),
    OdometryNoise(gyro_scale=0.002, travel_scale=0.002, slip_gain=0.04),
], ids=["default", "noisy gyro", "calibrated, slippery"])
@pytest.mark.slow
def test_covariance_is_honest(noise):
    """Mean of 60 chi-square values of 3 degrees: 3 +- 0.32, so 4 sigma."""
    assert 1.75 < nees(noise, range(60)) < 4.3


@pytest.mark.slow
def test_covariance_without_the_constant_errors_would_lie():
    """Control: a bias of the stated size, a filter with white noise alone."""
    truth = OdometryNoise()
    values = []
    for seed in range(10):
        error, _ = simulate(seed, truth)
        blind = Odometry(OdometryNoise(gyro_bias=1e-9, gyro_scale=1e-9, travel_scale=1e-9,
                                       slip_gain=1e-9))
        drive(blind, 1.2, 0.3, 20.0)
        values.append(error @ np.linalg.solve(blind.pose.cov, error))
    assert np.mean(values) > 30


def measure_clock_error(clock_offset, phase, *, omega, turned, seconds):
    """Yaw error squared and its variance where the IMU's clock and the Nano's differ by a share
    ``clock_offset``: each frame has the newest sample, 0 to 10 ms before its read."""
    odometry = Odometry(OdometryNoise(gyro_noise=1e-5, gyro_bias=1e-9, gyro_scale=1e-9))
    period = 0.01 * (1.0 + clock_offset)
    for k in range(round(seconds / ODOMETRY_PERIOD) + 1):
        now = k * ODOMETRY_PERIOD
        sampled = (math.floor((now - AGE) / period - phase) + phase) * period
        odometry.update(now, 1.2 * now, 1.2, omega(sampled - 0.005) if k else omega(0.0),
                        now - AGE)
    pose = odometry.pose
    return (pose.yaw - turned(seconds))**2, pose.cov[2, 2]


def clocks(share, differences=16, phases=4):
    """Differences of the clocks up to ``share`` and phases of the first sample, spread evenly."""
    return [(share * ((2.0 * k + 1.0) / differences - 1.0), (i + 0.5) / phases + 0.618 * k)
            for k in range(differences) for i in range(phases)]


def bends(seconds):
    turn = 2.0 * math.pi / seconds
    return {"omega": lambda t: 1.2 * math.sin(turn * t) if t > 0.0 else 0.0,
            "turned": lambda t: 1.2 * (1.0 - math.cos(turn * t)) / turn}


@pytest.mark.parametrize("bend", [5.0, 10.0])
@pytest.mark.slow
def test_yaw_is_honest_about_the_age_of_the_gyros_samples(bend):
    """Clocks whose beat meets the bend are among them, as often as they come. A variance by the
    yaw rate instead of its change, (2.5e-3)^2 of it, was too small by a factor of 2.5 in bends of
    5 s and too large by 1.6 in those of 10 s."""
    squares, variances = zip(*(measure_clock_error(*clock, seconds=2.0 * bend, **bends(bend))
                               for clock in clocks(3e-3)), strict=True)
    assert 0.75 < np.sum(squares) / np.sum(variances) < 1.33


def test_clocks_in_step_leave_less_than_the_yaw_deviation():
    """Control: what the test above finds comes from the clocks, not from how it samples."""
    squares, variances = zip(*(measure_clock_error(0.0, phase, seconds=10.0, **bends(5.0))
                               for phase in (0.1, 0.5, 0.9)), strict=True)
    assert max(squares) < 0.02 * min(variances)


def test_the_age_of_a_sample_does_not_matter_in_a_circle():
    """Where the yaw rate stays, an old sample is as good as a new one."""
    square, variance = measure_clock_error(2e-3, 0.3, seconds=10.0, omega=lambda t: 1.2,
                                           turned=lambda t: 1.2 * t)
    _, in_bends = measure_clock_error(2e-3, 0.3, seconds=10.0, **bends(5.0))
    assert square < 1e-4
    assert variance < 0.01 * in_bends


def test_a_short_loss_of_the_gyro_neither_doubles_nor_drops_the_turn():
    odometry = Odometry()
    odometry.update(0.0, 0.0, 1.0, 1.0, -AGE)
    now, at = drive(odometry, 1.0, 1.0, 1.0)
    now, at = drive(odometry, 1.0, 1.0, 0.2, gyro=False, start=now, travelled=at)
    drive(odometry, 1.0, 1.0, 1.0, start=now, travelled=at)
    assert odometry.yaw == pytest.approx(2.2, abs=1e-6)


def test_without_a_gyro_the_yaw_deviation_grows_with_time():
    """A rate that is wrong stays wrong: 0.3 rad/s and more of deviation per second."""
    odometry = Odometry(OdometryNoise())
    for k in range(1, 301):
        t = 0.01 * k
        speed = 0.5
        gyro = 0.4 if k <= 100 else None
        odometry.update(t, speed * t, speed, gyro, t - 0.005, 1.0, 0.4)
        if k == 100:
            known = odometry.pose.cov[2, 2] ** 0.5
    yaw_std = odometry.pose.cov[2, 2] ** 0.5
    assert known < 0.05
    assert 2.0 * 0.3 <= yaw_std <= 2.0 * 0.6


def test_slip_turns_the_path_outwards_in_reverse_as_well():
    """The axle slides away from the centre of the bend whichever way the car drives."""
    def end_of(speed, yaw_rate):
        odometry = Odometry(slip_gain=0.03)
        plain = Odometry()
        for one in (odometry, plain):
            one.update(0.0, 0.0, speed, yaw_rate, -AGE)
            drive(one, speed, yaw_rate, 0.1)
        return odometry.y - plain.y

    forward = end_of(1.0, 1.0)                    # the centre is on the left
    assert forward == pytest.approx(-0.003, rel=0.02)
    assert end_of(-1.0, -1.0) == pytest.approx(forward, rel=0.02), "on the left too"
    assert end_of(-1.0, 1.0) == pytest.approx(-forward, rel=0.02), "on the right"


@pytest.mark.parametrize(("gap", "least", "most"), [
    (0.02, 0.0, 0.0), (0.03, 0.0005, 0.003), (0.1, 0.02, 0.06), (1.0, 0.25, 1.0)])
def test_yaw_over_a_gap_of_frames_is_as_uncertain_as_what_was_not_measured(gap, least, most):
    odometry = Odometry(gyro_bias_std=0.0)
    drive(odometry, 1.0, 0.0, 0.5)
    before = odometry.pose.cov[2, 2]
    step = odometry.update(0.5 + gap, 0.5 + gap, 1.0, 0.0, 0.5 + gap - AGE)
    added = math.sqrt(max(odometry.pose.cov[2, 2] - before - gap * OdometryNoise().gyro_noise**2,
                          0.0))
    assert least <= added <= max(most, 1e-3)
    assert math.sqrt(step.yaw_variance) == pytest.approx(added, abs=1e-3)


def test_a_car_that_is_turned_by_hand_turns_and_its_place_becomes_uncertain():
    odometry = Odometry(gyro_bias_std=0.001)
    drive(odometry, 0.0, 0.0, 1.0)
    assert odometry.pose.cov[0, 0] == 0.0
    drive(odometry, 0.0, 1.5, 1.0, start=1.0)
    drive(odometry, 0.0, 0.0, 1.0, start=2.0)
    assert odometry.yaw == pytest.approx(1.5, abs=0.03)
    assert math.sqrt(odometry.pose.cov[0, 0]) == pytest.approx(0.3, rel=0.1)
    assert odometry.bias.value == pytest.approx(0.0, abs=1e-3), "and no bias is learnt"
