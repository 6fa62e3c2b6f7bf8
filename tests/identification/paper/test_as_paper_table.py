"""The published comparison, row by row, on the committed recordings and on the full set."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dart_hal.calibration import curves
from dart_hal.vehicle import PAPER, make_friction, make_motor, make_steering, make_tyres
from dart_lab.identification.filters import smooth
from dart_lab.identification.paper import fit_as_paper, read_folder
from dart_lab.identification.paper.problem import solve
from dart_lab.identification.paper.problems import LABEL_FRICTION, friction_problem, motor_problem

HOME = Path(__file__).resolve().parents[3]
EXCERPT = HOME / "tests" / "recorded" / "data"
DEGREE = math.pi / 180.0

# sub-model: n, loss, {parameter: (value, std)}; tyre values per degree
TABLE = {
    "friction": (1173, .0360688, {"a": (1.7258, .021), "b": (13.148, .86), "c": (.2895, .009)}),
    "motor": (1967, .144374, {"d": (21.070, .53), "e": (3.520, .16), "g": (-.1214, .003)}),
    "steering": (3381, .000401896, {
        "k_left": (1.662, .024), "a_left_rad": (.3284, .002), "s0": (.0194, .002),
        "a_right_rad": (.3784, .002), "k_right": (1.662, .020)}),
    "tyres_rear": (5370, .2234**2, {"rear_cornering_stiffness": (.3851, .0009)}),
    "tyres_rear_offset": (5370, .0487322, {}),
    "tyres_front": (5370, .350213, {"front_D": (3.41, 2.3), "front_C": (.50, None),
                                    "front_B": (.308, .040), "front_E": (-15.8, 3.3)}),
}
ROUNDED = {"tyres_rear": 5e-4}  # the table has its rmse to four digits, not its loss
PUBLISHED_RMSE = {"friction": .1899, "motor": .4019, "steering": .02005, "tyres_rear": .2239,
                  "tyres_front": .6057, "tyres_front_yaw0": .3160}
VARIANTS = {
    "tyres_front_E0": (.5997, {"front_D": 2.419, "front_C": 1.486, "front_B": .2302}),
    "tyres_front_tanh": (.5996, {"front_D": 2.448, "front_B": .3409}),
    "tyres_front_yaw0": (.3076, {"front_D": 2.454, "front_C": 1.228, "front_B": .2270,
                                 "front_E": -.103}),
    "tyres_rear_offset": (.2208, {"rear_cornering_stiffness": .3679}),
}


@pytest.fixture(scope="module", params=[
    "excerpt", pytest.param("full", marks=pytest.mark.recordings)])
def root(request):
    if request.param == "excerpt":
        return EXCERPT
    return request.getfixturevalue("recordings")


@pytest.fixture(scope="module")
def made(root):
    return fit_as_paper(root)


def per_degree(entry):
    return DEGREE if entry.unit in ("1/rad", "N/rad") else 1.0


@pytest.mark.parametrize("name", TABLE)
def test_the_row_of_the_table(made, name):
    n, loss, expected = TABLE[name]
    fit = made.fits[name]
    assert fit.converged
    assert fit.n == n
    assert fit.loss == pytest.approx(loss, rel=ROUNDED.get(name, 1e-4))
    for key, (value, std) in expected.items():
        entry = fit.parameters[key]
        scale = per_degree(entry)
        assert entry.value * scale == pytest.approx(value, abs=0.05 * std if std else 1e-4), key
        if std is not None:
            assert entry.std * scale == pytest.approx(std, rel=0.16), key


@pytest.mark.parametrize("name", PUBLISHED_RMSE)
def test_the_papers_own_values_leave_the_published_rmse(made, name):
    assert made.published[name].rmse == pytest.approx(PUBLISHED_RMSE[name], abs=6e-5)
    assert made.fits[name].rmse <= made.published[name].rmse


@pytest.mark.parametrize("name", VARIANTS)
def test_the_other_forms_of_the_tyres(made, name):
    rmse, expected = VARIANTS[name]
    fit = made.fits[name]
    assert fit.rmse == pytest.approx(rmse, abs=6e-5)
    for key, value in expected.items():
        entry = fit.parameters[key]
        assert entry.value * per_degree(entry) == pytest.approx(value, rel=5e-3), key


def test_both_axles_together_are_the_pooled_rows(made):
    front, rear, both = (made.fits[n] for n in ("tyres_front", "tyres_rear", "tyres"))
    assert both.n == front.n + rear.n
    assert both.loss * both.n == pytest.approx(front.loss * front.n + rear.loss * rear.n)
    assert set(both.parameters) == {*front.parameters, *rear.parameters}


def test_front_d_and_c_are_called_unreported_and_their_product_is_given(made):
    fit = made.fits["tyres"]
    assert fit.at_bound == ("front_C",)
    assert not fit.sound
    assert not fit.parameters["front_D"].identifiable
    assert not fit.parameters["front_C"].identifiable
    product = made.derived["tyres"]["front_stiffness_BCD"]
    assert product.value * DEGREE == pytest.approx(.308 * .5 * 3.41, rel=5e-3)
    assert product.std < 0.1 * product.value < 0.5 * fit.parameters["front_D"].std * product.value


def test_the_delay_of_the_paper_and_what_is_wrong_with_it(made):
    c, fit = made.correlation, made.fits["delay"]
    assert c.lag == 1
    assert c.value[:4] == pytest.approx([.994, 1.0, .998, .986], abs=5e-4)
    assert c.mean_step == pytest.approx(.1506, abs=5e-5)
    assert c.median_step == pytest.approx(.1001, abs=5e-5)
    assert c.peak == pytest.approx(1.235, abs=5e-4)
    assert fit.parameters["steering_s"].value == pytest.approx(.151, abs=5e-4)
    # the error is that of a sample, not zero: it covers both the paper's value and the true step
    assert fit.parameters["steering_s"].std == pytest.approx(.1506 / math.sqrt(12.0), rel=1e-3)


def test_friction_of_the_rubber_floor():
    rows = read_folder(EXCERPT, "10_step_input_data_rubbery_floor")
    plain, variant = (solve(friction_problem(rows, variant=v)) for v in (False, True))
    assert (plain.n, variant.n) == (1458, 877)
    assert list(plain.values().values()) == pytest.approx([1.7335, 11.463, .1829], rel=1e-4)
    assert list(variant.values().values()) == pytest.approx([1.7200, 12.449, .2825], rel=2e-4)
    assert (plain.rmse, variant.rmse) == pytest.approx((.2442, .2082), abs=6e-5)
    motor = solve(motor_problem(rows))
    assert motor.n == 2387
    assert motor.rmse == pytest.approx(.5610, abs=6e-5)
    assert list(motor.values().values()) == pytest.approx([18.866, 2.492, -.1345], rel=3e-4)


def test_the_printed_motor_is_no_optimum(made):
    """Negative control: were the paper's d, e, g the optimum, this comparison could not show it."""
    problem, fit = made.problems["motor"], made.fits["motor"]
    p = PAPER.motor
    printed = np.array([p.d, p.e, p.g])
    assert problem.rmse(printed)**2 > 1.1 * fit.loss
    slope = problem.jacobian(printed).T @ problem.residual(printed)
    at_ours = problem.jacobian(x := np.array(list(fit.values().values()))).T @ problem.residual(x)
    size = np.sqrt(np.diag(problem.jacobian(x).T @ problem.jacobian(x)))
    assert np.max(np.abs(slope) / size) > 1e3 * np.max(np.abs(at_ours) / size)
    gap = (printed - x) / np.sqrt(np.diag(fit.covariance))
    assert np.max(np.abs(gap)) > 10.0


