"""The Kalman filter of the pose: honest, sound for any input, right about poses that come late."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from dart_hal.core.errors import UsageError
from dart_hal.core.types import Pose
from dart_hal.estimation import Odometry, OdometryNoise
from dart_hal.estimation.gyro import CORRELATION_FACTOR, GYRO_QUANTUM
from dart_hal.estimation.odometry import GYRO_LATENCY
from dart_hal.estimation.pose_filter import FILTER_HISTORY, PoseFilter, PoseVerdict
from dart_hal.estimation.pose_model import BIAS, GYRO, RATE, SAMPLE_AGE_NOISE, SLIP, SPEED, TRAVEL

FILTER_PERIOD = 0.01
POSE_EVERY = 0.05
POSE_DELAY = 0.063
POSE_COV = np.diag((0.01**2, 0.01**2, math.radians(0.3)**2))
MONTE_CARLO_RUNS = 40
REST_S = 2.0  # the ESC requires 2 s of neutral anyway


class FilterDrive:
    """A car with drawn errors drives a bent way at 1.2 m/s; poses of it arrive late."""

    def __init__(self, seed, noise=None, seconds=20.0):
        self.noise = n = noise or OdometryNoise()
        self.rng = rng = np.random.default_rng(seed)
        self.bias = n.gyro_bias * rng.standard_normal()
        # yaw rate = (1 + GYRO) (gyro - bias) and speed = (1 + TRAVEL) wheels, in the filter's words
        self.gyro = n.gyro_scale * rng.standard_normal()
        self.travel = n.travel_scale * rng.standard_normal()
        self.slip = n.slip_gain * rng.standard_normal()
        self.frames = round(seconds / FILTER_PERIOD)
        self.path = [(0.0, 0.0, 0.0)]  # every FRAME
        self.travelled = [0.0]
        for k in range(self.frames):
            self._drive(k * FILTER_PERIOD)

    @staticmethod
    def omega(t):
        return 1.2 * math.sin(0.5 * t) + 0.3 if t > 0.0 else 0.0

    def _drive(self, t, speed=1.2):
        x, y, yaw = self.path[-1]
        turn = self.omega(t + FILTER_PERIOD / 2) * FILTER_PERIOD
        ds = speed * FILTER_PERIOD
        aside = self.noise.slip * math.sqrt(ds) * self.rng.standard_normal()
        aside -= self.slip * speed * turn / FILTER_PERIOD * ds
        middle = yaw + turn / 2
        self.path.append((x + ds * math.cos(middle) - aside * math.sin(middle),
                          y + ds * math.sin(middle) + aside * math.cos(middle), yaw + turn))
        ds += self.noise.travel * math.sqrt(ds) * self.rng.standard_normal()
        self.travelled.append(self.travelled[-1] + ds / (1.0 + self.travel))

    def motions(self):
        """(t, motion) as the odometry reads it of the sensors, and the odometry itself."""
        odometry = Odometry(self.noise)
        n = self.noise
        speed = 1.2
        for k in range(-round(REST_S / FILTER_PERIOD), self.frames + 1):
            t = k * FILTER_PERIOD
            t_sample = k * FILTER_PERIOD - 0.014
            if k >= 0:
                noisy = math.hypot(n.gyro_noise, SAMPLE_AGE_NOISE * self.omega(t_sample)
                                   ) / math.sqrt(FILTER_PERIOD) * self.rng.standard_normal()
            elif k % CORRELATION_FACTOR == 0:  # at rest: a quarter is independent
                noisy = math.hypot(n.gyro_noise / math.sqrt(FILTER_PERIOD),
                                   GYRO_QUANTUM / math.sqrt(12.0)
                                   ) * self.rng.standard_normal()
            reading = self.omega(t_sample) / (1.0 + self.gyro) + self.bias + noisy
            yield t, odometry.update(t, self.travelled[max(k, 0)], speed if k > 0 else 0.0,
                                     reading, t - 0.004), odometry

    def pose_at(self, t):
        """The true pose, linear between frames."""
        k = min(max(t / FILTER_PERIOD, 0.0), self.frames - 1e-6)
        a = np.array(self.path[int(k)])
        b = np.array(self.path[int(k) + 1])
        return a + (k - int(k)) * (b - a)

    def pose(self, t):
        """What the motion capture measures at t [s]."""
        return Pose(*(self.pose_at(t) + np.sqrt(np.diag(POSE_COV)) * self.rng.standard_normal(3)),
                    POSE_COV)


def run_filter(drive, *, silent=(), shift_pose=lambda t, pose: pose, late=POSE_DELAY):
    """Yields (t, filter, verdict or None, odometry); no poses between the times of ``silent``."""
    pose_filter = PoseFilter(drive.noise)
    due = 0.0
    for t, motion, odometry in drive.motions():
        pose_filter.predict(*motion)
        verdict = None
        if t >= due + late:
            stamp = due
            due = due + POSE_EVERY
            if not any(start < stamp < end for start, end in silent):
                verdict = pose_filter.correct(shift_pose(stamp, drive.pose(stamp)), t - stamp)
        yield t, pose_filter, verdict, odometry


def nees(estimate, truth):
    error = np.array((estimate.pose.x, estimate.pose.y, estimate.pose.yaw)) - truth
    return float(error @ np.linalg.solve(estimate.pose.cov, error))


def band(degrees=3, runs=MONTE_CARLO_RUNS):
    """Where the mean of so many chi-square values lies with 95 %."""
    return np.array(chi2.interval(0.95, runs * degrees)) / runs


@cache
def ends(noise, poses=True):
    """(RUNS, 2) NEES at the end of each drive: of the pose, of the pose and the four errors."""
    which = [0, 1, 2, BIAS, GYRO, TRAVEL, SLIP]
    values = []
    for seed in range(MONTE_CARLO_RUNS):
        drive = FilterDrive(seed, noise, 6.0)
        for t, pose_filter, _, _ in run_filter(drive, silent=() if poses else [(-1.0, 99.0)]):
            pass
        estimate = pose_filter.estimate()
        error = estimate.mean[which] - (*drive.pose_at(t), drive.bias, drive.gyro, drive.travel,
                                        drive.slip)
        whole = float(error @ np.linalg.solve(estimate.cov[np.ix_(which, which)], error))
        values.append((nees(estimate, drive.pose_at(t)), whole))
    return np.array(values)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [OdometryNoise(), OdometryNoise(gyro_noise=2e-3),
                                   OdometryNoise(gyro_scale=0.002, slip_gain=0.04)],
                         ids=["default", "noisy gyro", "slippery"])
@pytest.mark.parametrize(("column", "degrees"), [(0, 3), (1, 7)])
@pytest.mark.long_except("0-3-noisy gyro", "1-7-slippery")
def test_the_covariance_is_honest(noise, column, degrees):
    low, high = band(degrees)
    assert low < np.mean(ends(noise)[:, column]) < high


@pytest.mark.slow
def test_without_poses_it_is_as_honest_as_dead_reckoning():
    low, high = band()
    assert low < np.mean(ends(OdometryNoise(), poses=False)[:, 0]) < high


@pytest.mark.slow
def test_a_late_pose_taken_for_a_fresh_one_is_not_honest():
    """Control: the same poses, stated as of now."""
    values = []
    for seed in range(10):
        drive = FilterDrive(seed, seconds=4.0)
        pose_filter = PoseFilter(drive.noise)
        due = 0.0
        for t, motion, _ in drive.motions():
            pose_filter.predict(*motion)
            if t >= due + POSE_DELAY:
                pose_filter.correct(drive.pose(due), 0.0)
                due += POSE_EVERY
        values.append(nees(pose_filter.estimate(), drive.pose_at(t)))
    assert np.mean(values) > 3 * band(runs=10)[1]


def test_half_a_second_without_poses_is_survived():
    drive = FilterDrive(1, seconds=6.0)
    worst = 0.0
    for t, pose_filter, verdict, _ in run_filter(drive, silent=[(4.0, 4.5)]):
        if t > 4.0:
            estimate = pose_filter.estimate()
            worst = max(worst, math.dist((estimate.pose.x, estimate.pose.y), drive.pose_at(t)[:2]))
            assert verdict in (None, PoseVerdict.FUSED)
    assert worst < 0.03


def test_outliers_are_gated_and_do_no_harm():
    def shift_pose(t, pose):
        return replace(pose, x=pose.x + 0.5) if round(t / POSE_EVERY) % 4 == 0 else pose

    drive = FilterDrive(2, seconds=6.0)
    errors = {}
    for t, pose_filter, verdict, _ in run_filter(drive, shift_pose=shift_pose):
        if verdict is not None:
            errors.setdefault(round((t - POSE_DELAY) / POSE_EVERY) % 4 == 0, []).append(verdict)
    pose = pose_filter.estimate().pose
    assert set(errors[True]) == {PoseVerdict.OUTLIER}
    assert np.mean([one is PoseVerdict.FUSED for one in errors[False]]) > 0.98
    assert math.dist((pose.x, pose.y), drive.pose_at(t)[:2]) < 0.03


def test_without_the_gate_outliers_do_harm(monkeypatch):
    monkeypatch.setattr("dart_hal.estimation.pose_filter.CHI2_3", math.inf)
    with pytest.raises(AssertionError):
        test_outliers_are_gated_and_do_no_harm()


@pytest.mark.parametrize("age", [0.0, 0.03, 0.0437, 0.2])
def test_a_late_pose_is_as_good_as_one_in_time(age):
    """In any order: the same estimate as if it had been there when it was measured."""
    late = PoseFilter()
    there = PoseFilter()
    total = 40 * FILTER_PERIOD
    done = False
    turned = 0.8 * (total - age)
    pose = Pose(math.sin(turned) / 0.8 + 0.01, (1.0 - math.cos(turned)) / 0.8, turned, POSE_COV)
    for k in range(40):
        late.predict(FILTER_PERIOD, 1.0, 0.8)
        t = (k + 1) * FILTER_PERIOD
        if not done and t >= total - age - 1e-9:
            part = total - age - k * FILTER_PERIOD
            there.predict(part, 1.0, 0.8)
            assert there.correct(pose, 0.0) is PoseVerdict.FUSED
            there.predict(FILTER_PERIOD - part, 1.0, 0.8)
            done = True
        else:
            there.predict(FILTER_PERIOD, 1.0, 0.8)
    assert late.correct(pose, age) is PoseVerdict.FUSED
    assert late.estimate().mean == pytest.approx(there.estimate().mean, abs=1e-9)
    assert late.estimate().cov == pytest.approx(there.estimate().cov, abs=1e-12)


def test_poses_out_of_order_give_what_poses_in_order_give():
    first = Pose(0.1, 0.0, 0.08, POSE_COV)
    second = Pose(0.3, 0.02, 0.24, POSE_COV)
    results = []
    for order in ((first, second), (second, first)):
        pose_filter = PoseFilter()
        for _ in range(40):
            pose_filter.predict(FILTER_PERIOD, 1.0, 0.8)
        for pose in order:
            assert pose_filter.correct(pose, 0.3 if pose is first else 0.1) is PoseVerdict.FUSED
        results.append(pose_filter.estimate())
    assert results[0].mean == pytest.approx(results[1].mean, abs=1e-9)
    assert results[0].cov == pytest.approx(results[1].cov, abs=1e-12)


def test_what_is_too_old_or_of_no_use_changes_nothing():
    pose_filter = PoseFilter()
    for _ in range(100):
        pose_filter.predict(FILTER_PERIOD, 1.0, 0.0)
    before = pose_filter.estimate()
    good = Pose(1.0, 0.0, 0.0, POSE_COV)
    assert pose_filter.correct(good, FILTER_HISTORY + 0.02) is PoseVerdict.TOO_OLD
    skew = POSE_COV + np.diag((1.0, 0.0), 1)
    for pose, age in ((good, -0.1), (good, math.nan), (replace(good, x=math.nan), 0.0),
                      (replace(good, cov=-POSE_COV), 0.0), (replace(good, cov=skew), 0.0),
                      (replace(good, cov=np.ones((3, 3))), 0.0)):
        assert pose_filter.correct(pose, age) is PoseVerdict.UNUSABLE
    for motion in ((math.nan, 1.0, 0.0), (FILTER_PERIOD, 99.0, 0.0),
                   (FILTER_PERIOD, 1.0, math.inf)):
        with pytest.raises(UsageError):
            pose_filter.predict(*motion)
    assert (pose_filter.estimate().mean == before.mean).all()
    assert (pose_filter.estimate().cov == before.cov).all()


def test_a_start_in_another_frame_keeps_what_was_learnt():
    pose_filter = PoseFilter()
    for _ in range(300):
        pose_filter.predict(FILTER_PERIOD, 0.0, 0.01, at_rest=True)
    for _ in range(50):
        pose_filter.predict(FILTER_PERIOD, 1.0, 0.01)
    pose_filter.start(Pose(5.0, 2.0, math.pi / 2, POSE_COV), age=0.1)
    pose = pose_filter.estimate().pose
    assert (pose.x, pose.y, pose.yaw) == pytest.approx((5.0, 2.1, math.pi / 2), abs=1e-3)
    assert pose_filter.estimate().mean[BIAS] == pytest.approx(0.01, abs=1e-3)


def test_an_innovation_of_the_yaw_goes_the_short_way_round():
    pose_filter = PoseFilter()
    pose_filter.start(Pose(0.0, 0.0, 3.13, POSE_COV))
    pose_filter.predict(FILTER_PERIOD, 0.5, 0.0)
    assert pose_filter.correct(Pose(0.0, 0.0, 3.15 - math.tau, POSE_COV), 0.0) is PoseVerdict.FUSED
    assert pose_filter.estimate().pose.yaw == pytest.approx(3.14, abs=0.006)


def test_ahead_is_where_the_car_will_be_if_it_goes_on():
    pose_filter = PoseFilter()
    for _ in range(50):
        pose_filter.predict(FILTER_PERIOD, 1.0, 1.0)
    ahead = pose_filter.estimate(0.04)
    state = pose_filter.estimate()
    for _ in range(4):
        pose_filter.predict(FILTER_PERIOD, 1.0, 1.0)
    then = pose_filter.estimate()
    assert ahead.mean == pytest.approx(then.mean, abs=1e-4)
    assert state.mean[[SPEED, RATE]] == pytest.approx((1.0, 1.0))
    assert ahead.cov[0, 0] > state.cov[0, 0]


def test_the_yaw_rate_is_as_uncertain_as_the_gyro_is_late():
    def rate_std(yaw_acceleration):
        pose_filter = PoseFilter(gyro_bias_std=1e-4)
        for _ in range(10):
            pose_filter.predict(FILTER_PERIOD, 1.0, 0.5, yaw_acceleration=yaw_acceleration)
        return math.sqrt(pose_filter.estimate().cov[RATE, RATE])

    late = GYRO_LATENCY + 0.5 * FILTER_PERIOD
    assert rate_std(2.0) == pytest.approx(math.hypot(rate_std(0.0), 2.0 * late), rel=0.01)


motions = st.tuples(
    st.floats(0.0, 10.0), st.floats(-20.0, 20.0), st.floats(-50.0, 50.0), st.floats(0.0, 100.0),
    st.booleans(), st.booleans())
poses = st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(-10.0, 10.0),
                  st.floats(-9.0, 4.0), st.floats(-9.0, 4.0), st.floats(-0.99, 0.99),
                  st.floats(0.0, 1.0))


@given(st.lists(st.one_of(motions, poses), max_size=60), st.booleans())
def test_the_covariance_stays_positive_definite(events, gated):
    pose_filter = PoseFilter()
    for event in events:
        if len(event) == 6:
            pose_filter.predict(*event)
        else:
            x, y, yaw, a, b, r, age = event
            std = 10.0 ** np.array((a, a, b))
            cov = np.outer(std, std) * [[1, r, 0], [r, 1, 0], [0, 0, 1]]
            if gated:
                pose_filter.correct(Pose(x, y, yaw, cov), age)
            else:
                mean = pose_filter.estimate().pose  # near enough to be believed
                pose_filter.correct(replace(mean, cov=cov), age)
        cov = pose_filter.estimate().cov
        assert np.isfinite(cov).all()
        assert (cov == cov.T).all()
        np.linalg.cholesky(cov)
