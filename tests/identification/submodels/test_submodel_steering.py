"""Steering map, slip and timing: truth within stated errors; what is not identifiable is
reported."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.vehicle import PAPER, make_steering
from dart_lab.identification.submodels import fit_submodels
from dart_lab.identification.submodels import steering as submodel_steering
from dart_lab.identification.submodels.understeer import estimate_understeer

MAP = {n: getattr(PAPER.steering, n)
       for n in ("k_left", "a_left_rad", "s0", "a_right_rad", "k_right")}
LATE = 0.05


def levels(workshop, car, seeds=1, first=0, name="levels"):
    """17 steering levels of 3 s, up and down, at two throttles; all seeds side by side."""
    s = np.linspace(-1.0, 1.0, 17)
    steering = np.tile(np.repeat(np.stack([s, s[::-1]] * 2), 300, axis=1), (seeds, 1))
    rng = np.random.default_rng(first)
    tau = np.tile(np.repeat([[0.2], [0.2], [0.22], [0.22]], steering.shape[1], axis=1), (seeds, 1))
    d = workshop.drive(car, tau, steering, rng)
    return [workshop.recordings(d, first + i, lanes=range(4 * i, 4 * i + 4), name=name)
            for i in range(seeds)]


def jumps(workshop, car, schema, seeds):
    """Random steering steps every 0.3 to 1.2 s at about 1 m/s; all seeds side by side."""
    rng = np.random.default_rng(3)
    m, n = 4, 2500
    steering = np.zeros((m * seeds, n))
    for row in steering:
        i = 100
        while i < n:
            k = round(rng.uniform(30, 120))
            row[i:i + k], i = rng.uniform(-0.8, 0.8), i + k
    d = workshop.drive(car, np.full_like(steering, 0.24), steering, rng)
    return [workshop.recordings(d, 100 + i, schema, range(i * m, (i + 1) * m), "jumps")
            for i in range(seeds)]


@pytest.mark.slow
def test_the_map_lies_within_the_stated_intervals(workshop, lively):
    z = []
    for recordings in levels(workshop, lively, 5):
        fit = fit_submodels(recordings, ("steering",))[0]["steering"]
        assert fit.sound
        assert all(e.identifiable for e in fit.parameters.values())
        z += [(fit.parameters[n].value - MAP[n]) / fit.parameters[n].std for n in MAP]
        assert fit.parameters["a_left_rad"].std < 0.01
    assert np.mean(np.abs(z) < 1.645) >= 0.75
    assert np.sqrt(np.mean(np.square(z))) < 1.5


@pytest.mark.slow
def test_a_car_that_is_often_fast_does_not_lose_steering_lock(workshop, lively):
    """Its commands near the lock count where the car is slow, not where it does not turn yet."""
    rng = np.random.default_rng(8)
    m, n = 9, 6000
    steering = np.repeat(rng.uniform(-0.95, 0.95, (m, n // 40)), 40, axis=1)
    throttle = np.repeat(rng.uniform(0.25, 0.42, (m, n // 200)), 200, axis=1)
    stiff = replace(lively, tyres=replace(lively.tyres, front_D=3.0,
                                          rear_cornering_stiffness=30.0))
    d = workshop.drive(stiff, throttle, steering, rng)
    z = []
    for i in range(3):
        recordings = workshop.recordings(d, 150 + i, "B", range(3 * i, 3 * i + 3), "fast")
        fit = fit_submodels(recordings, ("steering",))[0]["steering"].parameters
        z += [(fit[n].value - MAP[n]) / fit[n].std for n in MAP]
    # By the measured lateral acceleration a_left was .10 +- .03 in one of the three, of .33.
    assert np.sqrt(np.mean(np.square(z))) < 1.6
    assert np.max(np.abs(z)) < 4.0


@pytest.mark.slow
def test_a_fit_belongs_to_the_samples_it_reports_when_the_selections_end(
        workshop, lively, monkeypatch):
    """However many selections there are, none follows the last fit."""
    fitted = []
    fit_map = submodel_steering.fit_map
    monkeypatch.setattr(submodel_steering, "fit_map",
                        lambda samples, **options: fitted.append(len(samples))
                        or fit_map(samples, **options))
    monkeypatch.setattr(submodel_steering, "MAX_STEADY_LATERAL", 0.3)
    for count in (1, 2):
        monkeypatch.setattr(submodel_steering, "MAX_SELECTIONS", count)
        fit = fit_submodels(levels(workshop, lively, 1)[0], ("steering",))[0]["steering"]
        # The last call is that of the map without slip, for the notes.
        assert fit.n == fitted[-2] == fitted[-1]


@pytest.mark.slow
def test_too_few_levels_and_a_wrong_sign_are_refused_in_words(workshop, lively):
    straight = levels(workshop, lively, first=20, name="few")[0][2:]
    few = [replace(r, messages=replace(r.messages, steering=np.round(r.messages.steering / 2)))
           for r in straight]
    wrong = [replace(r, messages=replace(r.messages, steering=-r.messages.steering))
             for r in straight]
    for recordings, word in ((few, "steering level"), (wrong, "sign")):
        fit = fit_submodels(recordings, ("steering",))[0]["steering"]
        assert fit.n == 0
        assert not fit.sound
        assert word in fit.notes[0]
        assert fit.values() == MAP


@pytest.mark.slow
def test_one_side_only_is_reported(workshop, lively):
    recordings = [replace(r, messages=replace(
        r.messages, speed=np.where(r.messages.steering > -0.1, r.messages.speed, 0.0)))
                  for r in levels(workshop, lively, first=21, name="side")[0]]
    fit = fit_submodels(recordings, ("steering",))[0]["steering"]
    assert fit.parameters["a_left_rad"].identifiable
    assert not fit.parameters["a_right_rad"].identifiable
    assert any("on the right" in note for note in fit.notes)


@pytest.mark.slow
def test_two_speeds_at_one_command_show_the_understeer_gradient(workshop, lively):
    grippy = replace(lively, tyres=replace(lively.tyres, front_D=8.0, front_C=1.2, front_B=4.0,
                                           front_E=0.0, rear_cornering_stiffness=70.0))
    b = grippy.body
    truth = b.mass / b.wheelbase**2 * (b.l_r / (8.0 * 1.2 * 4.0) - b.l_f / 70.0)
    # each level at two speeds within one recording
    steering = np.repeat([[0.3, 0.3, -0.4, -0.4, 0.15, 0.15, -0.25, -0.25]], 600, axis=1)
    rng = np.random.default_rng(23)
    tau = np.repeat([[0.2, 0.25] * 4], 600, axis=1)
    recordings = workshop.recordings(
        workshop.drive(grippy, np.repeat(tau, 3, axis=0), np.repeat(steering, 3, axis=0), rng,
                       substeps=4), 23, name="pairs")
    found = estimate_understeer(recordings, None, grippy)
    assert found is not None
    value, std = found
    assert abs(value - truth) < 3.0 * std
    assert value > 2.0 * std  # it is identified, not only bracketed
    fit = fit_submodels(recordings, ("tyres",), base=grippy)[0]["tyres"]
    assert fit.n == 0
    assert "no motion capture" in fit.notes[0]
    assert "one combination" in fit.notes[1]


@pytest.mark.parametrize("schema", ["A", "B"])
@pytest.mark.slow
def test_delay_and_lag_lie_within_the_stated_intervals(workshop, lively, schema):
    z = []
    for recordings in jumps(workshop, lively, schema, 4):
        fit = fit_submodels(recordings, ("delay",))[0]["delay"]
        for name, truth in (("steering_s", lively.delay.steering_s - LATE),
                            ("steering_lag_s", lively.delay.steering_lag_s)):
            entry = fit.parameters[name]
            assert entry.identifiable
            assert entry.std < 0.012
            z.append((entry.value - truth) / entry.std)
        assert not fit.parameters["throttle_s"].identifiable
        assert any("held rows" in n or "holds logged rows" in n for n in fit.notes)
    assert np.mean(np.abs(z) < 1.645) >= 0.75
    assert np.sqrt(np.mean(np.square(z))) < 1.5


def slow_sine(workshop, car, seed=0):
    t = 0.01 * np.arange(4000)
    steering = np.stack([0.6 * np.sin(2.0 * np.pi * 0.12 * t + k) for k in range(3)])
    d = workshop.drive(car, np.full_like(steering, 0.24), steering, np.random.default_rng(seed))
    return workshop.recordings(d, 200 + seed, name="sine")


@pytest.mark.slow
def test_a_slow_sine_does_not_separate_delay_from_lag(workshop, lively):
    fit = fit_submodels(slow_sine(workshop, lively), ("delay",))[0]["delay"]
    total = lively.delay.steering_s + lively.delay.steering_lag_s - LATE
    assert not fit.parameters["steering_s"].identifiable
    assert not fit.parameters["steering_lag_s"].identifiable
    assert fit.parameters["steering_lag_s"].value == 0.0
    assert fit.parameters["steering_s"].value == pytest.approx(total, abs=0.012)
    assert any("cannot be separated" in note for note in fit.notes)


@pytest.mark.slow
def test_a_hole_in_the_rows_does_not_stretch_the_delay(workshop, lively):
    """The mean step across holes does, which is how 0.15 s came about."""
    full = slow_sine(workshop, lively, 1)
    holed = []
    for r in full:
        m = r.messages
        keep = (m.t < m.t[0] + 12.0) | (m.t > m.t[0] + 24.0)
        parts = {n: getattr(m, n)[keep] for n in m.__slots__}
        parts["segment"] = (parts["t"] > m.t[0] + 20.0).astype(np.int64)
        holed.append(replace(r, messages=type(m)(**parts)))
    one, other = (fit_submodels(r, ("delay",))[0]["delay"].values()["steering_s"]
                  for r in (full, holed))
    assert other == pytest.approx(one, abs=0.006)
    step = np.concatenate([np.diff(r.messages.t) for r in holed])
    assert np.mean(step) > 1.3 * np.median(step)  # the trap is there


@pytest.mark.slow
def test_steering_that_never_changes_shows_no_delay(workshop, lively):
    d = workshop.drive(lively, np.full((2, 1500), 0.24), np.full((2, 1500), 0.4),
                       np.random.default_rng(9))
    fits, files = fit_submodels(workshop.recordings(d, 300, name="held"), ("delay",))
    assert fits["delay"].n == 0
    assert not fits["delay"].converged
    assert fits["delay"].values()["steering_s"] == PAPER.delay.steering_s
    assert all(any("hardly changes" in why for why in f.why) for f in files.values())


@pytest.mark.slow
def test_a_servo_without_saturation_is_no_failed_fit(workshop, lively):
    """A linkage that turns the wheels more near its end: the map ends as a straight line."""
    straight = {"a_left_rad": 1.4, "k_left": 0.3, "a_right_rad": 1.4, "k_right": 0.3}
    car = replace(lively, steering=replace(lively.steering, s0=0.0, **straight))
    truth = make_steering(car.steering, np)
    command = np.linspace(-1.0, 1.0, 21)
    at_bound = 0
    for first in (0, 10, 20):
        steering = np.tile(np.repeat(np.stack([command, command[::-1]] * 2), 300, axis=1), (1, 1))
        tau = np.repeat([[0.2], [0.2], [0.22], [0.22]], steering.shape[1], axis=1)
        driven = workshop.drive(car, tau, bend(steering), np.random.default_rng(first))
        recordings = workshop.recordings(replace(driven, steering=steering), first, name="bent")
        fit = fit_submodels(recordings, ("steering",))[0]["steering"]
        found = {n: fit.parameters[n].value for n in MAP}
        at_bound += max(found["a_left_rad"], found["a_right_rad"]) > 1.19
        assert fit.sound, fit.at_bound
        angle = make_steering(replace(car.steering, **found), np)(command)
        assert np.max(np.abs(angle - truth(bend(command)))) < 0.02
    assert at_bound, "no fit ended at the largest amplitude: the test tests nothing"


def bend(command):
    """Return the commands that a linkage makes of commands: less at the middle."""
    return 0.9 * command + 0.1 * command**3
