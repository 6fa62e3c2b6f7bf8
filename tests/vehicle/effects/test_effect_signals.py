"""A series and a car in motion see the same signals; laws of what becomes of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dart_hal.core.errors import UsageError
from dart_hal.recording.dart import Grid
from dart_hal.recording.dart.reference import SEP_24
from dart_hal.vehicle import PAPER, make_motor, make_steering, stack
from dart_hal.vehicle.channels import Stepper, transform_signal
from dart_hal.vehicle.delay import delay_series, first_order_lag
from dart_hal.vehicle.effect import SIGNAL_CHANNELS, Now
from dart_hal.vehicle.effects import (
    activate,
    add_effects,
    apply,
    catalogue,
    find_effect,
    parse_effects,
)
from dart_lab.identification.prediction.actuators import actuator_outputs
from tests.vehicle.effects.effect_drive import (
    EFFECT_NAMES,
    PER_TURN,
    SAMPLE_TIME,
    commands,
    medium,
    noise,
)

WITH_SIGNALS = [(n, c) for n in EFFECT_NAMES for c in catalogue()[n].signals]
TWO = {c: ",".join(f"{n}:{catalogue()[n].parameters[0].sizes[1]}" for n, of in WITH_SIGNALS
                   if of == c) for c in SIGNAL_CHANNELS}
"""All effects of a channel at once, as text."""


def step_series(p, channel, signal, now):
    """The series again, one tick after the other."""
    stepper = Stepper(p, channel, SAMPLE_TIME)
    rows = list(zip(*signal, strict=True)) if isinstance(signal, tuple) else signal.tolist()
    out = [stepper(tuple(map(float, row)) if isinstance(row, tuple) else row,
                   Now(*(float(v) for v in here)))
           for row, here in zip(rows, zip(*now, strict=True), strict=True)]
    return np.array(out).T


@pytest.mark.parametrize("name", ["steering_backlash", "steering_rate_limit"])
def test_tick_by_tick_gives_the_series_where_the_signal_is_constant(name):
    """It is not called again until it moves, and not before the state has come to rest."""
    (channel,) = find_effect(name).signals
    p = apply(PAPER, name, **medium(find_effect(name)))
    signal = np.repeat([0.0, 0.3, 0.3, -0.2, -0.21, 0.4], [5, 40, 1, 60, 2, 1])
    now = Now(*[np.zeros(len(signal))] * len(Now._fields))
    got = transform_signal(p, channel, signal, now, SAMPLE_TIME)
    assert (got == step_series(p, channel, signal, now)).all()
    assert len(np.unique(got)) > 4


@pytest.mark.parametrize("k", [0.0, 0.1, 0.5])
@pytest.mark.parametrize("lag", [0.0, 0.05])
def test_a_rate_limit_that_has_caught_up_follows_what_is_slow(k, lag):
    """To the bit, where the series jumps over the samples in which the servo keeps up."""
    rng = np.random.default_rng(5)
    signal = first_order_lag(np.repeat(rng.uniform(-0.9, 0.9, 20), 80), lag)
    signal[400:800] += 0.002 * rng.standard_normal(400)
    p = apply(PAPER, "steering_rate_limit", k=k)
    now = Now(*[np.zeros(len(signal))] * len(Now._fields))
    got = transform_signal(p, "steering", signal, now, SAMPLE_TIME)
    assert (got == step_series(p, "steering", signal, now)).all()
    assert (np.abs(got - signal).max() > 0.1) == (k > 0.0)


@pytest.mark.parametrize("channel", SIGNAL_CHANNELS)
def test_tick_by_tick_gives_the_series_through_all_of_them(channel):
    p = add_effects(PAPER, parse_effects(TWO[channel]))
    signal, now = noise(channel)
    expected = np.array(transform_signal(p, channel, signal, now, SAMPLE_TIME))
    assert np.abs(step_series(p, channel, signal, now) - expected).max() < 1e-12
    assert np.abs(expected - np.array(signal)).max() > 1e-3


@pytest.mark.parametrize("channel", SIGNAL_CHANNELS)
def test_lanes_are_cars_of_their_own(channel):
    """Values per lane, a series (n,) or (n, lanes): each lane as if alone."""
    some = [find_effect(n) for n, c in WITH_SIGNALS if c == channel]
    cars = [add_effects(PAPER, (activate(of, values)
                                for of, values in zip(some, sizes, strict=True)))
            for sizes in ([{}] * len(some), [medium(of, 0) for of in some],
                          [medium(of, 2) for of in some])]
    together = stack(cars)
    for lanes in ((), (3,)):
        signal, now = noise(channel, lanes=lanes)
        got = np.array(transform_signal(together, channel, signal, now, SAMPLE_TIME))
        for i, p in enumerate(cars):
            def lane(rows, i=i):
                return rows[..., i] if np.ndim(rows) == 2 else rows

            mine = tuple(map(lane, signal)) if isinstance(signal, tuple) else lane(signal)
            alone = transform_signal(p, channel, mine, Now(*map(lane, now)), SAMPLE_TIME)
            assert np.abs(got[..., i] - np.array(alone)).max() < 1e-12


def test_without_effects_the_very_same_arrays_come_back():
    u = np.arange(5.0)
    p = apply(PAPER, "gyro_bias", k=0.1)
    for car in (PAPER, p):
        assert transform_signal(car, "wheel", u, Now(), SAMPLE_TIME) is u
        assert not Stepper(car, "wheel", SAMPLE_TIME).active
        assert Stepper(car, "wheel", SAMPLE_TIME)(u, Now()) is u
    assert Stepper(p, "gyro", SAMPLE_TIME).active


@pytest.mark.parametrize("seconds", [0.0, 0.01, 0.03, 0.0125, 0.5, 9.0])
def test_a_delay_is_one_between_samples_too(seconds):
    t = np.arange(200) * SAMPLE_TIME
    line = 3.0 * t + 1.0
    got = delay_series(3.0 * t + 1.0, seconds, SAMPLE_TIME)
    assert got == pytest.approx(np.maximum(line - 3.0 * seconds, 1.0), abs=1e-12)
    assert seconds or np.array_equal(got, line)


def test_early_is_for_recordings_alone():
    p = apply(PAPER, "clock_offset", k=-0.015)
    t = np.arange(100) * SAMPLE_TIME
    assert transform_signal(p, "gyro", 2.0 * t, Now(), SAMPLE_TIME) == pytest.approx(
        np.minimum(2.0 * (t + 0.015), 2.0 * t[-1]), abs=1e-12)
    with pytest.raises(UsageError, match="future"):
        Stepper(p, "gyro", SAMPLE_TIME)
    assert np.array_equal(transform_signal(p, "pose", (t, t, t), Now(), SAMPLE_TIME), (t, t, t))


def test_play_is_a_loop_of_its_width():
    u = 0.2 * np.sin(np.linspace(0.0, 6.0 * math.pi, 3001))
    got = transform_signal(apply(PAPER, "steering_backlash", k=0.06), "angle", u, Now(),
                           SAMPLE_TIME)
    steady = slice(1000, None)
    assert np.abs(got - u)[steady].max() == pytest.approx(0.03, abs=1e-12)
    up = np.diff(u, prepend=u[0]) > 0
    crossing = np.abs(u) < 0.01
    assert (got - u)[steady][(up & crossing)[steady]] == pytest.approx(-0.03, abs=1e-9)
    assert (got - u)[steady][(~up & crossing)[steady]] == pytest.approx(0.03, abs=1e-9)


def test_a_rate_limit_takes_its_time_per_unit_of_command():
    u = np.where(np.arange(200) < 10, -0.4, 0.4)
    got = transform_signal(apply(PAPER, "steering_rate_limit", k=0.5), "steering", u, Now(),
                           SAMPLE_TIME)
    assert np.abs(np.diff(got)).max() == pytest.approx(SAMPLE_TIME / 0.5, rel=1e-9)
    assert got[9 + 40] == pytest.approx(0.4)
    assert got[9 + 38] < 0.37
    assert np.array_equal(got[60:], u[60:])


def test_the_battery_scales_the_force_of_the_motor():
    force = make_motor(PAPER.motor)
    p = apply(PAPER, "battery_fade", k=-0.15)
    for tau in (0.2, 0.4, -0.4):
        now = Now(t=np.array([80.0]))
        late = float(transform_signal(p, "throttle", np.array([tau]), now, SAMPLE_TIME)[0])
        assert force(late, 1.0) == pytest.approx((1.0 - 0.15 * 0.8) * force(tau, 1.0), rel=1e-3)
    assert force(0.0, 1.0) == pytest.approx(0.0, abs=1e-9)


def test_pulses_are_whole_counts_cut_off():
    u = np.linspace(-1.0, 1.0, 20011)
    p = apply(PAPER, "pwm_quantisation", k=0.013)
    s, tau = (transform_signal(p, c, u, Now(), SAMPLE_TIME) for c in ("steering", "throttle"))
    for got, count in ((s, 0.013), (tau, 0.013 * 375.0 / 450.0)):
        assert np.abs(got / count - np.rint(got / count)).max() < 1e-9
        assert (u - got).min() >= -1e-12
        assert (u - got).max() < count + 1e-12
        assert np.mean(u - got) == pytest.approx(0.5 * count, rel=0.05)


# sensors

def ring_of(marks, period, v, seconds=40.0):
    """(reading, turns) of counted marks at the given angles [turns], every 0.1 s at constant v."""
    t = np.arange(1, round(seconds / 0.1)) * 0.1
    turns = t * v / PER_TURN
    marks = np.sort(np.asarray(marks))
    counted = np.floor(turns) * len(marks) + np.searchsorted(marks, turns % 1.0)
    return np.diff(counted) / period * PER_TURN / 0.1, turns[1:]


@pytest.mark.parametrize("v", [0.13, 0.31, 1.7, -0.31])
def test_a_ring_without_a_mark_reads_as_counted(v):
    """200 marks without the first 20: what is counted in 0.1 s, to a count or two."""
    marks = (np.arange(200) + 0.5) / 200.0
    want, turns = ring_of(marks[20:], 200, v)
    p = apply(PAPER, "encoder_ring", missing=0.1)
    got = transform_signal(p, "wheel", np.full(len(turns), v), Now(turns=turns), 0.1)
    quantum = PER_TURN / 200.0 / 0.1
    assert np.abs(got - want).max() < 1.01 * quantum
    assert np.mean(got) == pytest.approx(0.9 * v, rel=0.02)
    assert np.ptp(want) > 1.9 * quantum, "the gap shows"


def test_marks_off_centre_ripple_with_the_turn():
    """Density 1 + e cos(2 pi u): marks at equal steps of its integral."""
    fine = np.linspace(0.0, 1.0, 20001)
    marks = np.interp((np.arange(400) + 0.5) / 400.0,
                      fine + 0.2 * np.sin(2.0 * math.pi * fine) / (2.0 * math.pi), fine)
    want, turns = ring_of(marks, 400, 0.17)
    p = apply(PAPER, "encoder_ring", uneven=0.2)
    got = transform_signal(p, "wheel", np.full(len(turns), 0.17), Now(turns=turns), 0.1)
    assert np.abs(got - want).max() < 1.01 * PER_TURN / 400.0 / 0.1
    turned = transform_signal(apply(PAPER, "encoder_ring", uneven=0.2, phase=0.5), "wheel",
                              np.full(len(turns), 0.17), Now(turns=turns), 0.1)
    assert turned - 0.17 == pytest.approx(0.17 - got, abs=1e-9), "half a turn: the other way"


def test_slip_goes_with_the_force_over_the_mass():
    p = apply(apply(PAPER, "encoder_slip", k=0.02), "mass", k=0.5)
    got = transform_signal(p, "wheel", np.array([2.0, 2.0]), Now(drive=np.array([3.34, -3.34])),
                           SAMPLE_TIME)
    assert got == pytest.approx([2.0 * (1.0 + 0.04 / 1.5), 2.0 * (1.0 - 0.04 / 1.5)])


@pytest.mark.parametrize(("text", "axes"), [
    ("imu_pitch:0.2", ((math.cos(0.2), 0.0, -math.sin(0.2)), (0.0, 1.0, 0.0))),
    ("imu_roll:0.2", ((1.0, 0.0, 0.0), (0.0, math.cos(0.2), math.sin(0.2)))),
    ("imu_yaw:0.2", ((math.cos(0.2), math.sin(0.2), 0.0), (-math.sin(0.2), math.cos(0.2), 0.0)))])
def test_a_turned_imu_sees_force_along_its_own_axes(text, axes):
    """Specific force of the car (a_x, a_y, g) on axes rotated about y, x and z of the body."""
    force = np.array([1.3, -0.7, 9.81])
    got = transform_signal(add_effects(PAPER, parse_effects(text)), "accel",
                           (force[:1], force[1:2]), Now(), SAMPLE_TIME)
    assert [float(v[0]) for v in got] == pytest.approx([float(force @ np.array(a)) for a in axes])


@pytest.mark.parametrize(("name", "x", "y"), [
    ("imu_lever_arm", 0.1, 0.0), ("imu_offset_y", 0.0, 0.1)])
def test_an_imu_measures_the_motion_of_its_own_place(name, x, y):
    """Acceleration of a point on a turning car, by differences of its path."""
    t = np.arange(0.0, 1.0, 1e-4)
    yaw = 0.8 * t + 0.6 * np.sin(2.0 * t)
    path = np.stack([x * np.cos(yaw) - y * np.sin(yaw),
                     x * np.sin(yaw) + y * np.cos(yaw)])
    world = np.gradient(np.gradient(path, t, axis=1), t, axis=1)
    body = np.stack([np.cos(yaw) * world[0] + np.sin(yaw) * world[1],
                     np.cos(yaw) * world[1] - np.sin(yaw) * world[0]])
    omega = 0.8 + 1.2 * np.cos(2.0 * t)
    still = np.zeros(len(t))
    got = transform_signal(apply(PAPER, name, k=x + y), "accel", (still, still),
                           Now(omega=omega, omega_dot=-2.4 * np.sin(2.0 * t)), SAMPLE_TIME)
    assert np.abs(np.array(got) - body)[:, 5:-5].max() < 1e-5


def test_a_marker_turns_with_the_car():
    pose = tuple(np.array([v]) for v in (1.0, 2.0, math.pi / 2))
    p = add_effects(PAPER, parse_effects("mocap_offset_x:0.01,mocap_offset_y:0.02,mocap_yaw:0.03"))
    got = [float(v[0]) for v in transform_signal(p, "pose", pose, Now(), SAMPLE_TIME)]
    assert got == pytest.approx([1.0 - 0.02, 2.0 + 0.01, math.pi / 2 + 0.03])


# commands of a recording

def shape_commands(throttle, steering, p):
    """Commands of a recording as the actuators of the vehicle have them."""
    n = len(throttle)
    unknown = np.full(n, np.nan)
    return actuator_outputs(p, Grid(np.arange(n) * SAMPLE_TIME, *[unknown] * 6, throttle, steering,
                                    unknown, np.zeros(n, dtype=bool), SEP_24), smooth=True)


def test_rollouts_of_recordings_see_the_effects_on_commands():
    t, throttle, steering = commands()
    tau, angle = shape_commands(throttle, steering, PAPER)
    same = shape_commands(throttle, steering, apply(PAPER, "gyro_bias", k=0.1))
    assert np.array_equal(same[0], tau)
    assert np.array_equal(same[1], angle)
    effects = parse_effects("battery_fade:-0.1,steering_trim:0.02")
    got = shape_commands(throttle, steering, add_effects(PAPER, effects))
    assert got[1] == pytest.approx(angle + 0.02, abs=1e-15)
    assert np.abs(got[0] - tau).max() == pytest.approx(0.1 * 0.1 * np.max((tau - 0.15) * t / 10.0),
                                                       rel=0.02)
    late = shape_commands(throttle, steering, apply(PAPER, "steering_delay", k=0.05))[1]
    assert np.array_equal(late[5:], angle[:-5])
    limited = shape_commands(throttle, steering, apply(PAPER, "steering_rate_limit", k=0.5))[1]
    slope = make_steering(PAPER.steering)(0.01) - make_steering(PAPER.steering)(0.0)
    assert np.abs(np.diff(limited)).max() < 2.5 * slope * (SAMPLE_TIME / 0.5) / 0.01


TURNING = {
    "wandering": lambda rng, n: 0.05 * np.cumsum(rng.normal(size=n)),
    "held": lambda rng, n: np.repeat(rng.uniform(-0.4, 0.4, n // 50 + 1), 50)[:n],
    "lagging": lambda rng, n: 0.2 * np.sin(np.arange(n) / 70.0) + 1e-16 * rng.normal(size=n)}


@pytest.mark.parametrize("k", [0.0, 1e-6, 0.05, 0.3])
@pytest.mark.parametrize("name", TURNING)
def test_play_of_a_whole_series_is_that_of_single_steps_to_the_last_bit(name, k):
    for n in (0, 1, 2, 1500):
        signal = TURNING[name](np.random.default_rng(n), n)
        car = apply(PAPER, "steering_backlash", k=k)
        stepper = Stepper(car, "angle", SAMPLE_TIME)
        each = [stepper(v, Now()) for v in signal.tolist()]
        assert np.array_equal(transform_signal(car, "angle", signal, Now(), SAMPLE_TIME), each)
