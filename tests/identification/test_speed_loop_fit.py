"""Recordings of a speed command: the joint fit finds the loop, other forms are refused."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from dart_hal.core.errors import UsageError
from dart_hal.recording.dart import AppliedCommands, Reference
from dart_hal.recording.dart.model import freeze
from dart_hal.vehicle import PAPER, SpeedLoop
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.file import model_of
from dart_hal.vehicle.flat import value, with_values
from dart_hal.vehicle.load import vehicle_of
from dart_lab.diagnosis import diagnose
from dart_lab.diagnosis.inputs import check_inputs
from dart_lab.diagnosis.suggest.virtual import COMMAND_AGE, VirtualCommands, record
from dart_lab.identification.drive_form import (
    check_drive,
    drive_of,
    estimate_speed_loop,
    with_drive_of,
)
from dart_lab.identification.evaluation import evaluate
from dart_lab.identification.outcome import identify, identify_jointly, identify_per_recording
from dart_lab.identification.write import SECTIONS, build_model
from tests.recorded.simulated_recording import noisy

FRAME = Reference(0.11, 0.01, -0.01, "of the simulation")
TRUE = with_values(replace(PAPER, name="vesc", motor=SpeedLoop(gain=6.0, max_force=5.0)), {
    "friction.a": 1.5, "steering.a_left_rad": 0.31, "steering.s0": 0.0, "delay.steering_s": 0.06,
    "delay.throttle_s": 0.05, "delay.steering_lag_s": 0.04, "delay.throttle_lag_s": 0.08,
    "tyres.front_D": 3.3, "tyres.rear_cornering_stiffness": 25.0})


def levels(rng, n, low, high, shortest, longest):
    """Random levels, each held for a random time [samples]."""
    out = np.empty(n)
    i = 0
    while i < n:
        length = int(rng.uniform(shortest, longest))
        out[i:i + length] = rng.uniform(low, high)
        i += length
    return out


def driven(seed, seconds=40.0, p=TRUE, highest=2.4):
    """A recording of commanded speeds 0.6 to ``highest`` [m/s], with the times of the commands."""
    rng = np.random.default_rng(seed)
    n = int(100 * seconds)
    speeds = levels(rng, n, 0.6, highest, 60, 250)
    made = record(p, VirtualCommands(speeds, levels(rng, n, -0.9, 0.9, 30, 150)), FRAME,
                  f"speed_{seed}")
    m = made.messages
    sent = AppliedCommands(freeze(m.t - COMMAND_AGE), m.throttle, m.steering)
    return replace(noisy(made, rng), marker=FRAME, framed=True, commands=sent,
                   sha256=f"{seed:064x}")


@pytest.fixture(scope="module")
def recordings():
    return [driven(1), driven(2)]


@pytest.fixture(scope="module")
def found(recordings):
    return identify_jointly(list(recordings), [], SECTIONS, model_of(PAPER), "test", FRAME)[0]


@pytest.mark.slow
def test_joint_fit_of_a_duty_base_finds_the_loop_and_the_rest(found):
    assert found.sound
    scores = {}
    for i, name in enumerate(found.joint.names):
        section, _, key = name.partition(".")
        estimate = found.fits[section].parameters[key].value
        scores[name] = (estimate - value(TRUE, name)) / found.joint.matrix[i][i]**0.5
    assert {"motor.gain", "motor.max_force"} <= set(scores)
    assert np.sqrt(np.mean(np.square(list(scores.values())))) < 1.6, scores
    assert max(abs(s) for s in scores.values()) < 4.0, scores
    for name, e in found.fits["motor"].parameters.items():
        assert e.identifiable, name
        assert e.std < 0.15 * e.value


@pytest.mark.slow
def test_fitted_file_has_the_form_of_the_recordings(found):
    base = model_of(PAPER)
    written = build_model(found.fits, found.over(base), found.source, joint=found.joint)
    assert set(written.sections) == set(SECTIONS)
    assert written.model.forms["motor"] == "speed"
    assert set(written.model.motor) == {"gain", "max_force"}
    p = vehicle_of(written.model)
    assert (p.body.wheelbase, p.friction.q) == (PAPER.body.wheelbase, PAPER.friction.q)
    assert p.drive == "speed"


def test_start_values_are_within_a_factor_of_three(recordings):
    loop = estimate_speed_loop(recordings, PAPER)
    assert 1.0 / 3.0 < loop.gain / 6.0 < 3.0
    assert 1.0 / 3.0 < loop.max_force / 5.0 < 3.0


@pytest.mark.slow
def test_largest_force_that_is_never_reached_is_not_identified():
    """The negative control: small steps tell the gain alone."""
    gentle = [driven(seed, p=with_values(TRUE, {"motor.max_force": 50.0}), highest=1.2)
              for seed in (5, 6)]
    fit = identify_jointly(gentle, [], SECTIONS, model_of(PAPER), "test", FRAME)[0].fits["motor"]
    assert not fit.parameters["max_force"].identifiable
    assert fit.parameters["gain"].value == pytest.approx(6.0, rel=0.25)


def test_true_model_predicts_the_recordings_better_than_constant_velocity(recordings):
    made = evaluate(TRUE, recordings, reference=FRAME, limit=False)
    model, ctrv = (s.to_json()["1.0"]["pooled"]["vx"] for s in (made.model, made.ctrv))
    assert model < 0.1 * ctrv


@pytest.mark.parametrize("use", [
    lambda rs: evaluate(PAPER, rs), lambda rs: check_drive(rs, PAPER),
    lambda rs: check_inputs(rs, [], PAPER)], ids=["evaluate", "check", "diagnose"])
def test_duty_model_on_a_speed_command_is_refused(recordings, use):
    with pytest.raises(UsageError, match="model paper takes a duty cycle") as refused:
        use(recordings)
    assert "identify all --joint" in refused.value.remedy
    assert "forms.motor = \"speed\"" in refused.value.expected


@pytest.mark.parametrize("use", [
    lambda rs: evaluate(TRUE, rs), lambda rs: check_inputs(rs, [], TRUE),
    lambda rs: identify(rs, model_of(TRUE), joint=True)], ids=["evaluate", "diagnose", "identify"])
def test_speed_model_on_a_duty_cycle_is_refused(recordings, use):
    with pytest.raises(UsageError, match="model vesc takes a commanded speed"):
        use([replace(r, drive="duty") for r in recordings])


@pytest.mark.parametrize("name", ["friction", "motor", "delay"])
def test_sub_models_of_duty_refuse_a_speed_command(recordings, name):
    with pytest.raises(UsageError, match="one by one") as refused:
        identify_per_recording(list(recordings), [], (name,), PAPER, "test", FRAME)
    assert "--joint" in refused.value.remedy


def test_steering_alone_is_fitted_to_a_speed_command(recordings):
    fits = identify_per_recording(list(recordings), [], ("steering",), PAPER, "test", FRAME)[0].fits
    assert fits["steering"].parameters["a_left_rad"].value == pytest.approx(0.31, rel=0.1)


def test_mixed_and_unknown_drives_are_refused(recordings):
    for drive in ("duty", "torque"):
        with pytest.raises(UsageError, match="one form of drive"):
            drive_of([recordings[0], replace(recordings[1], drive=drive)])


def test_base_keeps_its_loop_and_other_submodels_need_it(recordings):
    base = model_of(TRUE)
    assert with_drive_of(base, recordings, SECTIONS) is base
    changed = with_drive_of(model_of(PAPER), recordings, SECTIONS)
    assert msgspec.structs.replace(changed, motor={}, forms={}) == msgspec.structs.replace(
        model_of(PAPER), motor={}, forms={})
    with pytest.raises(UsageError):
        with_drive_of(model_of(PAPER), recordings, ("steering",))


@pytest.mark.slow
@pytest.mark.parametrize(("car", "model", "group", "causes"), [
    (TRUE, with_values(TRUE, {"motor.gain": 3.0}), "speed loop", {}),
    (apply(TRUE, "throttle_delay", k=0.12), TRUE, None, {"throttle_delay": 0.12})],
    ids=["weak gain", "later command"])
def test_diagnosis_finds_what_is_wrong_with_a_loop(car, model, group, causes):
    sets = check_inputs([driven(1, 60.0, car)], [driven(2, p=car)], model)
    assert any("not candidates" in note and "battery_fade" in note for note in sets.notes)
    found = diagnose(model_of(model), model, sets.train, sets.test, reference=FRAME,
                     only=("throttle_delay", "motor_gain", "motor_deadband", "mass"),
                     refit=not causes)
    assert {c.effect for c in found.causes} == set(causes)
    for cause in found.causes:
        assert cause.parameters["k"].value == pytest.approx(causes[cause.effect], rel=0.15)
    if group is not None:
        (claim,) = found.claims
        assert claim.group == group
        after = claim.quantities["force per m/s below the command"]
        assert abs(after.after - 6.0) < 3.0 * after.std
