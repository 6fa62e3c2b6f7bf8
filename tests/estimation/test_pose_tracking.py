"""Which external poses are believed, and what is reported while none is."""

from __future__ import annotations

from itertools import pairwise
from math import cos, inf, sin

import numpy as np
import pytest

from dart_hal.core.types import ExternalPose, Pose, Tracking
from dart_hal.estimation.pose_tracking import PoseTracker

FIRST_STAMP = 700.0  # s, the source's clock at the car's zero


def odometry(t, speed=1.0, rate=0.8):
    """Circle from the origin; the variance grows with the way."""
    yaw = rate * t
    spread = 1e-4 * t
    return Pose(speed / rate * sin(yaw), speed / rate * (1.0 - cos(yaw)), yaw,
                np.diag([spread, spread, 1e-5 * t]))


def in_room(t, speed=1.0):
    """The same in a room that lies 2 rad to it."""
    p = odometry(t, speed)
    c = cos(2.0)
    s = sin(2.0)
    return 3.0 + c * p.x - s * p.y, -1.0 + s * p.x + c * p.y, p.yaw + 2.0


def run(seconds, see=lambda t, pose: pose, speed=lambda t: 1.0, latency=0.004, tracker=None):
    """(t, External) of each frame; ``see`` changes what the source sends, None = nothing."""
    tracker = tracker or PoseTracker()
    out = []
    travelled = 0.0
    waiting = []
    for k in range(round(100 * seconds)):
        t = 0.01 * k
        travelled += 0.01 * speed(t)
        pose = see(t, in_room(travelled))
        tracker.update(t, odometry(travelled))
        if pose is not None:
            waiting.append((t + latency, pose))
        while waiting and waiting[0][0] <= t + 0.001:
            arrival, measured = waiting.pop(0)
            tracker.add(ExternalPose(FIRST_STAMP + arrival - latency, arrival, *measured))
        out.append((t, tracker.estimate_at(t), in_room(travelled)))
    return out


def kinds(results):
    """Trackings in order of appearance, without repetition."""
    names = [str(e.tracking) for _, e, _ in results]
    return [a for a, b in zip(names, ["", *names], strict=False) if a != b]


def error(external, true):
    return np.hypot(external.pose.x - true[0], external.pose.y - true[1])


def test_poses_that_fit_are_tracked():
    results = run(4.0)
    assert kinds(results) == ["LOST", "TRACKING"]
    assert results[0][1].age == inf
    assert results[0][1].pose is None
    assert max(error(e, true) for _, e, true in results[10:]) < 0.01
    assert max(e.age for _, e, _ in results[10:]) < 0.03


def test_poses_that_are_older_than_their_stamps_are_where_the_car_was_then():
    """The fit of the clocks cannot see a latency that is always there: a calibration states it."""
    delay = 5
    measured = []

    def late(t, pose):
        measured.append(pose)
        return measured[max(len(measured) - 1 - delay, 0)]

    plain = run(4.0, late)
    known = run(4.0, late, tracker=PoseTracker(latency=0.01 * delay, latency_std=0.02))
    assert min(error(e, true) for _, e, true in plain[50:]) > 0.04, "control: 1 m/s for 50 ms"
    assert max(error(e, true) for _, e, true in known[50:]) < 0.01
    assert {str(e.tracking) for _, e, _ in known[50:]} == {"TRACKING"}
    assert all(e.age > 0.045 for _, e, _ in known[50:])
    added = [np.trace(b.pose.cov[:2, :2] - a.pose.cov[:2, :2])
             for (_, a, _), (_, b, _) in zip(plain[50:], known[50:], strict=True)]
    assert np.sqrt(np.mean(added)) == pytest.approx(0.02, rel=0.2), "1 m/s times its error"


def test_dead_reckoning_goes_on_with_growing_covariance_then_is_lost():
    results = run(12.0, lambda t, pose: pose if t < 3.0 else None)
    assert kinds(results) == ["LOST", "TRACKING", "DEAD_RECKONING", "LOST"]
    blind = [(t, e, true) for t, e, true in results if t > 3.1]
    sizes = [np.trace(e.pose.cov) for _, e, _ in blind]
    assert all(b >= a for a, b in pairwise(sizes))
    assert sizes[-1] > 10 * sizes[0]
    assert all(error(e, true) < 0.02 for _, e, true in blind)
    assert [e.age for _, e, _ in blind] == pytest.approx([t - 2.99 for t, _, _ in blind], abs=0.01)


def test_it_is_tracked_again_after_an_occlusion():
    results = run(6.0, lambda t, pose: None if 2.0 <= t < 3.5 else pose)
    assert kinds(results) == ["LOST", "TRACKING", "DEAD_RECKONING", "TRACKING"]
    assert results[-1][1].tracking is Tracking.TRACKING


def test_a_jump_is_not_believed_and_the_return_is():
    results = run(6.0, lambda t, p: (p[0] + 5.0, p[1], p[2]) if 2.0 <= t < 2.2 else p)
    assert kinds(results) == ["LOST", "TRACKING", "JUMPED", "TRACKING"]
    assert all(error(e, true) < 0.02 for t, e, true in results if t > 0.1)


def test_a_false_lock_that_jitters_is_not_believed_for_as_long_as_it_stays():
    rng = np.random.default_rng(1)
    results = run(10.0, lambda t, p: (-4.97 + rng.normal(0, 1e-3), -0.79 + rng.normal(0, 1e-3), 0.3)
                  if 2.0 <= t < 6.0 else p)
    during = {e.tracking for t, e, _ in results if 2.05 < t < 6.0}
    assert during == {Tracking.JUMPED}
    assert all(error(e, true) < 0.05 for t, e, true in results if t > 0.1)
    assert results[-1][1].tracking is Tracking.TRACKING


def test_a_pose_that_stops_while_the_wheels_turn_is_not_believed():
    held = []

    def freeze(t, pose):
        held.append(pose) if t < 2.0 else None
        return held[-1]

    results = run(4.0, freeze)
    assert results[-1][1].tracking is Tracking.JUMPED
    assert error(results[-1][1], results[-1][2]) < 0.1


def test_a_car_at_rest_may_have_constant_poses():
    results = run(4.0, speed=lambda t: 1.0 if t < 1.0 else 0.0)
    assert kinds(results) == ["LOST", "TRACKING"]


def test_a_car_that_was_carried_is_believed_once_it_has_driven():
    def carry_car(t, p):
        return (p[0] + 2.0, p[1] + 1.0, p[2]) if t >= 2.0 else p

    results = run(6.0, carry_car, speed=lambda t: 0.0 if 1.5 < t < 4.0 else 1.0)
    assert {e.tracking for t, e, _ in results if 2.1 < t < 4.0} == {Tracking.JUMPED}
    back = next(t for t, e, _ in results if t > 4.0 and e.tracking is Tracking.TRACKING)
    assert back - 4.0 < 0.5
    _, last, true = results[-1]
    assert error(last, carry_car(6.0, true)) < 0.02


def test_poses_out_of_order_change_nothing():
    tracker = PoseTracker()
    tracker.update(0.0, odometry(0.0))
    for stamp, x in ((1.0, 0.0), (0.99, 9.0)):
        tracker.add(ExternalPose(stamp, 0.0, x, 0.0, 0.0))
    assert tracker.estimate_at(0.0).tracking is Tracking.TRACKING
    assert tracker.estimate_at(0.0).pose.x == 0.0
    assert tracker.estimate_at(0.0).newest.x == 9.0
