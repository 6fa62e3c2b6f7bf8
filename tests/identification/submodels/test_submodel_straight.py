"""Friction and motor: the truth lies within the stated errors, and what would be wrong is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.calibration.sessions import sessions_of
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.fitting.covariance import enclosing_covariance
from dart_lab.identification.fit import FittedParameter
from dart_lab.identification.submodels import fit_submodels
from dart_lab.identification.submodels.coasting import fit_coasting, select_driven
from dart_lab.identification.submodels.guess import first_guess
from dart_lab.identification.submodels.motor_fit import fit_motor
from dart_lab.identification.submodels.report import Ledger
from dart_lab.identification.submodels.speeds import read_speeds
from dart_lab.identification.submodels.straight import STRAIGHT_NAMES, solve_straight
from dart_lab.identification.submodels.stretches import cut_stretches

LEVELS = (0.2, 0.22, 0.24, 0.27, 0.29, 0.32, 0.36, 0.4)
TRUTH = {**{n: getattr(PAPER.friction, n) for n in "abc"},
         **{n: getattr(PAPER.motor, n) for n in "deg"}}
SEEDS = 15
"""Drives whose mean is judged: 1/b of one drive has a standard error of 0.04."""


@pytest.fixture(scope="module")
def sets(workshop, steps, lively):
    """Eight recordings of throttle steps per seed; all seeds simulated side by side."""
    rng = np.random.default_rng(1)
    throttle = np.concatenate([steps(LEVELS, rng) for _ in range(SEEDS)])
    driven = workshop.drive(lively, throttle, np.zeros_like(throttle), rng)
    m = len(LEVELS)
    return [workshop.recordings(driven, seed, lanes=range(seed * m, (seed + 1) * m))
            for seed in range(SEEDS)]


@pytest.fixture(scope="module")
def fits(sets):
    return [fit_submodels(recordings, ("friction", "motor"))[0] for recordings in sets]


def scores(values, errors):
    return np.array([(values[n] - TRUTH[n]) / errors[n] for n in TRUTH])


def prepared(recordings):
    series = [read_speeds(r, None, Ledger()) for r in recordings]
    return series, cut_stretches(series), first_guess(series, PAPER, PAPER.body.mass)


@pytest.mark.slow
def test_the_truth_lies_within_the_stated_intervals(fits):
    z = []
    for fit in fits:
        both = {**fit["friction"].parameters, **fit["motor"].parameters}
        z.append(scores({n: e.value for n, e in both.items()}, {n: e.std for n, e in both.items()}))
    assert np.mean(np.abs(z) < 1.645) >= 0.75
    assert np.sqrt(np.mean(np.square(z))) < 1.5
    assert all(f.converged for fit in fits for f in fit.values())


@pytest.mark.long
def test_the_end_of_a_coast_down_must_not_hang_on_the_measured_speed(sets):
    """Cars that chance pushes roll longer: taken as long as they roll, friction seems to fade."""
    right, wrong = [], []
    for recordings in sets:
        series = [s for r in recordings if (s := read_speeds(r, None, Ledger())) is not None]
        rolling = [s.select(np.flatnonzero(~s.tail)) for s in series]
        for out, some in ((right, series), (wrong, rolling)):
            out.append(1.0 / fit_coasting(some, [""] * len(some), PAPER, 1.67)[0].value("b"))
    assert np.mean(right) == pytest.approx(1.0 / TRUTH["b"], abs=0.03)
    assert np.mean(wrong) > 1.5 / TRUTH["b"]


@pytest.mark.slow
def test_a_motor_of_another_form_does_not_move_the_friction(workshop, steps, lively):
    """A battery that gives way under load: together, the friction takes what the motor cannot."""
    rng = np.random.default_rng(9)
    throttle = steps(LEVELS, rng)
    sag = 1.0 - 0.15 * np.clip(np.cumsum(throttle > 0.0, axis=1) / 500.0, 0.0, 1.0)
    slower = workshop.drive(lively, throttle * sag, 0.0 * throttle, rng)
    recordings = workshop.recordings(replace(slower, throttle=throttle), 80, name="sag")
    other_form = fit_submodels(recordings, ("friction", "motor"))[0]["friction"].parameters
    series, s, x0 = prepared(recordings)
    together = solve_straight(series, s, PAPER, x0, STRAIGHT_NAMES, PAPER.body.mass)
    for n in "ac":
        assert abs(other_form[n].value - TRUTH[n]) < 2.5 * other_form[n].std
    # Beyond its own interval, and far beyond that of the separate fit.
    wrong = abs(together.value("c") - TRUTH["c"])
    assert wrong > 1.645 * together.std("c")
    assert wrong > 2.5 * other_form["c"].std


@pytest.mark.slow
def test_the_error_of_the_friction_is_in_the_motor(sets):
    """As much as the motor moves when it is fitted again with another friction."""
    series = [s for r in sets[0] if (s := read_speeds(r, None, Ledger())) is not None]
    coast = fit_coasting(series, [""] * len(series), PAPER, PAPER.body.mass)[0]
    parts = [d for s in series if (d := select_driven(s)) is not None]
    x0 = np.concatenate([coast.x[:3], first_guess(series, PAPER, PAPER.body.mass)[3:]])

    def fit(x0, friction):
        return fit_motor(parts, np.zeros(len(parts), dtype=int), PAPER, x0, STRAIGHT_NAMES[3:],
                         friction, PAPER.body.mass)[0]

    friction = coast.covariance[:3, :3]
    found, exact = fit(x0, friction), fit(x0, 0.0 * friction)
    move = found.covariance[3:6, :3] @ np.linalg.inv(friction)
    # d and e trade along a flat valley, in which a fit ends within 0.03 of the lowest point: a step
    # of 0.2 to both sides moves them by 0.2 and 0.1.
    step = 0.2 * np.eye(8)[0]
    more, less = fit(x0 + step, friction), fit(x0 - step, friction)
    assert 0.5 * (more.x[3:6] - less.x[3:6]) == pytest.approx(
        0.2 * move[:, 0], rel=0.3, abs=0.1 * exact.std("g"))
    added = found.covariance[3:6, 3:6] - exact.covariance[3:6, 3:6]
    assert added == pytest.approx(move @ friction @ move.T)
    assert found.std("g") > 1.1 * exact.std("g")


@pytest.mark.slow
def test_sessions_of_another_trim_share_one_motor(workshop, steps, lively):
    """Three days, three dead bands: d and e as of one, g their mean and as uncertain as they
    differ.

    With one dead band for all, the motor would be wrong.
    """
    rng = np.random.default_rng(10)
    recordings = []
    for day, off in ((22, -0.02), (23, 0.0), (24, 0.02)):
        car = replace(lively, motor=replace(lively.motor, g=lively.motor.g + off))
        throttle = steps(np.array(LEVELS[1 + day - 22:][:5]) - off, rng)
        recordings += workshop.recordings(workshop.drive(car, throttle, 0.0 * throttle, rng), day,
                                          name=f"car_1_Datarecording_01_{day}_2024_15_00_00")
    motor = fit_submodels(recordings, ("motor",))[0]["motor"]
    series, s, x0 = prepared(recordings)
    one = solve_straight(series, s, PAPER, x0, STRAIGHT_NAMES, PAPER.body.mass)
    for n in "deg":
        entry = motor.parameters[n]
        assert abs(entry.value - TRUTH[n]) < 3.0 * entry.std
    assert motor.parameters["g"].std > 0.02 / np.sqrt(3)
    assert motor.rmse < 0.8 * one.rmse
    assert motor.parameters["d"].std < 0.6 * one.std("d")


def test_a_session_ends_with_an_hour_of_rest(workshop, steps, lively):
    """For any folders; recordings without a time stay with their folder."""
    rng = np.random.default_rng(11)
    throttle = steps([0.3], rng, pulse=1.0, coast=0.5)
    recording = workshop.recordings(workshop.drive(lively, throttle, 0.0 * throttle, rng), 12)[0]

    def rename(name):
        return replace(recording, path=recording.path.parent / name)

    found = sessions_of([rename("a/car_1_Datarecording_01_22_2024_11_40_46.csv"),
                         rename("b/car_1_Datarecording_01_22_2024_12_15_11.csv"),
                         rename("b/car_1_Datarecording_01_22_2024_15_00_29.csv"),
                         rename("b/run.csv"), rename("c/run.csv")])
    assert found == ["2024-01-22 11:40 a + b", "2024-01-22 11:40 a + b", "2024-01-22 15:00 b",
                     "b", "c"]


def test_the_wider_of_two_covariances_is_narrower_than_neither():
    rng = np.random.default_rng(12)
    first, second = (m @ m.T for m in rng.normal(size=(2, 3, 3)))
    out = enclosing_covariance(first, second)
    for other in (first, second):
        assert np.linalg.eigvalsh(out - other).min() > -1e-9
    assert enclosing_covariance(first, 0.1 * first) == pytest.approx(first)


@pytest.mark.slow
def test_the_values_are_accurate(fits):
    for name, share in (("a", 0.15), ("d", 0.12), ("e", 0.25), ("g", 0.08)):
        got = [(f["friction"].parameters | f["motor"].parameters)[name].value for f in fits]
        assert np.std(got) < share * abs(TRUTH[name])


@pytest.mark.slow
def test_samples_taken_as_independent_would_promise_too_much(sets, fits):
    ratio = []
    for recordings, fit in zip(sets[:1], fits, strict=False):
        series, s, x0 = prepared(recordings)
        naive = replace(s, block=np.arange(len(s.v)))
        alone = solve_straight(series, naive, PAPER, x0, STRAIGHT_NAMES, PAPER.body.mass)
        ratio += [fit["motor"].parameters[n].std / alone.std(n) for n in "de"]
    assert np.mean(ratio) > 1.5


@pytest.mark.slow
def test_without_its_delay_the_motor_is_biased(workshop, lively):
    """Throttle that changes every half second: 0.19 s of delay and lag turn into less motor."""
    rng = np.random.default_rng(4)
    throttle = np.repeat(rng.choice([0.18, 0.24, 0.3, 0.36], (4, 40)), 50, axis=1)
    throttle[:, -300:] = 0.0
    car = replace(lively, delay=replace(lively.delay, throttle_s=0.14))
    series, s, x0 = prepared(workshop.recordings(
        workshop.drive(car, throttle, 0.0 * throttle, rng), 40, name="fast"))
    right = solve_straight(series, s, PAPER, x0, STRAIGHT_NAMES, PAPER.body.mass)
    x0[6:] = 0.0
    wrong = solve_straight(series, s, PAPER, x0, STRAIGHT_NAMES[:6], PAPER.body.mass)
    assert abs(wrong.value("d") - TRUTH["d"]) > 2.0 * abs(right.value("d") - TRUTH["d"])
    assert abs(wrong.value("d") / TRUTH["d"] - 1.0) > 0.1
    assert wrong.rmse > 1.2 * right.rmse
    total = right.value("throttle_s") + right.value("throttle_lag_s")
    assert total == pytest.approx(0.19, abs=0.03)


@pytest.mark.slow
def test_the_error_of_the_mass_is_in_every_force(sets, fits):
    plain = fits[0]
    vague = fit_submodels(sets[0], ("friction", "motor"),
                          mass=FittedParameter(PAPER.body.mass, 0.2, "kg"))[0]
    for name in ("d", "e"):
        share = vague["motor"].parameters[name]
        own = plain["motor"].parameters[name].std
        assert share.std == pytest.approx(np.hypot(own, share.value * 0.2 / 1.67), rel=0.02)
    assert vague["motor"].parameters["g"].std == pytest.approx(plain["motor"].parameters["g"].std)


@pytest.mark.slow
def test_twice_the_mass_is_twice_the_forces(sets, fits):
    twice = fit_submodels(sets[0], ("motor",), mass=FittedParameter(3.34, 0.0, "kg"))[0]["motor"]
    once = fits[0]["motor"]
    assert twice.values()["d"] == pytest.approx(2.0 * once.values()["d"], rel=0.02)
    assert twice.values()["g"] == pytest.approx(once.values()["g"], abs=0.002)


@pytest.mark.slow
def test_one_throttle_level_shows_no_dead_band(workshop, steps, lively):
    rng = np.random.default_rng(5)
    throttle = steps([0.3] * 4, rng)
    recordings = workshop.recordings(
        workshop.drive(lively, throttle, 0.0 * throttle, rng), 50, name="one")
    motor = fit_submodels(recordings, ("motor",))[0]["motor"]
    assert not motor.parameters["g"].identifiable
    assert np.isinf(motor.parameters["g"].std)
    assert motor.parameters["g"].value == PAPER.motor.g
    assert any("cannot be separated" in note for note in motor.notes)


@pytest.mark.slow
def test_without_coasting_the_friction_is_not_reported(workshop, steps, lively):
    rng = np.random.default_rng(6)
    throttle = np.repeat([[0.22], [0.25], [0.3], [0.35]], 700, axis=1)
    recordings = workshop.recordings(
        workshop.drive(lively, throttle, 0.0 * throttle, rng), 60, name="driven")
    fits = fit_submodels(recordings, ("friction", "motor"))[0]
    assert not any(e.identifiable for e in fits["friction"].parameters.values())
    assert not fits["friction"].converged
    assert fits["friction"].n == 0
    assert any("friction held" in note for note in fits["motor"].notes)


@pytest.mark.slow
def test_errors_of_the_motor_contain_those_of_values_that_are_the_bases(workshop, steps, lively):
    """A car with 2.5 times the friction of the base, or with another dead band, and no test of it.

    Control: without the errors of what was held, g is more than five of its errors off.
    """
    rng = np.random.default_rng(7)
    stiff = replace(lively, friction=replace(lively.friction, a=2.5 * lively.friction.a))
    throttle = np.repeat(rng.uniform(0.28, 0.42, (4, 10)), 150, axis=1)
    recordings = workshop.recordings(
        workshop.drive(stiff, throttle, 0.0 * throttle, rng), 70, name="stiff")
    motor = fit_submodels(recordings, ("motor",))[0]["motor"].parameters
    assert all(abs(motor[n].value - TRUTH[n]) < 2.5 * motor[n].std for n in "deg")
    series, _, x0 = prepared(recordings)
    x0[:3] = [PAPER.friction.a, PAPER.friction.b, PAPER.friction.c]
    parts = [d for s in series if (d := select_driven(s)) is not None]
    exact = fit_motor(parts, np.zeros(len(parts), dtype=int), PAPER, x0, STRAIGHT_NAMES[3:],
                      np.zeros((3, 3)), PAPER.body.mass)[0]
    assert abs(exact.value("g") - TRUTH["g"]) > 5.0 * exact.std("g")

    late = replace(lively, motor=replace(lively.motor, g=lively.motor.g + 0.05))
    throttle = steps([0.3] * 4, rng)
    recordings = workshop.recordings(
        workshop.drive(late, throttle, 0.0 * throttle, rng), 71, name="band")
    motor = fit_submodels(recordings, ("friction", "motor"))[0]["motor"].parameters
    assert abs(motor["d"].value - TRUTH["d"]) < 2.5 * motor["d"].std


@pytest.mark.slow
def test_friction_alone_needs_only_the_coasting(sets):
    friction = fit_submodels(sets[0], ("friction",))[0]["friction"]
    for name in "ac":
        entry = friction.parameters[name]
        assert abs(entry.value - TRUTH[name]) < 3.5 * entry.std
    assert "0 driven" in friction.notes[0]


@pytest.mark.slow
def test_mocap_and_encoder_see_the_same_car(workshop, steps, lively):
    rng = np.random.default_rng(8)
    throttle = steps(LEVELS, rng)
    driven = workshop.drive(lively, throttle, 0.0 * throttle, rng)
    encoder = fit_submodels(workshop.recordings(driven, 70, "A"), ("motor",))[0]["motor"]
    mocap = fit_submodels(workshop.recordings(driven, 70, "B"), ("motor",))[0]["motor"]
    for name in "deg":
        a, b = encoder.parameters[name], mocap.parameters[name]
        assert abs(a.value - b.value) < 3.0 * np.hypot(a.std, b.std)
    assert mocap.rmse < encoder.rmse  # no counting noise
