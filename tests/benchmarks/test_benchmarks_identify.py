"""The paper's optimiser compared with ours: same problems, and it ends where the paper's did."""

from __future__ import annotations

import adam
import bench_identify
import numpy as np
import pytest

from dart_lab.identification.paper import fit_as_paper
from tests.common import EXCERPT


@pytest.fixture(scope="module")
def make_fit():
    return fit_as_paper(EXCERPT, ["motor", "tyres"])


@pytest.mark.slow
def test_adam_stops_where_the_paper_stopped(make_fit):
    """500 steps give the paper's unconverged motor: the comparison is with its own settings."""
    run = adam.adam(make_fit.problems["motor"], None)
    assert run.x == pytest.approx([28.866, 5.948, -.1496], rel=1e-3)
    assert run.loss == pytest.approx(.1610, abs=1e-4)
    assert run.loss > 1.1 * make_fit.fits["motor"].loss


@pytest.mark.slow
def test_more_steps_reach_our_optimum(make_fit, monkeypatch):
    monkeypatch.setitem(adam.SETTINGS, "motor", adam.Settings(5000, 0.01, (0.95, 0.5, 0.5)))
    run = adam.adam(make_fit.problems["motor"], None)
    assert run.x == pytest.approx([21.071, 3.520, -.1214], rel=1e-3)
    assert run.loss == pytest.approx(make_fit.fits["motor"].loss, rel=1e-4)


@pytest.mark.slow
def test_torch_takes_the_same_steps(make_fit):
    torch = adam.torch_or_none()
    if torch is None:
        pytest.skip("torch is not installed (pip install 'dart-hal[bench]')")
    for name in ("tyres_front", "tyres_rear_offset"):
        with_tape, by_hand = (adam.adam(make_fit.problems[name], t) for t in (torch, None))
        assert with_tape.loss == pytest.approx(by_hand.loss, rel=1e-4)
        assert with_tape.x == pytest.approx(by_hand.x, rel=1e-2)


@pytest.mark.slow
def test_every_row_is_there(monkeypatch):
    monkeypatch.setattr(bench_identify, "recordings", lambda: EXCERPT)
    rows = {f.name: f for f in bench_identify.figures(0.01)}
    assert len(rows) == 2 + len(adam.SETTINGS)
    assert all(np.isfinite(f.value) and f.value > 0.0 for f in rows.values())
    assert rows["identify all --as-paper: CPU with start and reading"].high == 2.0
