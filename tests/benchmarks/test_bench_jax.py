"""The peer of the simulation on JAX is a car, and both are measured."""

from __future__ import annotations

from math import cos, sin, tan
from types import SimpleNamespace

import pytest
import single_track

SCALAR = SimpleNamespace(sin=sin, cos=cos, tan=tan)


def test_the_peer_turns_as_a_car_with_linear_tyres_does():
    step = single_track.make_step(SCALAR, lambda condition, yes, no: yes if condition else no)
    steering = 0.1
    speed = 3.0
    state = (0.0, 0.0, steering, speed, 0.0, 0.0, 0.0)
    for _ in range(300):
        state = step(state, 0.0, 0.0)
    # steady turn: steering = base yaw_rate / v + (1 / C_F - 1 / C_R) v yaw_rate / (mu g)
    understeer = (1.0 / single_track.C_F - 1.0 / single_track.C_R) / (
        single_track.MU * single_track.GRAVITY)
    base = single_track.L_F + single_track.L_R
    assert state[5] == pytest.approx(steering * speed / (base + understeer * speed**2), rel=1e-3)
    assert state[3] == speed


@pytest.mark.slow
def test_each_figure_is_measured():
    pytest.importorskip("jax")
    import bench_jax

    figures = bench_jax.figures(0.02)
    assert all(f.value > 0.0 for f in figures)
    assert [f.low for f in figures] == [None, None, None, bench_jax.MIN_RATIO]
