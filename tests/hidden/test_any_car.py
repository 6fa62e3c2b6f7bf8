"""An unmodified emulated car with its own model is not called wrong; a changed one is."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import any_car
import pytest
from any_car import asked


@pytest.mark.more
@pytest.mark.cpu(240)
@pytest.mark.parametrize(("seed", "options", "silent"), [
    (103, "", True), (103, "&effect=motor_gain:-0.15", False),
    (200, "", True)])  # with an IMU that sits 2.3 deg askew, of which the first drive makes no name
def test_a_car_as_it_was_is_left_in_peace(seed, options, silent):
    answer = asked(seed, options)
    gained = max(g.test for g in answer.found.gain.values())
    assert answer.right or not silent
    if silent:
        assert not answer.found.causes
    else:  # its motor was wrong, as a cause or as a parameter, and that is worth a lot
        named = {c.effect for c in answer.found.causes} | {c.group for c in answer.found.claims}
        assert named & {"motor_gain", "motor", "drive force"}
        assert gained > 0.5


def test_a_count_is_resumed_with_the_cars_that_are_left(tmp_path, monkeypatch, capsys):
    driven = []

    def ask(seed, **_):
        driven.append(seed)
        line = {"seed": seed, "right": seed != 2}
        return SimpleNamespace(line=lambda: line)

    monkeypatch.setattr(any_car, "asked", ask)
    for cars in (2, 3):
        monkeypatch.setattr(sys, "argv", ["any_car.py", "--cars", str(cars), "--first-seed", "1",
                                          "--out", str(tmp_path / "r.jsonl")])
        assert any_car.main() == 0
    assert driven == [1, 2, 3]
    assert capsys.readouterr().out.endswith("2 of 3 silent or parameters only\n")
