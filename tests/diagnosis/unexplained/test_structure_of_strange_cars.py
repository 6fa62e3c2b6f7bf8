"""A car that no effect of the catalogue describes is flagged, and the model itself is not."""

from __future__ import annotations

import pytest

from dart_lab.diagnosis.unexplained.structure import (
    explained_shares,
    find_group_structure,
    find_structure,
    group_residuals,
)
from studies.diagnosis.hidden_drive import Plan
from tests.diagnosis.strange_car import STRANGE_CARS, looked_at, write

LONG_PLAN = Plan(seconds=120.0)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.slow
def test_the_model_itself_leaves_nothing(tmp_path, monkeypatch, seed):
    assert find_structure(*looked_at([write(tmp_path / "a.csv", None, seed, LONG_PLAN,
                                            monkeypatch)])) == ()


@pytest.mark.parametrize("name", STRANGE_CARS)
@pytest.mark.slow
def test_a_strange_car_is_flagged_where_it_is_strange(tmp_path, monkeypatch, name):
    wrap, channels, variables = STRANGE_CARS[name]
    found = find_structure(*looked_at([write(tmp_path / "a.csv", wrap, 5, LONG_PLAN, monkeypatch)]))
    right = [u for u in found if u.channel in channels and set(u.along) & variables]
    assert right
    assert right[0].share > 0.1


@pytest.mark.slow
def test_the_share_is_large_where_it_is_strange_and_small_elsewhere(tmp_path, monkeypatch):
    wrap, *_ = STRANGE_CARS["carpet"]
    share = explained_shares(group_residuals(*looked_at([write(tmp_path / "a.csv", wrap, 5,
                                                               LONG_PLAN,
                                                               monkeypatch)])))
    assert share["v_x"] > 0.3
    assert max(share[name] for name in ("encoder", "gyro", "accel_x", "accel_y")) < 0.1


@pytest.mark.slow
def test_what_the_disturbance_moves_is_no_variable(tmp_path, monkeypatch):
    """A gust that is not in the model accelerates the car: the two go together for no fault."""
    *found, noise = looked_at([write(tmp_path / "a.csv", None, 5, LONG_PLAN, monkeypatch)])
    motion, _ = group_residuals(*found, noise)
    assert not {"acceleration", "yaw_rate"} & set(motion.features)
    assert find_group_structure([motion]) == ()


@pytest.mark.long
def test_of_many_strange_cars_nearly_all_are_flagged_and_none_of_the_plain(tmp_path, monkeypatch):
    def is_flagged(wrap, seed):
        file = write(tmp_path / "a.csv", wrap, seed, LONG_PLAN, monkeypatch)
        return bool(find_structure(*looked_at([file]), seed))

    seeds = range(12)
    strange = [is_flagged(wrap, seed) for wrap, *_ in STRANGE_CARS.values() for seed in seeds]
    assert sum(strange) >= 0.9 * len(strange)
    assert sum(is_flagged(None, seed) for seed in seeds) <= 1
