"""A hidden effect shows in the host's numbers by as much as by its equation."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dart_hal.vehicle import GRAVITY, PAPER, make_friction, make_motor, make_steering
from dart_hal.wire.codec import encode
from dart_hal.wire.messages import EDGES_REQ

STRAIGHT = -PAPER.steering.s0
NANOS = ["mock", pytest.param("avr", marks=pytest.mark.emulator)]
STEADY = (STRAIGHT, 0.3, 8.0)
TURN = ((STRAIGHT, 0.3, 1.0), (0.6, 0.3, 1.0))
ROLL = ((STRAIGHT, 0.3, 2.5),)
BEGIN = 2.2


@pytest.fixture
def pair(driven):
    """``pair(effects, plan, more="")``: the same drive without and with the effects."""
    def drive(effects, plan, more="&nano=mock"):
        url = f"sim://?seed=0{more}"
        return driven(url, plan), driven(f"{url}&effect={effects}", plan)

    return drive


def rise(t, signal, start, share=0.5):
    """When the signal has gone that share of its way from ``start`` [s] on."""
    after = t >= start
    t, y = t[after], np.asarray(signal)[after]
    level = y[0] + share * (y[-1] - y[0])
    k = int(np.argmax((y - level) * np.sign(y[-1] - y[0]) > 0))
    return float(np.interp(level, sorted(y[k - 1:k + 1]), t[k - 1:k + 1]))


def late(one, other, share=0.5, start=BEGIN + 1.0):
    """By how much the yaw rate of the other answers later [s]."""
    return rise(other.t, other.gyro, start, share) - rise(one.t, one.gyro, start, share)


def when_counted(changed, edges):
    return np.interp(edges, changed.edges, changed.t)


# -- command ------------------------------------------------------------------

@pytest.mark.slow
def test_steering_delay_shifts_the_answer(pair):
    assert late(*pair("steering_delay:0.08", TURN)) == pytest.approx(0.08, abs=2e-3)


@pytest.mark.slow
def test_throttle_delay_shifts_the_start(pair):
    plain, changed = pair("throttle_delay:0.12", ROLL)
    edges = np.array([5.0, 50.0, 300.0])
    shift = when_counted(changed, edges) - when_counted(plain, edges)
    assert shift == pytest.approx([0.12] * 3, abs=2e-3)


@pytest.mark.parametrize("nano", NANOS)
@pytest.mark.slow
def test_pwm_clock_stretches_every_pulse_and_steers_left(pair, nano):
    plain, changed = pair("pwm_clock:0.01", ROLL, f"&nano={nano}")
    for (_, one, width), (_, other, longer) in zip(plain.pulses[:60], changed.pulses, strict=False):
        assert one == other
        assert longer == pytest.approx(1.01 * width, rel=1e-9)
    fast = plain.rows_between(4.0, 9.0), changed.rows_between(4.0, 9.0)
    assert abs(np.mean(plain.gyro[fast[0]])) < 0.03
    assert np.mean(changed.gyro[fast[1]]) > 0.15


@pytest.mark.slow
def test_pwm_quantisation_makes_stairs(driven):
    """Two commands within one step of 0.2 turn the same circle."""
    circles = [driven(f"sim://?nano=mock&physics=kinematic{effect}", ((s, 0.3, 1.5),))
               for effect in ("", "&effect=pwm_quantisation:0.2") for s in (0.45, 0.55)]
    plain, finer, one, same = (np.mean(c.gyro[-20:]) for c in circles)
    assert one == pytest.approx(same, abs=3e-3)
    assert finer > plain + 0.1


# -- actuator -----------------------------------------------------------------

def step(pair, effect, size, share):
    """Delay of the answer of a rolling car without slip to a step of the steering."""
    plan = (STEADY, (STRAIGHT + size, 0.3, 1.0))
    pair = pair(effect, plan, "&nano=mock&physics=kinematic")
    return late(*pair, share, BEGIN + 8.0)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.1, 0.5, 0.8])
def test_steering_lag_rounds_the_answer(pair, share):
    """1 - exp(-t/T) against the servo's ramp of 20 ms."""
    expected = -0.12 * math.log(1.0 - share) - share * 0.02
    assert step(pair, "steering_lag:0.12", 0.2, share) == pytest.approx(expected, abs=0.015)


