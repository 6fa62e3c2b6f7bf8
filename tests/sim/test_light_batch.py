"""Many light cars: each moves as it would alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.core.errors import BadCommand, UsageError
from dart_hal.vehicle import PAPER, SETS, UPSTREAM_2024
from dart_hal.vehicle.flat import with_values
from dart_lab.sim.light import (
    DART_ACTUATORS,
    FIRMWARE,
    RECORDED,
    Disturbance,
    LightBatch,
    LightCar,
    LightConfig,
)
from dart_lab.sim.light.noise import ArrayStream, ScalarStream

ROUGH = LightConfig(sensors=FIRMWARE, actuators=DART_ACTUATORS,
                    disturbance=Disturbance(0.12, 0.12))
OLD = replace(ROUGH, sensors=replace(RECORDED, gyro=replace(RECORDED.gyro, offset_spread=0.01),
                                     mocap=replace(RECORDED.mocap, age=0.023, dropout=0.3)),
              disturbance=Disturbance(0.05, 0.02, 0.0))
LATE = replace(UPSTREAM_2024, delay=replace(UPSTREAM_2024.delay, steering_s=0.034,
                                            throttle_s=0.006))
VEHICLES = {**SETS, "kinematic": replace(UPSTREAM_2024, kind="kinematic"), "late": LATE}


def commands(n, k, seed=0):
    rng = np.random.default_rng([seed, k])
    return rng.uniform(-0.4, 0.7, n), rng.uniform(-1.0, 1.0, n)


@pytest.mark.parametrize("engine", ["auto", "numpy"])
@pytest.mark.parametrize("config", [ROUGH, OLD], ids=["firmware", "recorded"])
@pytest.mark.parametrize("p", VEHICLES.values(), ids=VEHICLES)
@pytest.mark.slow_except("kinematic*")
def test_a_batch_is_its_cars(p, config, engine):
    n = 4
    batch = LightBatch(p, n, replace(config, engine=engine), seed=8)
    cars = [LightCar(p, config, seed=[8, i]) for i in range(n)]
    for k in range(60):
        u, s = commands(n, k)
        readings = batch.drive(u, s, 3)
        alone = [car.drive(u[i], s[i], 3) for i, car in enumerate(cars)]
        np.testing.assert_allclose(np.array(readings).T, alone, atol=1e-9)
        np.testing.assert_allclose(np.array(batch.state).T, [c.state for c in cars], atol=1e-9)


def test_more_cars_change_no_noise():
    few, many = (LightBatch(UPSTREAM_2024, n, ROUGH, seed=8) for n in (3, 50))
    for k in range(30):
        u, s = commands(50, k)
        a, b = few.drive(u[:3], s[:3]), many.drive(u, s)
    np.testing.assert_allclose(np.array(a), np.array(b)[:, :3], atol=1e-11)


@pytest.mark.slow
def test_rows_of_noise_do_not_depend_on_blocks_or_neighbours():
    alone = ScalarStream([1, 2], 3, 2)
    many = ArrayStream([[1, i] for i in range(9000)], 3, 2)
    rows = [[float(v[2]) for v in many.row()] for _ in range(100)]
    assert rows == [alone.row() for _ in range(100)]
    assert rows != [ScalarStream([1, 2], 4, 2).row() for _ in range(100)], "another stream"


def test_cars_of_their_own_parameters():
    masses = [1.4, 1.58, 1.9]
    each = [with_values(UPSTREAM_2024, {"body.mass": m, "friction.a": m}) for m in masses]
    batch = LightBatch(each, 3, ROUGH, seed=2)
    cars = [LightCar(p, ROUGH, seed=[2, i]) for i, p in enumerate(each)]
    for k in range(60):
        u, s = commands(3, k)
        batch.drive(u, s)
        for i, car in enumerate(cars):
            car.drive(u[i], s[i])
    np.testing.assert_allclose(np.array(batch.state).T, [c.state for c in cars], atol=1e-9)
    speeds = batch.state[3]
    assert len(set(np.round(speeds, 6))) == 3


def test_a_reset_of_some_cars_leaves_the_others():
    a, b = (LightBatch(LATE, 5, ROUGH, seed=4) for _ in range(2))
    for k in range(40):
        u, s = commands(5, k)
        ra, rb = a.drive(u, s), b.drive(u, s)
        if k == 20:
            start = np.zeros((6, 2))
            start[3] = 1.0, 1.5
            b.reset(start, np.array([1, 3]))
            assert b.state[3][[1, 3]].tolist() == [1.0, 1.5]
    others = [0, 2, 4]
    np.testing.assert_array_equal(np.array(ra)[1:, others], np.array(rb)[1:, others])
    assert rb.t[[0, 1]].tolist() == pytest.approx([0.4, 0.19])


@pytest.mark.slow
def test_single_precision_is_close():
    for engine in ("auto", "numpy"):
        single, double = (LightBatch(UPSTREAM_2024, 4, replace(ROUGH, dtype=t, engine=engine))
                          for t in ("float32", "float64"))
        for k in range(100):
            u, s = commands(4, k)
            single.drive(u, s)
            double.drive(u, s)
        assert {v.dtype for v in single.state} == {np.dtype(np.float32)}
        np.testing.assert_allclose(np.array(single.state), np.array(double.state), atol=2e-4)


def test_refusals():
    batch = LightBatch(PAPER, 2)
    with pytest.raises(BadCommand):
        batch.advance(np.array([0.1, np.nan]), np.zeros(2))
    with pytest.raises(BadCommand):
        batch.advance(np.zeros(3), np.zeros(2))
    with pytest.raises(UsageError):
        batch.reset(np.zeros((6, 3)))
    for bad in (lambda: LightBatch(PAPER, 0), lambda: LightBatch([PAPER], 2),
                lambda: LightBatch([UPSTREAM_2024, LATE], 2),
                lambda: LightBatch([PAPER, UPSTREAM_2024], 2),
                lambda: LightBatch(PAPER, 2, seed=[1]),
                lambda: LightBatch(PAPER, 2, LightConfig(engine="fortran"))):
        with pytest.raises(UsageError):
            bad()
