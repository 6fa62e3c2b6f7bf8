"""The pair estimator: accuracy rows, direction, noise, restarts."""

from __future__ import annotations

import math
import random

import pytest

from dart_hal.estimation import Ring, WheelSpeed

EVEN_TABLE = {"metres": 0.00206459, "n": 20}
MAGNETS = {"metres": 0.00412918, "n": 10}


def constant(v):
    return (lambda t: v), (lambda t: v * t)


def sine():
    return (lambda t: 1.5 + math.sin(math.pi * t),
            lambda t: 1.5 * t + (1 - math.cos(math.pi * t)) / math.pi)


def braking():
    """2.0 m/s, then 4 m/s2 to rest from t = 2.6 s on."""
    def speed(t):
        return max(2.0 - 4.0 * max(t - 2.6, 0.0), 0.0)

    def travel(t):
        b = min(max(t - 2.6, 0.0), 0.5)
        return 2.0 * min(t, 2.6) + 2.0 * b - 2.0 * b * b

    return speed, travel


@pytest.fixture(scope="module")
def uneven():
    """10 edges: 3 % spacing error, 12 % duty error (marks wider than gaps)."""
    rng = random.Random(1)
    raw = [1 + rng.gauss(0, 0.03) + (0.12 if i % 2 else -0.12) for i in range(10)]
    return [f * 10 / sum(raw) for f in raw]


@pytest.mark.parametrize("v", [0.3, 1.0, 3.0, 5.0])
def test_even_ring_at_constant_speed(speed_run, v):
    assert speed_run(*constant(v), **EVEN_TABLE).rms <= 0.001 * v


@pytest.mark.parametrize(("v", "bar"), [(2.0, 0.03), (0.3, 0.03), (0.04, 0.008)])
def test_uneven_ring_without_table(speed_run, uneven, v, bar):
    assert speed_run(*constant(v), **MAGNETS, true_ring=uneven).rms <= bar


@pytest.mark.parametrize("v", [5.0, 3.0, 2.0, 0.3, 0.04])
@pytest.mark.parametrize("shift", [0, 3, 7])
def test_uneven_ring_with_table_from_any_tooth(speed_run, uneven, v, shift):
    duration = 16.0 if v < 0.1 else 5.0
    run = speed_run(*constant(v), **MAGNETS, true_ring=uneven,
                    table=uneven[shift:] + uneven[:shift], duration=duration)
    assert run.estimator.aligned
    assert run.rms < 1e-3


def test_a_wrong_table_is_not_used(speed_run, uneven):
    wrong = [2 - f for f in uneven[::-1]]
    wrong[0] += 0.3
    wrong = [f * 10 / sum(wrong) for f in wrong]
    run = speed_run(*constant(1.0), **MAGNETS, true_ring=uneven, table=wrong)
    assert not run.estimator.aligned or run.rms < 0.05


@pytest.mark.parametrize(("profile", "bar"), [(sine, 0.03), (braking, 0.04)])
def test_changing_speed_with_table(speed_run, uneven, profile, bar):
    run = speed_run(*profile(), **MAGNETS, true_ring=uneven, table=uneven, duration=4.0)
    assert run.rms <= bar


@pytest.mark.parametrize("profile", [sine, braking])
def test_counts_per_tenth_of_a_second_fail_the_same_bar(speed_run, uneven, profile):
    run = speed_run(*profile(), **MAGNETS, true_ring=uneven, duration=4.0, upstream=True)
    assert run.rms > 0.08


@pytest.mark.parametrize("profile", [sine, braking])
def test_stated_deviation_covers_the_error(speed_run, uneven, profile):
    run = speed_run(*profile(), **MAGNETS, true_ring=uneven, table=uneven, duration=4.0)
    inside = sum(abs(e) <= 2 * s for e, s in zip(run.errors, run.stds, strict=True))
    assert inside >= 0.9 * len(run.errors)


def test_rate_of_the_device_clock_scales_speed_not_travel(wheel):
    ring = wheel(0.002, 20, None, lambda t: 1.0 * t, 2.0)
    plain = WheelSpeed(0.002, 20)
    slow = WheelSpeed(0.002, 20)
    for k in range(1, 200):
        frame = ring.frame(k * 0.01)
        plain.update(*frame, 1.0, 1)
        slow.update(*frame, 1.005, 1)
    assert slow.speed == pytest.approx(plain.speed / 1.005, rel=1e-9)
    assert slow.distance == pytest.approx(plain.distance, abs=0.002)


