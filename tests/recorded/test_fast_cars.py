"""Cars at 3 to 60 m/s: read, judged by their own speed, and no outlier missed."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.core.errors import RecordingError
from dart_hal.recording.check import check
from dart_hal.recording.dart import fit_reference, read
from dart_hal.recording.dart.marker import marker_grid

LATERAL = 1.5  # m/s2 of the weave, so that every speed drives turns to both sides
WEAVE_PERIOD = 12.0  # s
SPEED_AND_PERIOD = (0.8, 0.02)
"""L_x [m], theta [rad] of the markers of the simulated cars."""


def weaving(speed: float, rate: float, schema: str = "C", seconds: float = 60.0,
            seed: int = 0) -> dict[str, np.ndarray]:
    """A car that rolls without slip and weaves: 80 to 120 % of ``speed``, both sides equally."""
    t = np.arange(0.0, seconds, 1.0 / rate)
    fine = np.arange(0.0, seconds, 0.001)
    v = speed * (1.0 + 0.2 * np.sin(2.0 * np.pi * fine / 17.0))
    omega = LATERAL / speed * np.sin(2.0 * np.pi * fine / WEAVE_PERIOD)
    yaw = np.cumsum(omega) * 0.001
    x = np.cumsum(v * np.cos(yaw)) * 0.001
    y = np.cumsum(v * np.sin(yaw)) * 0.001
    lx, theta = SPEED_AND_PERIOD
    rng = np.random.default_rng(seed)
    x, y, yaw, v, omega = (np.interp(t, fine, s) for s in (
        x + lx * np.cos(yaw), y + lx * np.sin(yaw), yaw - theta, v, omega))
    noise = 1e-3 * speed / 3.0
    one = np.ones(len(t))
    table = {"vicon time": 1.7e9 + t, "vicon x": x + rng.normal(0.0, noise, len(t)),
             "vicon y": y + rng.normal(0.0, noise, len(t)),
             "vicon yaw": (yaw + np.pi) % (2.0 * np.pi) - np.pi,
             "throttle": 0.3 * one, "steering": np.sin(2.0 * np.pi * t / WEAVE_PERIOD),
             "safety_value": one}
    if schema == "B":
        held = np.floor(t * 10.0) / 10.0
        table |= {"elapsed time sensors": 100.0 + held, "acc x (IMU)": 0.0 * one,
                  "acc y (IMU)": np.interp(held, t, v * omega),
                  "W (IMU)": np.interp(held, t, omega), "vel encoder": np.interp(held, t, v)}
    return table


@pytest.mark.parametrize("schema", ["B", "C"])
@pytest.mark.parametrize(("speed", "rate"), [
    (3.0, 100.0), (7.9, 100.0), (8.1, 100.0), (13.0, 50.0), (30.0, 20.0), (30.0, 100.0),
    (60.0, 20.0), (60.0, 200.0)])
@pytest.mark.slow_except("8.1-100.0-C")
def test_fast_car_is_read_and_moves(write, schema, speed, rate):
    made = check(read(write(weaving(speed, rate, schema, seconds=30.0))))
    assert made.facts.mocap.bad < 0.05
    assert made.motion.moves
    assert made.facts.mocap.v_x[1] == pytest.approx(1.2 * speed, rel=0.1)
    assert "evaluation" in made.good_for


@pytest.mark.parametrize("speed", [3.0, 30.0])
def test_outliers_are_found_at_every_speed(write, speed):
    table = weaving(speed, 100.0, seconds=10.0)
    clean = read(write(weaving(speed, 100.0, seconds=10.0), "clean.csv"))
    rows = (200, 400, 600)
    for row in rows:
        table["vicon y"][row] += 0.12 if speed < 10.0 else 0.5
    hit = read(write(table))
    assert set(np.flatnonzero(hit.mocap.outlier)) == set(rows)
    assert not clean.mocap.outlier.any(), "negative control: nothing is wrong with the clean drive"


def test_jump_of_the_pose_of_a_fast_car_is_bad(write):
    table = weaving(30.0, 100.0, seconds=10.0)
    table["vicon x"][500:] += 3.0
    g = marker_grid(read(write(table)))
    assert g.bad[495:505].all()
    assert g.bad.mean() < 0.1


def test_recording_with_nearly_all_samples_bad_is_good_for_nothing(write):
    table = weaving(3.0, 100.0, seconds=20.0)
    rng = np.random.default_rng(1)
    table["vicon x"] += rng.choice([-0.3, 0.3], len(table["vicon x"]))
    made = check(read(write(table)))
    assert made.facts.mocap.bad > 0.9
    assert made.good_for == ()
    assert "marked bad" in made.verdict
    assert not any(f.kind == "never_moves" for f in made.findings), "it moves; how cannot be known"


@pytest.mark.parametrize("factor", [1000.0, 100.0])
def test_position_in_another_unit_is_not_taken_for_a_fast_car(write, factor):
    table = weaving(3.0, 100.0, seconds=10.0)
    for column in ("vicon x", "vicon y"):
        table[column] *= factor
    with pytest.raises(RecordingError, match="vicon x"):
        read(write(table))


def test_encoder_in_another_unit_is_not_taken_for_a_fast_car(write):
    table = weaving(3.0, 100.0, "B", seconds=10.0)
    table["vel encoder"] *= 100.0
    with pytest.raises(RecordingError, match="vel encoder"):
        read(write(table))


@pytest.mark.parametrize("speed", [3.0, 30.0])
@pytest.mark.slow_except("3.0")
def test_marker_frame_of_a_large_car_is_fitted(write, speed):
    fitted = fit_reference([read(write(weaving(speed, 100.0)))])
    assert fitted.theta == pytest.approx(SPEED_AND_PERIOD[1], abs=2.6 * fitted.std[1])
    assert fitted.lx == pytest.approx(SPEED_AND_PERIOD[0], abs=2.6 * fitted.std[0])
