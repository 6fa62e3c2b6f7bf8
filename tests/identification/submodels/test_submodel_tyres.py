"""Tyres by inverse dynamics: the curve is found; what one direction cannot identify is reported."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.recording.dart import savgol_derivative
from dart_hal.vehicle import PAPER, make_tyres
from dart_lab.identification.submodels import fit_submodels
from dart_lab.identification.submodels.report import Ledger
from dart_lab.identification.submodels.speeds import MOCAP_KERNEL
from dart_lab.identification.submodels.tyre_fit import SHAPE_MEAN, fit_curves
from dart_lab.identification.submodels.tyre_forces import smoothing_weights, tyre_forces

LATE = 0.05


@pytest.fixture(scope="module")
def car(lively):
    """A car whose front is of the form that is fitted (E = 0)."""
    return replace(lively, tyres=replace(lively.tyres, front_D=4.0, front_C=1.3, front_B=9.0,
                                         front_E=0.0, rear_cornering_stiffness=40.0))


@pytest.fixture(scope="module")
def logged(car):
    """The same as a replay of held rows must have it."""
    return replace(car, delay=replace(car.delay, steering_s=car.delay.steering_s - LATE))


@pytest.fixture(scope="module")
def ramps(workshop, car):
    """Speed ramps with steering about +-0.35 and +-0.7 that changes now and then, 3 seeds."""
    rng = np.random.default_rng(2)
    n, seeds = 3500, 3
    steering = np.repeat(np.tile([0.35, -0.35, 0.7, -0.7], seeds)[:, None], n, axis=1)
    steering = steering + np.repeat(rng.uniform(-0.15, 0.15, (4 * seeds, n // 100)), 100, axis=1)
    throttle = np.tile(np.linspace(0.2, 0.4, n), (4 * seeds, 1))
    d = workshop.drive(car, throttle, steering, rng, disturbance=0.05)
    return [workshop.recordings(d, i, "B", range(4 * i, 4 * i + 4), "ramp") for i in range(seeds)]


@pytest.mark.slow
def test_both_axles_lie_within_the_stated_intervals(ramps, logged):
    front, _ = make_tyres(logged.tyres, logged.body, np)
    alpha = np.radians([1.0, 3.0, 6.0, 9.0])
    z = []
    for recordings in ramps:
        fit = fit_submodels(recordings, ("tyres",), base=logged)[0]["tyres"]
        rear = fit.parameters["rear_cornering_stiffness"]
        z.append((rear.value - 40.0) / rear.std)
        assert rear.identifiable
        assert rear.std < 2.0
        found, _ = make_tyres(replace(logged.tyres, **fit.values()), logged.body, np)
        assert found(alpha) == pytest.approx(front(alpha), rel=0.06)
        assert fit.converged
        assert fit.parameters["front_D"].identifiable
        z.append((fit.parameters["front_D"].value - 4.0) / fit.parameters["front_D"].std)
    assert np.max(np.abs(z)) < 3.0
    assert np.sqrt(np.mean(np.square(z))) < 1.7


@pytest.mark.slow
def test_intervals_of_the_front_hold_for_other_shapes_of_its_curve(workshop, lively):
    """Drives that hardly reach the peak do not determine C and E: D and B vary with them."""
    rng = np.random.default_rng(11)
    n = 3000
    free: list[np.ndarray] = []
    fixed: list[np.ndarray] = []
    for i in range(6):
        tyres = replace(lively.tyres, front_D=rng.uniform(2.5, 5.0), front_C=rng.uniform(0.6, 1.6),
                        front_B=rng.uniform(7.0, 16.0), front_E=rng.uniform(-3.0, 0.8))
        car = replace(lively, tyres=tyres)
        logged = replace(car, delay=replace(car.delay, steering_s=car.delay.steering_s - LATE))
        steering = np.repeat(rng.uniform(-0.7, 0.7, (3, n // 100)), 100, axis=1)
        throttle = np.repeat(rng.uniform(0.25, 0.4, (3, n // 500)), 500, axis=1)
        d = workshop.drive(car, throttle, steering, rng, disturbance=0.05)
        recordings = workshop.recordings(d, 300 + i, "B", name=f"shape_{i}")
        fit = fit_submodels(recordings, ("tyres",), base=logged)[0]["tyres"]
        truth = np.array([getattr(tyres, name) for name in fit.parameters])
        value = np.array([p.value for p in fit.parameters.values()])
        free.append((value - truth) / [p.std for p in fit.parameters.values()])
        forces = [tyre_forces(r, None, logged, Ledger()) for r in recordings]
        other = fit_curves([f for f in forces if f is not None], SHAPE_MEAN)
        fixed.append(((other.x - truth) / np.sqrt(np.diag(other.covariance)))[[0, 2]])
    assert np.sqrt(np.mean(np.square(free))) < 1.5
    assert np.max(np.abs(free)) < 3.5
    # Control: with C and E taken as known, the errors of D and B are far too small.
    assert np.sqrt(np.mean(np.square(fixed))) > 3.0


@pytest.mark.slow
def test_a_wrong_steering_delay_shows_in_the_front(ramps, logged):
    late = replace(logged, delay=replace(logged.delay, steering_s=0.3, steering_lag_s=0.0))
    right = fit_submodels(ramps[0], ("tyres",), base=logged)[0]["tyres"]
    wrong = fit_submodels(ramps[0], ("tyres",), base=late)[0]["tyres"]
    assert wrong.rmse > 1.3 * right.rmse


@pytest.mark.slow
def test_gentle_turning_shows_a_stiffness_but_no_peak(workshop, car, logged):
    rng = np.random.default_rng(7)
    n = 2500
    steering = np.repeat(rng.uniform(-0.2, 0.2, (3, n // 100)), 100, axis=1)
    throttle = np.repeat([[0.3], [0.32], [0.34]], n, axis=1)
    d = workshop.drive(car, throttle, steering, rng, disturbance=0.05)
    recordings = workshop.recordings(d, 40, "B", name="gentle")
    fit = fit_submodels(recordings, ("tyres",), base=logged)[0]["tyres"]
    assert not fit.parameters["front_C"].identifiable
    assert fit.parameters["front_C"].value == pytest.approx(
        1.3, abs=2.5 * fit.parameters["front_C"].std)
    assert any("cannot be separated" in note for note in fit.notes)
    stiffness = np.prod([fit.parameters[f"front_{k}"].value for k in "DCB"])
    assert stiffness == pytest.approx(4.0 * 1.3 * 9.0, rel=0.15)


@pytest.mark.slow
def test_crawling_is_refused_because_noise_makes_a_tyre_look_soft(workshop, car, logged):
    steering = np.repeat([[0.5], [-0.5]], 2000, axis=1)
    d = workshop.drive(car, np.full_like(steering, 0.21), steering, np.random.default_rng(1))
    fits, files = fit_submodels(workshop.recordings(d, 60, "B", name="crawl"), ("tyres",),
                                base=logged)
    assert fits["tyres"].n == 0
    assert not fits["tyres"].sound
    assert all(any("hardly anything" in why for why in f.why) for f in files.values())


def test_the_smoothing_is_what_the_derivative_sees():
    """d/dt of a curve by the grid's kernel = its exact rate filtered by ``smoothing``."""
    t = 0.01 * np.arange(400)
    curve, rate = np.sin(9.0 * t), 9.0 * np.cos(9.0 * t)
    weights = smoothing_weights(MOCAP_KERNEL)
    assert weights.sum() == pytest.approx(1.0)
    smoothed = np.convolve(rate, weights, mode="same")
    exact = savgol_derivative(curve, 15)
    assert smoothed[30:-30] == pytest.approx(exact[30:-30], abs=0.02)
    assert np.max(np.abs(rate - exact)[30:-30]) > 0.2  # without it they differ


