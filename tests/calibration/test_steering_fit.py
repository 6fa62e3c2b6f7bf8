"""The estimators on made-up samples whose truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.calibration.curves import steering
from dart_hal.calibration.loop import Systematic, Window, contact, fit_loop, resample
from dart_hal.calibration.samples import Samples, approach, blocks, concatenate
from dart_hal.calibration.schedule import (
    Leg,
    Spot,
    make_plan,
    make_steps,
    trace,
    waiting_time,
)
from dart_hal.calibration.steering_fit import fit_steering
from dart_hal.calibration.steering_map import fit_map
from dart_hal.core.errors import CalibrationFailed
from dart_hal.devices.actuation.quantiser import count_us, prescale_for

TRUTH = np.array([1.5, 0.35, 0.01, 0.40, 1.4])


def held(rng, block_noise=0.01, noise=0.015, levels=41, length=30, backlash=0.0) -> Samples:
    """Levels driven up and down; each held run has an error of its own."""
    up = np.linspace(-1.0, 1.0, levels)
    runs = np.concatenate([up, up[::-1]])
    side = np.repeat([1.0, -1.0], levels)
    command = np.repeat(runs, length)
    direction = np.repeat(side, length)
    shared = np.repeat(rng.normal(0.0, block_noise, 2 * levels), length)
    angle = (steering(TRUTH, command)[0] - direction * backlash / 2.0 + shared
             + rng.normal(0.0, noise, len(command)))
    age = np.tile(0.1 * np.arange(length), 2 * levels)
    return Samples(command, angle, direction, age, np.ones(len(command)),
                   np.repeat(np.arange(2 * levels), length))


def test_jacobian_is_the_slope_of_the_curve():
    s = np.linspace(-1.0, 1.0, 21)
    step = np.array([1e-3, 0.0, 0.0, 0.0, 0.0])
    exact = (steering(TRUTH + step, s)[0] - steering(TRUTH, s)[0]) / 1e-3
    assert steering(TRUTH, s)[1][:, 0] == pytest.approx(exact, abs=1e-4)


def test_form_is_recovered_without_noise():
    samples = held(np.random.default_rng(0), 0.0, 0.0)
    assert fit_map(samples).parameters == pytest.approx(TRUTH, rel=2e-4)


@pytest.mark.slow
def test_standard_errors_hold_over_repeats_although_samples_are_not_independent():
    at = np.linspace(-0.9, 0.9, 9)
    inside, naive_inside = [], []
    for seed in range(40):
        samples = held(np.random.default_rng(seed))
        fitted = fit_map(samples)
        error = fitted.angle(at) - steering(TRUTH, at)[0]
        inside += list(np.abs(error) < 1.645 * fitted.std(at))
        jac = steering(fitted.parameters, samples.command)[1]
        residual = samples.angle - fitted.angle(samples.command)
        naive = np.linalg.inv(jac.T @ jac) * residual.var()
        slope = steering(fitted.parameters, at)[1]
        naive_std = np.sqrt(np.einsum("ni,ij,nj->n", slope, naive, slope))
        naive_inside += list(np.abs(error) < 1.645 * naive_std)
    assert 0.82 <= np.mean(inside) <= 0.97
    assert np.mean(naive_inside) < 0.7  # what independent samples would have claimed


def test_misfit_of_the_form_widens_the_interval():
    samples = held(np.random.default_rng(1))
    bent = Samples(samples.command, samples.angle + 0.02 * np.sin(9.0 * samples.command),
                   samples.direction, samples.age, samples.weight, samples.block)
    assert fit_steering(bent).misfit > 0.009
    assert fit_steering(samples).misfit < 0.009
    assert fit_steering(bent).angle_std.min() > 0.009


def test_backlash_from_both_approaches():
    found = fit_steering(held(np.random.default_rng(2), backlash=0.03)).backlash
    assert found.value == pytest.approx(0.03, abs=3.0 * found.std)
    assert found.std < 0.006
    none = fit_steering(held(np.random.default_rng(3))).backlash
    assert none.value < 3.0 * none.std


def test_backlash_needs_levels_from_both_sides():
    samples = held(np.random.default_rng(4), backlash=0.03)
    up = samples.direction > 0
    one_way = Samples(*(getattr(samples, f)[up] for f in Samples.__dataclass_fields__))
    assert fit_steering(one_way).backlash is None


def test_lag_right_after_a_change_is_not_backlash():
    samples = held(np.random.default_rng(5), length=6)
    assert np.all(samples.age < 0.6)
    assert fit_steering(samples).backlash is None


def test_too_few_levels_are_refused():
    with pytest.raises(CalibrationFailed, match="too little"):
        fit_steering(held(np.random.default_rng(6), levels=3))


def test_reversed_sign_is_refused():
    samples = held(np.random.default_rng(7))
    turned = Samples(samples.command, -samples.angle, samples.direction, samples.age,
                     samples.weight, samples.block)
    with pytest.raises(CalibrationFailed, match="does not increase"):
        fit_steering(turned)


def test_runs_of_a_command_are_blocks():
    command = np.repeat([0.1, 0.2, 0.3], [20, 3, 20])
    assert list(np.unique(blocks(command, np.zeros(43, dtype=np.int64)))) == [0, 1]
    sine = np.sin(np.arange(400) * 0.05)
    assert len(np.unique(blocks(sine, np.zeros(400, dtype=np.int64)))) == 8
    segment = np.repeat([0, 1], 20)
    assert len(np.unique(blocks(np.full(40, 0.1), segment))) == 2


def test_blocks_stay_separate_when_files_are_pooled():
    one = held(np.random.default_rng(8), levels=5)
    assert len(np.unique(concatenate([one, one]).block)) == 2 * len(np.unique(one.block))


def test_approach_and_age():
    direction, age = approach(np.array([0.0, 0.0, 0.1, 0.1, 0.05, 0.05]), 0.1 * np.arange(6))
    assert list(direction) == [0.0, 0.0, 1.0, 1.0, -1.0, -1.0]
    assert age == pytest.approx([0.0, 0.1, 0.0, 0.1, 0.0, 0.1])


def windows(backlash: float, kappa: float, speeds=(0.35, 0.55), noise=0.0, levels=13):
    """Windows of a wheel that follows as a peg in a slot."""
    rng = np.random.default_rng(9)
    s = np.linspace(-1.0, 1.0, levels)
    order = [*range(levels), *range(levels - 1, -1, -1)]
    moved, side = contact(np.array(order), steering(TRUTH, s)[0], backlash, -1.0)
    out, before = [], 0.0
    for i, k in enumerate(order):
        v = speeds[0] if i < levels else speeds[1]
        wheel = steering(TRUTH, s)[0][moved[i]] - side[i] * backlash / 2.0
        angle = np.arctan(np.tan(wheel) / (1.0 + kappa * v * v)) + rng.normal(0.0, noise)
        direction = np.sign(s[k] - before) or out[-1].direction
        out.append(Window(s[k], 1500.0 + 375.0 * s[k], angle, max(noise, 1e-4), v,
                          v * np.tan(angle) / 0.175, direction, 70, 0.7))
        before = s[k]
    return out


@pytest.mark.parametrize("backlash", [0.0, 0.005, 0.02, 0.05])
@pytest.mark.parametrize("kappa", [0.0, 0.04, 0.08])
def test_loop_separates_map_backlash_and_slip(backlash, kappa):
    fitted = fit_loop(windows(backlash, kappa), 0.175, Systematic(0.0, 0.0))
    assert fitted.angle == pytest.approx(steering(TRUTH, fitted.command)[0], abs=1.5e-3)
    assert fitted.backlash.value == pytest.approx(backlash, abs=1.5e-3)
    assert fitted.kappa.value == pytest.approx(kappa, abs=6e-3)


@pytest.mark.slow
def test_the_servos_spread_is_not_underestimated():
    """Sixty servos that rest 1 us from their targets; two windows a level show little of it."""
    rng, estimates = np.random.default_rng(1), []
    for _ in range(60):
        both = windows(0.02, 0.04, noise=0.0)
        slope = steering(TRUTH, np.array([w.command for w in both]) + 1e-3)[0]
        slope -= steering(TRUTH, np.array([w.command for w in both]))[0]
        offset = rng.normal(size=len(both)) * slope / (1e-3 * 375.0)
        moved = [replace(w, angle=w.angle + float(e), std=2e-4)
                 for w, e in zip(both, offset + 2e-4 * rng.normal(size=len(both)), strict=True)]
        estimates.append(fit_loop(moved, 0.175, Systematic(0.0, 0.0)).rest_us)
    assert 0.97 < np.sqrt(np.mean(np.square(estimates))) < 1.2


def test_one_way_only_would_be_wrong_by_half_the_backlash():
    both = windows(0.04, 0.0)
    fitted = fit_loop(both, 0.175, Systematic(0.0, 0.0))
    rising = np.array([w.angle for w in both[3:10]])
    assert np.abs(rising - steering(TRUTH, fitted.command[3:10])[0]).min() > 0.018
    assert np.abs(fitted.angle - steering(TRUTH, fitted.command)[0]).max() < 2e-3


def test_common_errors_are_in_the_covariance():
    fitted = fit_loop(windows(0.02, 0.04), 0.175, Systematic(0.02, 0.0))
    expected = 0.5 * np.abs(np.sin(2.0 * fitted.angle)) * 0.02
    assert np.all(fitted.std >= expected * 0.999)
    ends = fitted.covariance[0, -1] / (fitted.std[0] * fitted.std[-1])
    assert ends < -0.9  # a wrong wheel travel moves both ends outwards together


def test_contact_holds_the_wheel_inside_the_slot():
    delta = np.linspace(-0.3, 0.3, 7)
    moved, side = contact(np.array([0, 1, 2, 3, 2, 1, 0]), delta, 0.15, 1.0)
    assert list(side) == [1, 1, 1, 1, 1, -1, -1]
    assert list(moved) == [0, 1, 2, 3, 3, 1, 0]


def test_servo_that_has_reached_its_end_is_refused():
    stuck = [Window(w.command, w.pulse_us, w.angle - 0.25 * max(w.command - 0.5, 0.0), w.std,
                    w.speed, w.yaw_rate, w.direction, w.n, w.duration)
             for w in windows(0.0, 0.0)]
    with pytest.raises(CalibrationFailed, match="does not increase"):
        fit_loop(stuck, 0.175, Systematic(0.0, 0.0))


def test_resampling_between_levels_keeps_the_curve():
    fitted = fit_loop(windows(0.0, 0.0), 0.175, Systematic(0.0, 0.0))
    at = np.linspace(-1.0, 1.0, 41)
    pulse, angle, covariance = resample(fitted, at)
    assert np.degrees(np.abs(angle - steering(TRUTH, at)[0])).max() < 0.15
    assert pulse == pytest.approx(1500.0 + 375.0 * at)
    assert np.all(np.diag(covariance) > 0.0)


@pytest.mark.parametrize("hertz", [24.25e6, 25e6, 26.1e6])
@pytest.mark.parametrize("direction", [1, -1])
def test_pulses_are_whole_counts(hertz, direction):
    count = count_us(prescale_for(50.0), hertz)
    steps = make_steps(center_us=1560.0, span_us=375.0, direction=direction, count=count)
    ticks = np.array([s.pulse_us for s in steps]) / count
    assert ticks == pytest.approx(np.round(ticks), abs=1e-9)
    command = [direction * (s.pulse_us - 1560.0) / 375.0 for s in steps]
    assert [s.command for s in steps] == pytest.approx(command)
    assert max(np.abs(command)) < 1.01
    assert min(command) < -0.99


def test_plan_states_time_floor_and_speed():
    plan = make_plan(make_steps(center_us=1500.0, span_us=375.0, direction=1, count=4.88), 0.175)
    assert plan.time <= 120.0
    assert plan.speed == 0.55
    assert 2.0 < plan.radius < 5.0
    assert f"{plan.radius:.1f} m" in str(plan)


def test_trace_of_a_circle_closes():
    legs = [Leg(0.5, 1.0, 2.0 * np.pi)]
    points, end = trace(Spot(1.0, 2.0, 0.3), legs)
    assert end[:2] == pytest.approx((1.0, 2.0), abs=0.05)
    assert np.ptp(points[:, 0]) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("heading", np.linspace(-3.0, 3.0, 7))
@pytest.mark.parametrize("rate", [-0.7, 1.1])
def test_waiting_turns_the_next_sweep_towards_the_centre(heading, rate):
    """A straight stretch of 3 m from a spot 1.5 m off: the best heading leads back over it."""
    at, ahead = Spot(1.5, 0.0, heading), [Leg(0.5, 0.0, 6.0)]
    seconds = waiting_time(at, 0.4, rate, [ahead], (0.0, 0.0))
    assert 0.0 <= seconds <= 2.0 * np.pi / abs(rate)
    _, spot = trace(at, [Leg(0.4, rate, seconds)])
    points, _ = trace(spot, ahead)
    assert np.hypot(*points.T).max() < 2.4
    straight_on, _ = trace(Spot(1.5, 0.0, 0.0), ahead)
    assert np.hypot(*straight_on.T).max() > 4.4