def test_any_lost_frames_leave_the_mean_speed_exact(wheel):
    ring = wheel(0.002, 20, None, lambda t: 1.0 * t, 2.0)
    estimator = WheelSpeed(0.002, 20)
    rng = random.Random(2)
    errors = [estimator.update(*ring.frame(k * 0.01), 1.0, 1)[0] - 1.0
              for k in range(1, 200) if rng.random() < 0.5]
    assert max(map(abs, errors[3:])) < 1e-3


def test_speed_falls_to_zero_after_the_last_edge(wheel):
    ring = wheel(0.002, 20, None, lambda t: min(t, 1.0), 3.0)
    estimator = WheelSpeed(0.002, 20)
    values = [estimator.update(*ring.frame(k * 0.01), 1.0, 1)[0] for k in range(1, 300)]
    tail = values[105:]
    assert all(v <= 1.05 * 0.002 / (0.01 * (i + 4)) for i, v in enumerate(tail))
    assert values[140:] == [0.0] * len(values[140:])
    assert estimator.distance == pytest.approx(1.0, abs=0.013)


# -- direction -----------------------------------------------------------


def there_and_back(wheel, hint_of):
    """1 m/s forwards, stop at t = 1 s for ``stand`` s, the same way back; frames."""
    def travel(t):
        return min(t, 1.0) + max(t - 2.0, 0.0)

    ring = wheel(0.002, 20, None, travel, 3.0)
    estimator = WheelSpeed(0.002, 20)
    for k in range(1, 300):
        now = k * 0.01
        estimator.update(*ring.frame(now), 1.0, hint_of(now))
    return estimator


def test_direction_follows_the_command_after_a_stop(wheel):
    estimator = there_and_back(wheel, lambda t: 1 if t < 1.5 else -1)
    assert estimator.speed == pytest.approx(-1.0, rel=0.01)
    assert estimator.distance == pytest.approx(0.0, abs=0.03)


def test_direction_is_held_while_the_wheel_turns(wheel):
    ring = wheel(0.002, 20, None, lambda t: t, 1.0)
    estimator = WheelSpeed(0.002, 20)
    for k in range(1, 90):
        estimator.update(*ring.frame(k * 0.01), 1.0, 1 if k < 50 else -1)
        assert estimator.ambiguous == (k >= 50)
    assert estimator.speed == pytest.approx(1.0, rel=0.01)


def test_a_quick_reversal_is_detected_when_the_wheel_speeds_up_again(wheel):
    """1 m/s, -10 m/s2 through zero: no silence long enough to call it a stop."""
    def path(t):
        return t if t < 1.0 else t - 5.0 * (t - 1.0) ** 2

    def travel(t):  # unsigned, as the edges count it
        return path(t) if t < 1.1 else 2 * path(1.1) - path(t)

    ring = wheel(0.002, 20, None, travel, 1.5)
    estimator = WheelSpeed(0.002, 20)
    for k in range(1, 150):
        estimator.update(*ring.frame(k * 0.01), 1.0, 1 if k < 100 else -1)
    assert estimator.speed < -2.5
    assert estimator.distance == pytest.approx(path(1.49), abs=0.03)


def test_a_push_from_standstill_has_no_certain_direction(wheel):
    ring = wheel(0.002, 20, None, lambda t: max(t - 1.0, 0.0), 2.0)
    estimator = WheelSpeed(0.002, 20)
    for k in range(1, 190):
        estimator.update(*ring.frame(k * 0.01), 1.0, 0)
    assert estimator.ambiguous


# -- noise and restarts ---------------------------------------------------


def test_a_burst_of_noise_does_not_become_speed_or_travel(wheel):
    """10 k edges/s for 50 ms on top of 1 m/s."""
    ring = wheel(0.002, 20, None, lambda t: t, 3.0)
    estimator = WheelSpeed(0.002, 20)
    extra = 0
    for k in range(1, 290):
        now = k * 0.01
        count, t_edge, dt, _ = ring.frame(now)
        if 150 < k <= 155:
            extra += 100
            t_edge = now - 1e-5
            dt = 1e-4
        speed, std = estimator.update(count + extra, t_edge, dt, now, 1.0, 1)
        if k > 3:
            assert abs(speed - 1.0) <= max(0.05, std)
    assert estimator.distance == pytest.approx(2.89, abs=0.08)


def test_a_jump_of_the_wheel_rate_loses_no_travel(wheel):
    """A bench test may start at 3 m/s at once: no car does, yet no edge is lost."""
    ring = wheel(0.002, 20, None, lambda t: 3.0 * max(t - 0.5, 0.0), 2.0)
    estimator = WheelSpeed(0.002, 20)
    for k in range(1, 190):
        estimator.update(*ring.frame(k * 0.01), 1.0, 1)
    assert estimator.distance == pytest.approx(3.0 * 1.39, abs=0.06)


