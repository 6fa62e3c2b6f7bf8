"""Equations run on symbols give a graph that computes what they compute."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from dart_hal.vehicle import PAPER, UPSTREAM_2024, make_car_step, make_motion_step
from dart_hal.vehicle.flat import names, value
from dart_hal.vehicle.namespace import SCALAR
from dart_hal.vehicle.native.emit import body
from dart_hal.vehicle.native.model import (
    DT_SYMBOL,
    STATE_NAMES,
    STEP_FACTORIES,
    coefficients,
    form_of,
    split,
    trace,
)
from dart_hal.vehicle.native.trace import Graph, evaluate, find_dependencies
from dart_hal.vehicle.parameters import AxleTyres

each_vehicle = pytest.mark.parametrize("p",
                                       [PAPER, UPSTREAM_2024, replace(PAPER, kind="kinematic")],
                                       ids=lambda p: f"{p.name}-{p.kind}")
TRACED_VALUES = {"car": (0.3, -1.0, 0.7, 1.4, 0.05, 0.9, 0.2, 0.1, 0.35, -0.2),
                 "motion": (0.3, -1.0, 0.7, 1.4, 0.05, 0.9, 0.3, 0.2),
                 "tick": (0.3, -1.0, 0.7, 1.4, 0.05, 0.9, 3.0, 1.2, 0.5, 0.98, 0.2)}


@each_vehicle
@pytest.mark.parametrize("kind", STATE_NAMES)
@pytest.mark.parametrize("method", ["rk4", "midpoint", "euler"])
def test_the_graph_computes_the_step(p, kind, method):
    traced = trace(form_of(p), kind, method)
    symbols = {**{name: min(value(p, name), 1e30) for name in names(p)}, DT_SYMBOL: 0.01,
               **dict(zip((*traced.states, *traced.inputs), TRACED_VALUES[kind], strict=True))}
    got = evaluate(traced.graph, traced.outputs, symbols, SCALAR)
    assert got == pytest.approx(STEP_FACTORIES[kind](p, math, dt=0.01,
                                                        method=method)(*TRACED_VALUES[kind]),
                                rel=1e-14, abs=1e-14)


def test_equal_expressions_are_one_node():
    graph = Graph()
    x = graph.symbol("x")
    f = graph.namespace()
    assert (f.sin(x) * 2.0).index == (f.sin(x) * 2.0).index
    before = len(graph.nodes)
    assert (x + 0.0).index == (1.0 * x).index == (x - 0.0).index == (x / 1.0).index == x.index
    assert f.tanh(graph.constant(0.5)).index == graph.constant(math.tanh(0.5)).index
    assert len(graph.nodes) <= before + 4     # constants alone
    assert (x - 1.0).index != (1.0 - x).index


@pytest.mark.parametrize("branch", [lambda x: 1.0 if x else 0.0, lambda x: 1.0 if x > 0 else 0.0,
                                    lambda x: max(x, 0.0), lambda x: 0.0 if x <= 1 else x],
                         ids=["truth", "greater", "max", "at most"])
def test_a_branch_is_refused(branch):
    with pytest.raises(TypeError, match="branch"):
        branch(Graph().symbol("x"))


def test_numbers_that_are_not_finite_are_refused():
    with pytest.raises(ValueError, match="inf"):
        Graph().symbol("x") * math.inf


def test_what_depends_on_parameters_alone_leaves_the_loop():
    graph = Graph()
    mass, x, u = (graph.symbol(name) for name in ("mass", "x", "u"))
    f = graph.namespace()
    out = x + u * u * (1.0 / f.exp(mass)) + f.sin(u)
    traced = split("one", graph, ("x",), ("u",), (out.index,))
    assert len(traced.uniform) == 1
    assert evaluate(graph, traced.uniform, {"mass": 2.0}, SCALAR) == [1.0 / math.exp(2.0)]
    hold, step = body(traced).split("INSIDE step_")
    assert "sin" in hold
    assert "sin" not in step.split("void run_")[0]


@each_vehicle
def test_no_parameter_is_lost_on_the_way_to_the_kernel(p):
    """Every number of the vehicle that its motion depends on moves a coefficient."""
    p = replace(p, delay=UPSTREAM_2024.delay)
    traced = trace(form_of(p), "car")
    base = list(coefficients(traced, p, 0.01))
    for name in list_used(p):
        group, _, key = name.partition(".")
        part = getattr(p, group)
        changed = object.__new__(type(part))
        for f in part.__dataclass_fields__:
            number = getattr(part, f)
            object.__setattr__(changed, f, 1.01 * number + 1e-3 if f == key else number)
        assert list(coefficients(traced, replace(p, **{group: changed}), 0.01)) != base, name


def list_used(p):
    rolling = ("body.wheelbase", "body.l_r", "body.mass", "friction.", "motor.", "steering.",
               "delay.steering_lag_s", "delay.throttle_lag_s")
    slipping = (*rolling, "body.l_f", "body.yaw_inertia", "body.front_share", "tyres.")
    expected = rolling if p.kind == "kinematic" else slipping
    skip = ("tyres.rear_max",)
    if not isinstance(p.tyres, AxleTyres):
        expected = tuple(w for w in expected if w != "body.wheelbase" or p.kind == "kinematic")
    return [n for n in names(p) if n.startswith(expected) and n not in skip]


def test_a_kernel_shares_work_between_the_stages():
    """The start of a step needs one sine and one cosine of the yaw, not two of each."""
    traced = trace(form_of(PAPER), "motion")
    ops = [traced.graph.nodes[i].op for i in find_dependencies(traced.graph, traced.outputs)]
    assert (ops.count("sin") - 4, ops.count("cos") - 4) == (1 + 4, 1)   # 4 tyres, one delta


def test_the_two_steps_agree_without_lag():
    car = make_car_step(PAPER, math, 0.01)(*TRACED_VALUES["car"][:6], 0.3, 0.2, 0.3, 0.2)
    from dart_hal.vehicle import make_steering
    motion = make_motion_step(PAPER, math, 0.01)(*TRACED_VALUES["car"][:6], 0.3,
                                                 make_steering(PAPER.steering)(0.2))
    assert car[:6] == pytest.approx(motion, rel=1e-14)


@pytest.mark.parametrize("name", ["h", "real", "not a name"])
def test_names_that_the_text_uses_itself_are_refused(name):
    graph = Graph()
    x = graph.symbol(name)
    u = graph.symbol("u")
    v = graph.symbol("v")
    with pytest.raises(ValueError, match="cannot be a name"):
        body(split("one", graph, (name,), ("u", "v"), ((x + u * v).index,)))
