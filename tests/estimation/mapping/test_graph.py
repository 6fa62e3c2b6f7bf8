"""The pose graph: answers that are known, a loop, and a closure that lies."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.estimation.mapping.graph import Edge, compose_pose, relative_pose, solve

STD = np.array((2e-3, 2e-3, 1e-3))
INFO = np.diag(1.0 / STD**2)


def test_between_and_onto_are_inverse():
    a = np.array((1.0, -2.0, 3.0))
    step = np.array((0.3, 0.1, 0.5))
    assert relative_pose(a, compose_pose(a, step)) == pytest.approx(step)


def test_two_edges_that_disagree_are_met_by_their_weights():
    """One measures 1 m, one of a third of the information 1.4 m: 1.1 m."""
    edges = [Edge(0, 1, np.array((1.0, 0.0, 0.0)), 3.0 * INFO),
             Edge(0, 1, np.array((1.4, 0.0, 0.0)), INFO)]
    found = solve(np.array(((0.0, 0.0, 0.0), (0.7, 0.2, 0.4))), edges)
    assert found.poses[0] == pytest.approx(0.0)
    assert found.poses[1] == pytest.approx((1.1, 0.0, 0.0), abs=1e-9)


def test_what_a_straight_is_short_of_a_closure_is_shared_by_its_steps():
    """Ten steps of 1 m and a closure of 10.2 m, certain: 0.02 m each."""
    edges = [Edge(k, k + 1, np.array((1.0, 0.0, 0.0)), INFO) for k in range(10)]
    edges.append(Edge(0, 10, np.array((10.2, 0.0, 0.0)), 1e6 * INFO))
    found = solve(np.column_stack((np.arange(11.0), np.zeros((11, 2)))), edges)
    assert found.poses[:, 0] == pytest.approx(1.02 * np.arange(11), abs=1e-5)


@pytest.mark.parametrize("lies", [False, True])
def test_a_loop_is_closed_and_a_closure_that_lies_is_not_believed(lies):
    rng = np.random.default_rng(3)
    turn = np.linspace(0.0, 4.0 * np.pi, 200)
    true = np.column_stack((3.0 * np.sin(turn), 3.0 - 3.0 * np.cos(turn), turn))
    poses = [true[0]]
    edges = []
    for a in range(199):
        noise = STD * rng.normal(size=3)
        edges.append(Edge(a, a + 1, relative_pose(true[a], true[a + 1]) + noise, INFO))
        poses.append(compose_pose(poses[-1], edges[-1].step))
    closures = [Edge(a, a + 100, relative_pose(true[a], true[a + 100]), INFO, is_closure=True)
                for a in range(0, 100, 20)]
    if lies:
        closures.append(Edge(10, 60, np.zeros(3), INFO, is_closure=True))
    drifted = np.array(poses)
    found = solve(drifted, edges + closures)
    step = relative_pose(true[80], true[180])
    off, before = (np.abs(relative_pose(p[80], p[180]) - step)[:2].max()
                   for p in (found.poses, drifted))
    assert np.abs(found.poses - true).max() < 0.06
    assert off < 0.006 < 0.012 < before
    weight = found.weight[199:]
    assert (weight[:5] > 0.7).all()
    assert not lies or weight[5] < 1e-3