@pytest.mark.slow
def test_sessions_are_averaged_with_the_spread_between_them(ramps, logged):
    """Two days, the second with a room 1.3 times as large: two tyres, one honest interval."""
    first = ramps[0]
    later = [replace(r, mocap=replace(r.mocap, epoch=r.mocap.epoch + 86400.0,
                                      x=1.3 * r.mocap.x, y=1.3 * r.mocap.y)) for r in ramps[1]]
    alone = fit_submodels(first, ("tyres",), base=logged)[0]["tyres"]
    both = fit_submodels([*first, *later], ("tyres",), base=logged)[0]["tyres"]
    name = "rear_cornering_stiffness"
    assert both.parameters[name].std > 3.0 * alone.parameters[name].std
    assert any("2 sessions fitted separately" in note for note in both.notes)


@pytest.mark.slow
def test_the_base_is_given_back_when_nothing_is_reported(workshop, steps, lively):
    rng = np.random.default_rng(3)
    throttle = steps([0.25], rng)
    d = workshop.drive(lively, throttle, 0.0 * throttle, rng)
    fit = fit_submodels(workshop.recordings(d, 90, "A"), ("tyres",))[0]["tyres"]
    assert fit.values()["rear_cornering_stiffness"] == PAPER.tyres.rear_cornering_stiffness
    assert all(np.isinf(e.std) for e in fit.parameters.values())
