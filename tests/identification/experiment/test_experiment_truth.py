"""Experiments on hidden cars: the fits hold the truth within what they state.

What is compared is what can be known (docs/how_to/experiments.md): throttle is the
pulse of car.toml, forces hang on a scale of the workshop, speeds on the
encoder's drawing, delays on the wait for a PWM frame.
"""

from __future__ import annotations

import math
from dataclasses import replace
from statistics import median

import numpy as np
import pytest

from dart_hal.car.runs import read_any, read_run
from dart_hal.recording.check import check
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.load import find_model
from dart_lab.identification.experiment.circles import TYRE_STEERING
from dart_lab.identification.experiment.understeer import GRADIENT_RANGE
from dart_lab.identification.mass import average_mass, note_unweighed
from dart_lab.identification.outcome import identify_per_recording
from dart_lab.identification.submodels import fit_submodels

WAIT = 0.0119
"""s from a command to the end of its pulse: half a PWM frame in the mean, then 1.9 ms."""
QUICK = "mock&physics=kinematic&tick=10"
"""A car without tyres, in ticks of 10 ms: half the time; the campaign has the whole one."""
FAR = 3.0
"""standard errors: one in 400 by chance; the campaign counts 90 % intervals."""


@pytest.mark.slow
def test_friction_of_a_hidden_car(experiment, misses, truth_of):
    done = experiment("friction", 3)
    assert not done.drive.stopped
    assert done.fit.converged
    away = misses(done.fit, truth_of(done.truth))
    assert {"a", "c"} <= set(away)
    assert all(abs(z) < FAR for z in away.values()), away
    for name, most in (("a", 0.02), ("c", 0.05)):  # and the intervals are useful
        entry = done.fit.parameters[name]
        assert entry.std < most * entry.value
    assert abs(done.outcome.mass.value - done.truth.vehicle.body.mass) < 0.008
    # identify takes the mass out of the recording, and the model it writes has it
    found, recordings = identify_per_recording(*read_any([done.path]), ["friction"], PAPER, "")
    mass = found.mass
    assert mass is not None
    assert (mass.value, mass.std) == pytest.approx((done.outcome.mass.value,
                                                    done.outcome.mass.std))
    assert found.over(find_model("paper")[0]).body["mass"].value == mass.value
    again = found.fits["friction"].parameters["a"].value
    assert again == pytest.approx(done.fit.parameters["a"].value, rel=0.002)
    assert abs(mass.value / PAPER.body.mass - 1.0) > 0.004  # negative control: it does matter
    unknown = [replace(r, mass=None) for r in recordings]
    assert average_mass(unknown) is None
    assert "the car was not weighed" in note_unweighed(unknown, PAPER)
    assert not note_unweighed(recordings, PAPER)


@pytest.mark.long
def test_motor_of_a_hidden_car(experiment, misses, truth_of):
    done = experiment("motor", 2, QUICK)
    truth = truth_of(done.truth)
    away = misses(done.fit, truth)
    assert set(away) == {"d", "e", "g"}
    assert all(abs(z) < FAR for z in away.values()), away
    force = {}
    for values in (truth, done.fit.values()):
        force[id(values)] = [(values["d"] - values["e"] * v) * (tau + values["g"])
                             for tau in (0.25, 0.3, 0.4) for v in (0.5, 1.5)]
    one, other = force.values()
    assert np.allclose(one, other, rtol=0.02)
    # negative control: the model before is farther away than the fit's errors
    assert any(abs(getattr(done.outcome.base.motor, n) - truth[n]) > FAR * e.std
               for n, e in done.fit.parameters.items())


@pytest.mark.long
def test_steering_of_a_hidden_car(experiment, misses, truth_of):
    done = experiment("steering", 2)
    away = misses(done.fit, truth_of(done.truth))
    assert len(away) >= 3
    assert all(abs(z) < FAR for z in away.values()), away


