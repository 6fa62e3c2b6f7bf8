"""The bench of the light path runs, with tiny sizes, and gives each row its own name."""

from __future__ import annotations

import math

import bench_light
import pytest


@pytest.mark.slow
def test_rows():
    pytest.importorskip("gymnasium", reason="needs the extra gym")
    rows = bench_light.figures(0.002)
    assert len({f.name for f in rows}) == len(rows) == 10
    assert all(math.isfinite(f.value) and f.value > 0.0 for f in rows)


def test_missing_gymnasium_is_reported(monkeypatch):
    import sys

    for name in [m for m in sys.modules if m.startswith("dart_lab.sim.gym")]:
        monkeypatch.delitem(sys.modules, name)
    for name in ("gymnasium", "gymnasium.envs", "gymnasium.envs.registration"):
        monkeypatch.setitem(sys.modules, name, None)
    last = bench_light.figures(0.002)[-1]
    assert math.isnan(last.value)
    assert "gymnasium" in last.note