def test_the_motor_labels_were_made_with_another_friction(made):
    """With the published friction instead of the undocumented one the row is not reached."""
    rows = made.rows["motor"]
    problem = motor_problem(rows)
    p = PAPER.friction
    speed = problem.inputs[1]
    other = (problem.target + curves.friction(np.array(LABEL_FRICTION), speed)[0]
             - curves.friction(np.array([p.a, p.b, p.c]), speed)[0])
    loss = solve(replace(problem, target=other)).loss
    assert loss != pytest.approx(.144374, rel=1e-3)


def test_a_few_rows_at_rest_decide_the_motor(made):
    """As in the handbook: a late start is taken for a weak motor."""
    problem = made.problems["motor"]
    throttle, speed = problem.inputs
    keep = ~((throttle > 0.15) & (speed < 0.1))
    assert (~keep).sum() == 45
    moving = solve(replace(problem, inputs=(throttle[keep], speed[keep]),
                           target=problem.target[keep]))
    assert list(moving.values().values()) == pytest.approx([25.7, 5.12, -.134], rel=5e-3)
    assert moving.rmse == pytest.approx(.255, abs=1e-3)


@pytest.mark.slow
def test_smoothing_is_scipys():
    from scipy.signal import savgol_filter

    values = np.cumsum(np.random.default_rng(3).normal(size=200))
    for points, order in ((5, 2), (20, 1), (15, 2)):
        assert smooth(values, points, order) == pytest.approx(
            savgol_filter(values, points, order), abs=1e-9)


