"""Compiled kernels, numpy and floats are one set of equations."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.core.errors import UsageError
from dart_hal.vehicle import PAPER, UPSTREAM_2024, Batch, rollout, stack
from dart_hal.vehicle.batch import car_rollout, car_step
from dart_hal.vehicle.effects import activate, add_effects, find_effect
from dart_hal.vehicle.flat import bind, names, value, with_values
from dart_hal.vehicle.namespace import ARRAY, SCALAR
from dart_hal.vehicle.native import library
from dart_hal.vehicle.native.build import Variant, compile_kernel, compiler
from dart_hal.vehicle.native.call import call
from dart_hal.vehicle.native.emit import body, source
from dart_hal.vehicle.native.kernel import make_native_step
from dart_hal.vehicle.native.model import INPUT_NAMES, STATE_NAMES, evaluate_coefficients, record
from dart_hal.vehicle.parameters import SLIP_FORMS, AxleTyres, SpeedLoop
from dart_hal.vehicle.step import make_car_step, make_motion_step, make_tick_step

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")

LAGS = UPSTREAM_2024.delay
CAPPED = with_values(PAPER, {"tyres.rear_max": 4.0})
LOOP = SpeedLoop(gain=3.0, max_force=4.0)
FORMS = {
    **{f"{type(p.tyres).__name__}-{slip}": replace(p, slip=slip, delay=LAGS)
       for p in (PAPER, UPSTREAM_2024) for slip in SLIP_FORMS},
    "capped": replace(CAPPED, delay=LAGS),
    "no-lag": PAPER,
    "kinematic": replace(PAPER, kind="kinematic", delay=LAGS),
    "kinematic-axle": replace(UPSTREAM_2024, kind="kinematic"),
    "speed-loop": replace(UPSTREAM_2024, motor=LOOP),
    "kinematic-speed-loop": replace(PAPER, kind="kinematic", motor=LOOP, delay=LAGS),
}
FORM = pytest.mark.parametrize("p", FORMS.values(), ids=FORMS)
MOTOR_KEYS = {"duty": ("d",), "speed": ("gain", "max_force")}
N = 37
"""More than one vector and no multiple of it."""


def driving(p, n, seed=0, dtype=np.float64):
    """Random states that the slip angles of the form are made for: forward, or every way."""
    draw = np.random.default_rng(seed)
    low = 0.5 if p.slip == "paper" else -2.0
    state = np.stack([draw.uniform(-5, 5, n), draw.uniform(-5, 5, n), draw.uniform(-9, 9, n),
                      draw.uniform(low, 4, n), draw.uniform(-0.5, 0.5, n),
                      draw.uniform(-4, 4, n), draw.uniform(-0.4, 0.4, n),
                      draw.uniform(-1, 1, n)])
    return state.astype(dtype)


def vary_vehicles(p, n, seed=1):
    """n vehicles that differ in every group of parameters."""
    draw = np.random.default_rng(seed)
    mine = {"body.mass": p.body.mass, "friction.a": p.friction.a,
            **{f"motor.{key}": getattr(p.motor, key) for key in MOTOR_KEYS[p.drive]},
            "steering.k_left": p.steering.k_left, "tyres.front_C": p.tyres.front_C}
    if not isinstance(p.tyres, AxleTyres) and math.isfinite(p.tyres.rear_max):
        mine["tyres.rear_max"] = p.tyres.rear_max
    return stack([with_values(p, {k: v * draw.uniform(0.9, 1.1) for k, v in mine.items()})
                  for _ in range(n)])


def largest_difference(got, expected):
    """Largest difference as a share of the value or of 1."""
    assert got.shape == expected.shape
    assert np.isfinite(expected).all()
    return np.max(np.abs(got - expected) / np.maximum(1.0, np.abs(expected)))


TRANSFER = find_effect("load_transfer")
LOADED = add_effects(UPSTREAM_2024, [activate(TRANSFER, {
    q.name: q.null + q.sizes[-1] for q in TRANSFER.parameters})])


@pytest.mark.parametrize("p", [UPSTREAM_2024, PAPER, CAPPED, LOADED],
                         ids=["axle", "paper", "capped", "load_transfer"])
def test_a_tick_is_that_of_python_to_the_last_bit(p):
    """At rest, in reverse, blocked and sliding."""
    compiled = make_native_step(p, "tick", 1e-3)
    plain = make_tick_step(p, SCALAR, 1e-3)
    draw = np.random.default_rng(4)
    for speed in (0.0, 0.02, 3.0):
        for _ in range(20):
            ranges = 5, 5, 9, speed, 0.5 * speed, 4 * speed, 6, 2
            state = (*(draw.uniform(-1, 1, 8) * ranges), draw.choice((0.0, 8.0)))
            angle = draw.uniform(-0.4, 0.4)
            inputs = math.cos(angle), math.sin(angle)
            for _ in range(5):
                other = plain(*state, *inputs)
                state = compiled(*state, *inputs)
                assert state == other


@pytest.mark.slow_except("37-per-car-PaperTyres-upstream", "1-shared-AxleTyres-all_speeds",
                 "1-shared-kinematic", "37-per-car-speed-loop")
@FORM
@pytest.mark.parametrize("lanes", [False, True], ids=["shared", "per-car"])
@pytest.mark.parametrize("n", [1, N])
def test_one_step_from_random_states(p, lanes, n):
    state = driving(p, n)
    draw = np.random.default_rng(2)
    commands = draw.uniform(-0.5, 0.5, (1, n)), draw.uniform(-1, 1, (1, n))
    vehicle = vary_vehicles(p, n) if lanes else p
    native, numpy = (car_rollout(vehicle, state, *commands, engine=e) for e in
                     ("native", "numpy"))
    assert largest_difference(native, numpy) < 1e-12
    few = state.astype(np.float32)
    expected = numpy
    single = car_rollout(vehicle, few, *(c.astype(np.float32) for c in commands), engine="native")
    assert single.dtype == np.float32
    assert largest_difference(single, expected) < 1e-5


@FORM
@pytest.mark.parametrize("lanes", [False, True], ids=["shared", "per-car"])
@pytest.mark.slow_except("shared*")
def test_two_seconds_of_transients(p, lanes):
    """200 steps under steps and sines of both commands: floats, numpy, kernel.

    Cars that roll and grip: stiff tyres below 0.3 m/s are beyond a step of 10 ms, and
    what goes on then doubles any difference within some steps.
    """
    state = driving(p, N, seed=3)
    t = np.arange(200)[:, None] * 0.01
    phase = np.random.default_rng(4).uniform(0, 6, N)
    state[3], state[4], state[5] = np.abs(state[3]) + 1.0, 0.1 * state[4], 0.2 * state[5]
    throttle = 0.32 + 0.08 * np.sign(np.sin(7 * t + phase))
    steering = 0.4 * np.sin(5 * t + phase)
    vehicle = vary_vehicles(p, N) if lanes else p
    at = [1, 50, 200]
    native, numpy = (car_rollout(vehicle, state, throttle, steering, output_samples=at, engine=e)
                     for e in ("native", "numpy"))
    assert largest_difference(native, numpy) < 1e-12
    if not lanes:
        step = make_car_step(p, math)
        one = tuple(state[:, 5])
        for k in range(200):
            one = step(*one, throttle[k, 5], steering[k, 5])
        assert largest_difference(native[-1, :, 5], np.array(one)) < 1e-12


@FORM
@pytest.mark.parametrize("lanes", [False, True], ids=["shared", "per-car"])
@pytest.mark.slow_except("per-car-PaperTyres-upstream")
def test_rollouts_of_windows(p, lanes):
    """Held inputs and substeps, read at samples in any order and twice."""
    state = driving(p, N, seed=5)[:6]
    draw = np.random.default_rng(6)
    state[3] = np.abs(state[3]) + 0.5
    throttle = draw.uniform(0.1, 0.4, (50, N))
    angle = draw.uniform(-0.3, 0.3, (50, N))
    vehicle = vary_vehicles(p, N) if lanes else p
    at = [50, 0, 7, 7, 20]
    native, numpy = (rollout(vehicle, state, throttle, angle, output_samples=at, engine=e)
                     for e in ("native", "numpy"))
    assert np.array_equal(native[1], state)
    assert largest_difference(native, numpy) < 1e-12


@given(data=st.data())
def test_any_car_at_any_place_of_a_batch(data):
    """A lane does not know its neighbours nor the size of its batch."""
    n = data.draw(st.integers(1, 300))
    i = data.draw(st.integers(0, n - 1))
    p = data.draw(st.sampled_from([FORMS["capped"], UPSTREAM_2024, FORMS["kinematic"]]))
    state = driving(p, n, seed=data.draw(st.integers(0, 99)))
    commands = np.full((3, n), 0.3), np.full((3, n), -0.4)
    whole = car_rollout(p, state, *commands, engine="native")
    alone = car_rollout(p, state[:, i:i + 1], *(c[:, :1] for c in commands), engine="numpy")
    assert largest_difference(whole[:, :, i:i + 1], alone) < 1e-12


def test_a_batch_advances_equally_on_both_engines():
    p = UPSTREAM_2024
    batches = [Batch(p, N, dtype=np.float64, engine=e) for e in ("native", "numpy")]
    assert [b.engine for b in batches] == ["native", "numpy"]
    for b in batches:
        b.state[...] = driving(p, N)
        for tau in (0.3, -0.2):
            b.advance(np.full(N, tau), np.linspace(-1, 1, N), steps=5)
    assert largest_difference(batches[0].state, batches[1].state) < 1e-12


def test_the_step_of_one_car_takes_and_gives_floats():
    state = (1.0, -2.0, 0.5, 1.2, 0.05, 0.7, 0.2, -0.1)
    native, python = (car_step(UPSTREAM_2024, 0.01, engine=e)(*state, 0.3, 0.4)
                      for e in ("native", "numpy"))
    assert all(type(v) is float for v in native)
    assert native == pytest.approx(python, rel=1e-13)


def test_a_rear_tyre_without_end_is_one_without_end():
    """-ffast-math knows no infinity: the kernel gets a number no tyre reaches."""
    state = np.array([[0.0, 0, 0, 2.0, -1.9, 9.0]]).T
    held = np.full((10, 1), 0.3)
    free, numpy = (rollout(PAPER, state, held, held, engine=e) for e in ("native", "numpy"))
    capped = rollout(CAPPED, state, held, held, engine="native")
    assert largest_difference(free, numpy) < 1e-12
    assert largest_difference(free, capped) > 0.1


@pytest.mark.slow
def test_what_is_not_finite_is_left_to_numpy():
    """NaN in one lane stays in that lane; a state that runs away is not made finite."""
    state = driving(PAPER, 3)[:6]
    state[4, 1] = math.nan
    held = np.full((5, 3), 0.2)
    out = rollout(PAPER, state, held, held, engine="native")
    assert np.isnan(out[-1, :3, 1]).all()
    assert np.isfinite(out[:, :, [0, 2]]).all()
    wild = with_values(replace(PAPER, slip="paper"), {"friction.q": -5.0, "friction.c": -5.0})
    start = np.array([[0.0, 0, 0, 4.0, 0, 0]]).T
    many = np.full((400, 1), 1.0), np.zeros((400, 1))
    with np.errstate(all="ignore"):
        runs = [rollout(wild, start, *many, output_samples=[400], engine=e)
                for e in ("native", "numpy")]
    assert [bool(np.isfinite(r[0, 3, 0])) for r in runs] == [False, False]


def test_wrong_requests_are_refused():
    state = driving(PAPER, 3)[:6]
    held = np.zeros((5, 3))
    with pytest.raises(UsageError, match="no engine"):
        rollout(PAPER, state, held, held, engine="cuda")
    with pytest.raises(UsageError, match="cannot be read there"):
        rollout(PAPER, state, held, held, output_samples=[6], engine="native")
    with pytest.raises(UsageError, match="no compiled kernel"):
        Batch(PAPER, 3, dtype=np.float16, engine="native")
    with pytest.raises(UsageError, match="a vehicle for each car"):
        rollout(vary_vehicles(PAPER, 5), state, held, held, engine="native")


def test_other_types_fall_back_silently():
    assert Batch(PAPER, 3, dtype=np.float16).engine == "numpy"


def test_loading_a_kernel_leaves_denormal_numbers_alone():
    """A library linked with -ffast-math switches them off for the whole process."""
    Batch(PAPER, 20, dtype=np.float32, engine="native").advance(np.ones(20), np.ones(20))
    tiny = np.array([2.3e-308])
    assert (tiny / 1024.0)[0] > 0.0
    assert float.fromhex("0x1p-1022") / 2.0 > 0.0


def test_motion_of_floats_equals_a_native_window():
    step = make_motion_step(PAPER, math, 0.0025, 4)
    one = (0.0, 0.0, 0.2, 1.4, 0.02, 0.6)
    got = rollout(PAPER, np.array([one]).T, np.full((1, 1), 0.3), np.full((1, 1), 0.2),
                  engine="native")
    assert got[0, :, 0] == pytest.approx(step(*one, 0.3, 0.2), rel=1e-13)


@pytest.mark.slow
def test_any_step_can_become_a_kernel(tmp_path):
    """Equations composed at run time: here the paper's car with a wind from ahead."""
    def make(symbol, xp):
        step = make_car_step(bind(PAPER, symbol), xp, symbol("dt"))

        def windy(*values):
            x, y, eta, vx, *rest = step(*values)
            return x, y, eta, vx - symbol("wind") * xp.cos(eta) * symbol("dt"), *rest

        return windy

    traced = record("windy", make, STATE_NAMES["car"], INPUT_NAMES["car"])
    path = compile_kernel(source([body(traced)]), Variant(64, False), tmp_path)
    numbers = {name: value(PAPER, name) for name in names(PAPER)} | {"dt": 0.01, "wind": 0.7}
    state = driving(PAPER, 20)
    held = np.full((30, 20), 0.2)
    got = call(library._load_function(path, "windy"), evaluate_coefficients(traced, numbers), state,
               held, held,
               [30], 1)[0]
    step = make(numbers.__getitem__, ARRAY)
    expected = tuple(state)
    for _ in range(30):
        expected = step(*expected, 0.2, 0.2)
    assert largest_difference(got, np.array(expected)) < 1e-12
    calm = car_rollout(PAPER, state, held, held, output_samples=[30], engine="native")[0]
    assert largest_difference(calm, got) > 0.05


def test_an_exponential_that_underflows_costs_no_accuracy():
    """Fast cars: exp(-100 v^2) of the slip angles is far below what a float can hold."""
    state = np.array([[0.0, 0, 0, 8.0, 0.1, 2.0, 0.3, 0.2], [0, 0, 0, 0.0, 0, 0, 0.3, 0.2]]).T
    held = np.full((20, 2), 0.3), np.full((20, 2), 0.2)
    native, numpy = (car_rollout(PAPER, state, *held, engine=e) for e in ("native", "numpy"))
    assert largest_difference(native, numpy) < 1e-12
    single = car_rollout(PAPER, state.astype(np.float32),
                         *(u.astype(np.float32) for u in held), engine="native")
    assert largest_difference(single, numpy) < 2e-5