@pytest.mark.parametrize("size", [0.1, 0.2])
@pytest.mark.slow
def test_steering_rate_limit_takes_longer_for_a_large_step(pair, size):
    expected = 0.5 * size * (0.5 - 1.0 / 10.2)
    assert step(pair, "steering_rate_limit:0.5", size, 0.5) == pytest.approx(expected, abs=0.006)


@pytest.mark.parametrize("nano", NANOS)
@pytest.mark.slow
def test_steering_trim_turns_a_straight_drive(pair, nano):
    plain, changed = pair("steering_trim:0.02", ROLL, f"&physics=kinematic&nano={nano}")
    end = changed.t > changed.t[-1] - 0.2
    speed = np.mean(changed.speed[-20:])
    assert abs(np.mean(plain.gyro[end])) < 0.02
    turned = np.mean(changed.gyro[end]) - np.mean(plain.gyro[end])
    assert turned == pytest.approx(speed * math.tan(0.02) / 0.175, rel=0.03)


@pytest.mark.slow
def test_steering_backlash_remembers_the_side_it_came_from(driven):
    def split(effect):
        url = f"sim://?nano=mock&physics=kinematic{effect}"
        left, right = (driven(url, ((side, 0.3, 1.0), (STRAIGHT, 0.3, 0.8)))
                       for side in (0.7, -0.7))
        speed = np.mean(left.speed[-20:])
        return (np.mean(left.gyro[-20:]) - np.mean(right.gyro[-20:])) * 0.175 / speed

    assert split("") == pytest.approx(0.0, abs=2e-3)
    assert split("&effect=steering_backlash:0.1") == pytest.approx(0.1, abs=5e-3)


@pytest.mark.slow
def test_a_dead_zone_leaves_the_wheels_straight_from_either_side(driven):
    slight = 0.03  # of command: 0.018 rad at the wheels, within half of the zone
    def turned(side, effect):
        changed = driven(f"sim://?nano=mock&physics=kinematic{effect}",
                         ((side, 0.3, 1.0), (STRAIGHT + slight, 0.3, 0.8)))
        return np.mean(changed.gyro[-20:]) * 0.175 / np.mean(changed.speed[-20:])

    angle = make_steering(PAPER.steering)(STRAIGHT + slight)
    for side in (0.7, -0.7):
        assert turned(side, "") == pytest.approx(math.tan(angle), abs=2e-3)
        assert turned(side, "&effect=steering_dead_zone:0.05") == pytest.approx(0.0, abs=2e-3)


@pytest.mark.slow
def test_motor_saturation_gives_no_more_for_more(driven):
    def speeds(effect):
        return [driven(f"sim://?nano=mock{effect}", ((STRAIGHT, tau, 1.5),)).counted_distance(0, 9)
                for tau in (0.3, 0.4)]

    free, held = speeds(""), speeds("&effect=motor_saturation:4")
    assert free[1] > 1.3 * free[0]
    assert held[1] == pytest.approx(held[0], abs=0.01)


@pytest.mark.slow
def test_battery_fade_is_of_the_time_in_the_world(driven):
    """The same start from standstill, at once and after 20 s: 0.9 of the force."""
    def later(effect):
        url = f"sim://?nano=mock&physics=kinematic{effect}"
        soon = driven(url, ((STRAIGHT, 0.3, 1.0),)).counted_distance(0.0, 60.0)
        return driven(url, ((STRAIGHT, 0.0, 20.0),
                            (STRAIGHT, 0.3, 1.0))).counted_distance(0.0, 60.0) / soon

    assert later("") == pytest.approx(1.0, abs=0.04)       # a frame of the PWM sooner or later
    assert later("&effect=battery_fade:-0.5") < 0.92


# -- force, motion --------------------------------------------------------------

@pytest.mark.slow
def test_quadratic_drag_balances_the_motor_at_a_lower_speed(pair):
    plain, changed = pair("quadratic_drag:0.2", ((STRAIGHT, 0.3, 9.0),))
    motor, friction = make_motor(PAPER.motor), make_friction(PAPER.friction)
    tau = changed.car.world.esc.throttle
    grid = np.linspace(0.5, 3.0, 2501)
    for car, k in ((plain, 0.0), (changed, 0.2)):
        force = [motor(tau, v) + friction(v) - k * v * v for v in grid]
        assert np.mean(car.speed[-50:]) == pytest.approx(
            float(np.interp(0.0, force[::-1], grid[::-1])), rel=0.01)