@pytest.mark.long
def test_delay_of_hidden_cars(experiment):
    """Each holds the truth; how wide an interval is hangs on what the drive happened to be."""
    dones = [experiment("delay", seed, QUICK) for seed in (3, 4, 5)]
    wide = []
    for done in dones:
        fit = done.fit
        total = fit.parameters["throttle_s"].value + fit.parameters["throttle_lag_s"].value
        assert total == pytest.approx(WAIT, abs=0.008)  # the hidden ESC has neither
        at = [list(fit.parameters).index(n) for n in ("throttle_s", "throttle_lag_s")]
        wide.append(math.sqrt(fit.covariance[np.ix_(at, at)].sum()))
        assert abs(total - WAIT) < FAR * wide[-1]
        steering = fit.parameters["steering_s"]
        assert abs(steering.value - done.truth.servo.delay - WAIT) < FAR * steering.std
        assert steering.std < 0.01
        # the servo's limited rate shows as a lag: half the time of the mean step of the test
        assert 0.01 < fit.parameters["steering_lag_s"].value < 0.05
    assert median(wide) < 0.015  # the loose friction of so little coasting is not in it


@pytest.mark.long
def test_identify_reads_the_delay_as_the_experiment_does(experiment):
    """For any thinning; and the data check calls good what the fit takes."""
    done = experiment("delay", 3, QUICK)
    again = fit_submodels([read_run(done.path)], ["delay"], base=done.outcome.base,
                          mass=done.outcome.mass)[0]["delay"]
    assert again.values() == pytest.approx(done.fit.values(), abs=1e-9)
    assert not any("age of a message" in note for note in again.notes)
    coarse = read_run(done.path)
    assert check(coarse).uses["delay"].good
    straight = replace(coarse.messages, steering=np.zeros(len(coarse.messages)))
    assert not check(replace(coarse, messages=straight)).uses["delay"].good


@pytest.mark.slow
def test_understeer_of_a_hidden_car(experiment, true_slope):
    done = experiment("tyres", 6)
    understeer = done.outcome.understeer
    slope = true_slope(done.truth, TYRE_STEERING, *GRADIENT_RANGE)
    assert abs(understeer.gradient.value - slope) < FAR * understeer.gradient.std
    assert understeer.gradient.std < 0.0015
    value, std = understeer.combination
    ratio = done.truth.vehicle.body.wheelbase / done.truth.vehicle.body.mass
    assert value == pytest.approx(understeer.gradient.value * ratio, rel=0.01)
    assert std > 0.0
    # the two axles each are not identified, and not reported as such
    assert not any(e.identifiable for e in done.fit.parameters.values())
    assert any("cannot be separated" in note for note in done.fit.notes)


@pytest.mark.emulator
@pytest.mark.long
def test_understeer_through_the_real_firmware(experiment, true_slope):
    done = experiment("tyres", 4, nano="avr")
    understeer = done.outcome.understeer
    slope = true_slope(done.truth, TYRE_STEERING, *GRADIENT_RANGE)
    assert abs(understeer.gradient.value - slope) < FAR * understeer.gradient.std


@pytest.mark.long
@pytest.mark.parametrize("name", ["friction", "motor", "steering"])
def test_ninety_per_cent_intervals_over_hidden_cars(name, experiment, misses, truth_of):
    found: list[float] = []
    for seed in range(1, 17):
        done = experiment(name, seed)
        assert not done.drive.stopped
        found += list(misses(done.fit, truth_of(done.truth)).values())
    inside = float(np.mean(np.abs(found) < 1.645))
    # parameters of one fit go together, so 16 cars count, not 48 values
    assert inside > 0.9 - 2.5 * math.sqrt(0.9 * 0.1 / 16), (name, inside)
    assert np.sqrt(np.mean(np.square(found))) < 1.7


@pytest.mark.long
def test_understeer_over_hidden_cars(experiment, true_slope):
    away = []
    for seed in range(1, 13):
        done = experiment("tyres", seed)
        understeer = done.outcome.understeer.gradient
        slope = true_slope(done.truth, TYRE_STEERING, *GRADIENT_RANGE)
        away.append((understeer.value - slope) / understeer.std)
    assert np.abs(away).max() < FAR
    assert np.mean(np.abs(away) < 1.645) > 0.7


@pytest.mark.long
def test_delay_over_hidden_cars(experiment):
    away, totals = [], []
    for seed in range(1, 11):
        done = experiment("delay", seed)
        steering = done.fit.parameters["steering_s"]
        away.append((steering.value - done.truth.servo.delay - WAIT) / steering.std)
        totals.append(done.fit.parameters["throttle_s"].value
                      + done.fit.parameters["throttle_lag_s"].value)
    assert np.abs(away).max() < FAR
    assert np.allclose(totals, WAIT, atol=0.008)
