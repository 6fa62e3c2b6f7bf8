"""Residuals without motion capture: small for the car that drove, and for no other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import apply, catalogue
from dart_lab.identification.evidence import onboard
from dart_lab.identification.evidence.noise import estimate_noise
from dart_lab.identification.evidence.onboard import list_limits
from dart_lab.identification.evidence.onboard_drive import MESSAGES_AHEAD
from dart_lab.identification.evidence.onboard_windows import predict_motion
from dart_lab.identification.evidence.space import MessageTiming
from tests.diagnosis.onboard_files import evidence, record_onboard

ENCODER = slice(0, None, 2)
GYRO_ROWS = slice(1, None, 2)


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return evidence(record_onboard(tmp_path_factory.mktemp("plain"), seed=21))


def size(residuals, columns=slice(None)):
    return float(np.sqrt(np.mean(residuals.motion[:, columns]**2)))


@pytest.mark.slow
def test_the_car_that_drove_is_predicted_to_its_disturbance(plain):
    r = plain.residuals(PAPER)
    assert r.motion.shape == (len(plain.motion_drive), 2 * MESSAGES_AHEAD)
    assert r.sensors.shape == (len(plain.sensor_drive), 4)
    assert size(r, ENCODER) < 0.04
    assert size(r, GYRO_ROWS) < 0.05
    assert [len(b) for b in plain.blocks()] == [len(r.motion), len(r.sensors)]
    assert len(set(plain.blocks(4.0)[0])) < 0.6 * len(set(plain.blocks()[0]))
    assert size(plain.residuals(apply(PAPER, "motor_gain", k=-0.15)), ENCODER) > 0.08
    assert size(plain.residuals(apply(PAPER, "steering_gain", k=0.1)),
                GYRO_ROWS) > 2.0 * size(r, GYRO_ROWS)


@pytest.mark.slow
def test_effects_of_the_mocap_change_nothing_and_all_others_something(plain):
    """What is confounded is found from the equations; here it is measured."""
    base = plain.residuals(PAPER)
    noise = estimate_noise(base, plain.blocks())
    here, _ = noise.stack(base)
    effect_of = {}
    for name, effect in catalogue().items():
        q = effect.parameters[0]
        k = q.null + q.sizes[2] if q.null + q.sizes[2] <= q.high else q.null - q.sizes[2]
        there, _ = noise.stack(plain.residuals(apply(PAPER, name, **{q.name: k})))
        effect_of[name] = float(np.sum((there - here)**2))
    pose_only = {name for name, e in catalogue().items()
                 if set(e.signals) == {"pose"} and e.force is None and e.vehicle is None}
    assert {n for n, change in effect_of.items() if change == 0.0} == pose_only
    assert min(change for n, change in effect_of.items() if n not in pose_only) > 20.0


@pytest.mark.slow
@pytest.mark.parametrize(("name", "k"), [
    ("encoder_scale", 0.04), ("encoder_latency", 0.06), ("gyro_scale", 0.06),
    ("gyro_bias", 0.05), ("gyro_latency", 0.08), ("clock_offset", 0.06)])
def test_a_sensor_that_errs_is_predicted_as_well_once_it_is_known_to(tmp_path, plain, name, k):
    """Its error is in the start of every window, too, and is taken off there."""
    wrong = evidence(record_onboard(tmp_path, apply(PAPER, name, k=k), seed=21))
    known = size(wrong.residuals(apply(PAPER, name, k=k)))
    assert known == pytest.approx(size(plain.residuals(PAPER)), rel=0.12)
    assert size(wrong.residuals(PAPER)) > 1.15 * known


@pytest.mark.slow
def test_at_rest_a_tilt_and_a_bias_are_measured_at_once(tmp_path):
    tilted = apply(apply(PAPER, "imu_pitch", k=0.05), "gyro_bias", k=0.02)
    of_drive = evidence(record_onboard(tmp_path, tilted, seed=22, seconds=90.0))
    still = np.concatenate([d.at_rest for d in of_drive.drives])
    assert still.sum() > 10

    def mean(p):
        return of_drive.residuals(p).sensors[still].mean(axis=0)

    assert mean(PAPER)[1] == pytest.approx(-0.02, abs=2e-3)
    assert mean(PAPER)[2] == pytest.approx(0.05 * 9.81, abs=0.35)
    assert abs(mean(tilted)[1]) < 2e-3
    assert abs(mean(tilted)[2]) < 0.35


@pytest.mark.slow
def test_the_extra_weight_of_a_car_at_rest_is_known_and_taken_off_again(plain):
    scale = np.array([7.0, 9.0])
    quieter = type(plain)([replace(d, noise_scale=scale) for d in plain.drives], plain.l_r)
    one, other = (e.residuals(PAPER).sensors for e in (plain, quieter))
    at_rest = plain.sensor_at_rest
    assert not np.allclose(one[at_rest, 2], other[at_rest, 2])
    np.testing.assert_allclose(one / plain.noise_scale, other / quieter.noise_scale, rtol=1e-12)
    assert (quieter.noise_scale[~at_rest] == 1.0).all()


@pytest.mark.slow
def test_sensors_that_are_older_than_their_stamps_are_given_their_age(tmp_path):
    recording = record_onboard(tmp_path, seed=23)
    m = recording.messages
    old = replace(recording, messages=replace(
        m, **{k: np.interp(m.t - 0.01, m.t, getattr(m, k)) for k in ("speed", "yaw_rate")}))
    of_drive = evidence(old)
    sizes = {late: size(of_drive.residuals(PAPER, MessageTiming(late)), GYRO_ROWS)
             for late in (-0.01, 0.0, 0.01)}
    assert sizes[0.01] < sizes[0.0] < sizes[-0.01]


@pytest.mark.slow
def test_commands_ahead_of_their_messages_are_a_shorter_delay(plain):
    shorter = replace(PAPER, delay=replace(PAPER.delay, steering_s=PAPER.delay.steering_s - 0.02,
                                           throttle_s=0.0))
    a = plain.residuals(PAPER, MessageTiming(0.0, 0.02))
    assert size(a, GYRO_ROWS) == pytest.approx(size(plain.residuals(shorter), GYRO_ROWS), rel=0.02)
    assert np.abs(a.motion - plain.residuals(PAPER).motion).max() > 0.1


def _forget(evidence):
    evidence._parts_cache.clear()
    evidence._residuals_cache.clear()


@pytest.mark.slow
def test_residuals_are_the_same_every_time(plain):
    a = plain.residuals(PAPER, MessageTiming(0.003))
    _forget(plain)
    b = plain.residuals(PAPER, MessageTiming(0.003))
    assert a is not b
    assert np.array_equal(a.motion, b.motion)
    assert np.array_equal(a.sensors, b.sensors, equal_nan=True)


@pytest.mark.slow
def test_what_is_kept_of_the_servo_is_of_that_servo(plain):
    """After any other request: the residuals of each vehicle, to the last bit."""
    limited = apply(PAPER, "steering_rate_limit", k=0.2)
    lagging = replace(limited, delay=replace(limited.delay, steering_lag_s=0.03))
    cars = (limited, apply(limited, "steering_trim", k=0.05), apply(PAPER, "steering_trim", k=0.05),
            apply(limited, "steering_backlash", k=0.05), apply(PAPER, "steering_rate_limit", k=0.5),
            apply(limited, "pwm_quantisation", k=0.1), lagging)
    kept = [plain.residuals(p).motion for p in cars]
    for p, motion in zip(cars, kept, strict=True):
        _forget(plain)
        assert np.array_equal(plain.residuals(p).motion, motion)
    assert len({motion.tobytes() for motion in kept}) == len(cars)


def test_recordings_without_data_give_no_rows_and_are_reported():
    nothing = evidence()
    r = nothing.residuals(PAPER)
    assert r.motion.shape == (0, 2 * MESSAGES_AHEAD)
    assert r.sensors.shape == (0, 4)
    assert [len(b) for b in nothing.blocks()] == [0, 0]
    assert any("how the car moves" in s for s in list_limits(nothing))

@pytest.mark.slow
@pytest.mark.parametrize(("name", "predictions"), [("imu_yaw", 1), ("imu_pitch", 2)])
def test_motion_is_predicted_once_for_effects_on_the_accelerometer_alone(plain, monkeypatch, name,
                                                                         predictions):
    """Control: a pitched IMU changes the yaw rate too, by which the start is measured."""
    calls = []
    monkeypatch.setattr(onboard, "predict_motion",
                        lambda *given: calls.append(given) or predict_motion(*given))
    _forget(plain)
    plain.residuals(PAPER)
    found = plain.residuals(apply(PAPER, name, k=0.05))
    assert len(calls) == predictions * len(plain.drives)
    _forget(plain)
    again = plain.residuals(apply(PAPER, name, k=0.05))
    assert np.array_equal(again.motion, found.motion)
    assert np.array_equal(again.sensors, found.sensors, equal_nan=True)