@pytest.mark.slow
def test_a_slope_is_measured_at_rest_and_rolls_the_car(pair):
    plain, changed = pair("road_slope_x:1.0,rolling_resistance:-1", ((STRAIGHT, 0.0, 1.0),))
    assert np.mean(changed.accel_x[50:150]) < -0.4
    assert changed.edges[-1] > plain.edges[-1] == 0


@pytest.mark.slow
def test_lateral_pull_turns_by_its_sign(driven):
    left, plain, right = (driven(f"sim://?nano=mock{e}", ROLL).gyro[-30:].mean() for e in (
        "&effect=lateral_pull:0.03", "", "&effect=lateral_pull:-0.03"))
    assert left > plain + 0.05
    assert right < plain - 0.05


@pytest.mark.slow
def test_mass_is_on_the_scale_and_in_the_start(pair):
    plain, changed = pair("mass:0.2", ROLL)
    kilograms = [c.car.backend.workshop.mass()[0] for c in (plain, changed)]
    assert kilograms[1] / kilograms[0] == pytest.approx(1.2, abs=0.005)
    assert changed.counted_distance(2.2, 3.0) < 0.92 * plain.counted_distance(2.2, 3.0)


@pytest.mark.slow
def test_a_weight_further_back_is_a_lighter_front_axle(pair):
    front = [c.car.backend.workshop.axle_loads()[0] for c in pair("centre_of_mass:-0.012", ROLL)]
    assert front[1] - front[0] == pytest.approx(-1.67 * 0.012 / 0.175, abs=0.008)


# -- measurement ------------------------------------------------------------------

def intervals(url, raw_car):
    """Ticks between 40 successive edges of a car at steady speed, requested by the host."""
    car = raw_car(url).arm().drive(STRAIGHT, 0.3, 4.0)
    car.backend.link.write(encode(EDGES_REQ, 0, (5,)))
    car.run(1.0)
    return np.array([f.values()[2:] for f in car.frames_named("EDGES")], dtype=float).ravel()


@pytest.mark.slow
@pytest.mark.parametrize("nano", NANOS)
def test_a_missing_tooth_is_counted_by_the_nano(pair, raw_car, nano):
    plain, changed = pair("encoder_ring:missing=0.1", ROLL, f"&nano={nano}")
    assert changed.counted_distance(0, 9) == pytest.approx(0.9 * plain.counted_distance(0, 9),
                                                           abs=0.01)
    url = f"sim://?nano={nano}"
    even, gap = (intervals(url + e, raw_car) for e in ("", "&effect=encoder_ring:missing=0.1"))
    assert even.max() < 1.1 * np.median(even)
    assert gap.max() == pytest.approx(3.0 * np.median(gap), rel=0.05)
    assert np.diff(np.flatnonzero(gap > 2.0 * np.median(gap))).tolist() in ([18], [18, 18])


@pytest.mark.parametrize(("missing", "counted"), [(0.05, 0.95), (0.2, 0.8), (-0.1, 1.1)])
@pytest.mark.parametrize("nano", NANOS)
@pytest.mark.slow
def test_marks_go_one_by_one_and_come_twice(pair, missing, counted, nano):
    plain, changed = pair(f"encoder_ring:{missing}", ROLL, f"&nano={nano}")
    assert changed.counted_distance(0, 9) == pytest.approx(counted * plain.counted_distance(0, 9),
                                                           abs=0.01)


@pytest.mark.slow
def test_an_uneven_ring_ripples_and_keeps_its_mean(pair, raw_car):
    plain, changed = pair("encoder_ring:uneven=0.2", ROLL)
    assert changed.counted_distance(0, 9) == pytest.approx(plain.counted_distance(0, 9), abs=0.005)
    found = intervals("sim://?nano=mock&effect=encoder_ring:uneven=0.2", raw_car)
    assert found.max() / found.min() == pytest.approx(1.5, rel=0.05)


@pytest.mark.slow
def test_the_phase_of_the_ring_is_where_the_gap_comes(driven):
    first = [driven(f"sim://?nano=mock&effect=encoder_ring:missing=0.5:phase={phase}",
                    ((STRAIGHT, 0.16, 2.0),)) for phase in (0.0, 0.5)]
    gap_first, gap_later = (when_counted(changed, 1.0) for changed in first)
    assert gap_first > gap_later + 0.05