CURVES = {
    "friction": (curves.friction, [1.7, 13.0, .3]), "motor": (curves.motor, [21.0, 3.5, -.12]),
    "steering": (curves.steering, [1.6, .33, .02, .38, 1.7]),
    "pacejka": (curves.pacejka, [3.0, .7, 17.0, -3.0]),
    "without E": (curves.pacejka_without_e, [2.4, 1.4, 13.0]),
    "tanh": (curves.saturation, [2.4, 19.0]), "linear": (curves.linear, [22.0]),
    "offset": (curves.linear_with_offset, [22.0, .003])}


@pytest.mark.parametrize("name", CURVES)
def test_analytic_jacobians(name):
    curve, x = CURVES[name]
    inputs = [np.linspace(-.4, .6, 41)] + ([np.linspace(0, 3, 41)] if name == "motor" else [])
    x = np.array(x)
    _, slopes = curve(x, *inputs)
    for i in range(len(x)):
        step = 1e-6 * max(1.0, abs(x[i]))
        up, down = x.copy(), x.copy()
        up[i], down[i] = x[i] + step, x[i] - step
        numeric = (curve(up, *inputs)[0] - curve(down, *inputs)[0]) / (2.0 * step)
        assert slopes[:, i] == pytest.approx(numeric, abs=2e-6 * max(1.0, np.abs(numeric).max()))


def test_curves_are_the_equations_of_the_vehicle():
    p, v, s = PAPER, np.linspace(0.0, 4.0, 17), np.linspace(-1.0, 1.0, 17)
    tau, alpha = np.linspace(0.16, 1.0, 17), np.linspace(-.3, .3, 17)
    f = curves.friction(np.array([p.friction.a, p.friction.b, p.friction.c]), v)[0]
    assert f == pytest.approx(make_friction(p.friction, np)(v))
    m = curves.motor(np.array([p.motor.d, p.motor.e, p.motor.g]), tau, v)[0]
    assert m == pytest.approx(make_motor(p.motor, np)(tau, v), abs=0.02)  # reverse part: a whiff
    k = p.steering
    x = np.array([k.k_left, k.a_left_rad, k.s0, k.a_right_rad, k.k_right])
    assert curves.steering(x, s)[0] == pytest.approx(make_steering(k, np)(s))
    t = p.tyres
    front, rear = make_tyres(t, p.body, np)
    x = np.array([t.front_D, t.front_C, t.front_B, t.front_E])
    assert curves.pacejka(x, alpha)[0] == pytest.approx(front(alpha))
    assert curves.linear(np.array([t.rear_cornering_stiffness]), alpha)[0] == pytest.approx(
        rear(alpha), rel=1e-6)