def test_restart_goes_on_from_the_same_place(wheel):
    ring = wheel(0.002, 20, None, lambda t: t, 2.0)
    estimator = WheelSpeed(0.002, 20)
    for k in range(1, 150):
        estimator.update(*ring.frame(k * 0.01), 1.0, 1)
    before = estimator.distance
    estimator.update(3, 0.004, 0.002, 0.01, 1.0, 1)
    assert abs(estimator.distance - before) <= 0.002
    for k in range(2, 50):
        estimator.update(*ring.frame(k * 0.01), 1.0, 1)
    assert estimator.speed == pytest.approx(1.0, rel=0.01)
    assert estimator.distance - before == pytest.approx(0.49, abs=0.04)


def test_a_missing_mark_is_absorbed_by_the_table(speed_run):
    """20 edges, both edges of one mark gone: 18, one interval of three."""
    ring = [0.9] * 17 + [2.7]
    metres = 0.00206459 * 20 / 18
    profile = constant(1.0)
    with_table = speed_run(*profile, metres=metres, n=18, true_ring=ring, table=ring[5:] + ring[:5])
    without = speed_run(*profile, metres=metres, n=18, true_ring=ring)
    assert with_table.estimator.aligned
    assert with_table.rms < 1e-3
    assert without.rms > 0.05


def test_table_holds_through_a_reversal(wheel, uneven):
    """2 m forwards, 1 s of rest, back at 1 m/s: the tooth is counted both ways."""
    ring = Ring(MAGNETS["metres"], 10, uneven)
    profile = wheel(**MAGNETS, fractions=uneven, travel=lambda t: min(t, 2.0), duration=3.0)
    behind = ring.edge_at(2.0)
    profile.edges += [3.0 + 2.0 - ring.position(behind - k) for k in range(400)]
    estimator = WheelSpeed(MAGNETS["metres"], 10, uneven)
    errors = []
    for k in range(1, 450):
        now = 0.01 * k
        speed, _ = estimator.update(*profile.frame(now), 1.0, 1 if now < 2.5 else -1)
        if now > 3.2:
            errors.append(abs(speed + 1.0))
    assert estimator.aligned
    assert max(errors) < 1e-3
    assert estimator.distance == pytest.approx(2.0 - 1.49, abs=0.03)


def test_a_driven_wheel_that_shows_no_edge_yet_may_turn():
    """Within one gap: at 4 m/s2 a car is at 0.18 m/s when its first edge comes."""
    estimator = WheelSpeed(EVEN_TABLE["metres"], EVEN_TABLE["n"])
    gap = EVEN_TABLE["metres"]
    stds = []
    for k in range(100):
        _, std = estimator.update(0, -1.0, 0.0, 0.01 * k, hint=int(k >= 50))
        stds.append(estimator.add_undetected_motion(std, None))
    assert stds[49] < 0.003, "no throttle: at rest"
    assert max(stds) == pytest.approx(math.sqrt(2.0 * 5.0 * gap / 3.0), rel=0.4)
    assert stds[-1] < 0.01, "a throttle in its dead band: no edge for half a second"


def test_braking_moves_the_speed_away_from_the_middle_of_its_pair():
    estimator = WheelSpeed(EVEN_TABLE["metres"], EVEN_TABLE["n"])
    for k in range(1, 30):
        speed, std = estimator.update(5 * k, 0.01 * k, 0.002, 0.01 * k, hint=1)
    assert speed == pytest.approx(1.03, abs=0.01)
    assert estimator.add_undetected_motion(std, -1.0) == std
    assert estimator.add_undetected_motion(std, -6.0) > 2.0 * std


def test_a_wheel_that_was_slow_against_the_command_may_turn_the_other_way():
    estimator = WheelSpeed(EVEN_TABLE["metres"], EVEN_TABLE["n"])
    t = count = 0
    for speed in (1.03, 0.8, 0.5, 0.2):
        edges = max(round(speed * 0.01 / EVEN_TABLE["metres"]), 1)
        for _ in range(5):
            t += 0.01
            count += edges
            found, std = estimator.update(count, t, 0.01 / edges, t, hint=-1 if speed < 1.0 else 1)
        estimator.correct_direction(1)
        wide = estimator.add_undetected_motion(std, None)
        assert estimator.may_have_reversed == (speed < 0.3)
        assert wide == (max(std, abs(found)) if speed < 0.3 else std)