@pytest.mark.slow
def test_encoder_scale_and_slip(pair):
    plain, scaled = pair("encoder_scale:0.04", ROLL)
    assert scaled.counted_distance(0, 9) == pytest.approx(1.04 * plain.counted_distance(0, 9),
                                                          abs=0.004)
    plain, slipping = pair("encoder_slip:0.04", ((STRAIGHT, 0.5, 0.6), (STRAIGHT, 0.0, 0.6)))
    pulling, braking = (slipping.counted_distance(*w) / plain.counted_distance(*w)
                        for w in ((2.3, 2.8), (2.95, 3.35)))
    assert pulling > 1.05
    assert braking < 0.99


@pytest.mark.slow
def test_encoder_latency_makes_every_edge_late_and_no_other_sensor(pair):
    plain, changed = pair("encoder_latency:0.06", TURN)
    edges = np.array([10.0, 200.0, 600.0])
    assert when_counted(changed, edges) - when_counted(plain, edges) == pytest.approx(
        [0.06] * 3, abs=2e-3)
    assert np.array_equal(changed.gyro, plain.gyro)


@pytest.mark.slow
def test_a_clock_offset_is_of_all_sensors(pair):
    plain, changed = pair("clock_offset:0.06", TURN)
    assert late(plain, changed) == pytest.approx(0.06, abs=2e-3)
    assert when_counted(changed, 500.0) - when_counted(plain, 500.0) == pytest.approx(0.06,
                                                                                      abs=2e-3)
    k = 6                                           # frames of 10 ms
    assert changed.accel_y[k + 250:] == pytest.approx(plain.accel_y[250:-k], abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("nano", NANOS)
def test_gyro_bias_shows_at_rest(pair, nano):
    plain, changed = pair("gyro_bias:0.05", ((STRAIGHT, 0.0, 0.5),), f"&nano={nano}")
    still = changed.rows_between(1.5, 2.5)
    assert np.mean(plain.gyro[still]) == pytest.approx(0.0, abs=6e-4)
    assert np.mean(changed.gyro[still]) == pytest.approx(0.05, abs=6e-4)


@pytest.mark.slow
def test_gyro_scale_and_latency(pair):
    plain, changed = pair("gyro_scale:0.06,gyro_latency:0.08", TURN)
    assert changed.gyro[-1] == pytest.approx(1.06 * plain.gyro[-1], rel=0.01)
    assert late(plain, changed) == pytest.approx(0.08, abs=3e-3)
    assert np.array_equal(changed.edges, plain.edges)


@pytest.mark.parametrize("nano", NANOS)
@pytest.mark.slow_except("mock")
def test_a_tilted_imu_measures_gravity_and_turns_its_axes(pair, nano):
    plain, changed = pair("imu_pitch:0.1,imu_roll:0.05", TURN, f"&nano={nano}")
    still = changed.rows_between(1.5, 2.2)
    leak = [np.mean(s[still]) - np.mean(p[still]) for s, p in (
        (changed.accel_x, plain.accel_x), (changed.accel_y, plain.accel_y))]
    assert leak == pytest.approx(
        [-GRAVITY * math.sin(0.1), GRAVITY * math.cos(0.1) * math.sin(0.05)], abs=0.02)
    gyro = changed.car.frames_named("STATE")[-1].as_si()["gyro"]
    assert gyro[0] == pytest.approx(-plain.gyro[-1] * math.sin(0.1), abs=0.01)


@pytest.mark.slow
def test_lever_arm_and_yaw_of_the_imu(pair):
    plain, ahead = pair("imu_lever_arm:0.1", TURN)
    assert np.mean(ahead.accel_x[-20:] - plain.accel_x[-20:]) == pytest.approx(
        -0.1 * np.mean(plain.gyro[-20:])**2, abs=0.03)
    plain, turned_imu = pair("imu_yaw:0.1", TURN)
    mixed = plain.accel_x * math.cos(0.1) + plain.accel_y * math.sin(0.1)
    assert turned_imu.accel_x[-20:] == pytest.approx(mixed[-20:], abs=0.03)
    assert np.array_equal(turned_imu.gyro, plain.gyro)
