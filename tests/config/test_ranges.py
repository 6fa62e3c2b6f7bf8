"""Values that are numbers, positive, and impossible: a wrong unit, mostly."""

from __future__ import annotations

from pathlib import Path

import pytest

from dart_hal.config import parse_calibration, parse_config
from dart_hal.errors import ConfigError

CAR = (Path(__file__).parents[2] / "cars" / "dart-01" / "car.toml").read_text(encoding="utf-8")
MAP = ('schema = "dart-hal/calibration/1"\ncar = "x"\n[steering]\n'
       "map = {{ pulse_us = [{a}, 1500, {b}], angle_rad = [-{c}, 0.0, {c}],"
       " std_rad = [0.01, 0.01, 0.01] }}\n")


def test_a_plausible_map_is_taken():
    assert parse_calibration(MAP.format(a=1100, b=1900, c=0.35), "here").steering.map


@pytest.mark.parametrize(("a", "b", "c", "key"), [
    (1100, 1900, 21.0, "angle_rad"), (1100, 18750, 0.35, "pulse_us"),
    (11, 1900, 0.35, "pulse_us")])
def test_degrees_and_tenths_are_refused(a, b, c, key):
    with pytest.raises(ConfigError, match=key):
        parse_calibration(MAP.format(a=a, b=b, c=c), "here")


@pytest.mark.parametrize(("old", "new", "key"), [
    ("edges_per_rev = 20", "edges_per_rev = 0", "edges_per_rev"),
    ("value = 0.0020646", "value = 2.0646", "metres_per_edge")])
def test_rings_that_cannot_be_are_refused(old, new, key):
    assert old in CAR
    with pytest.raises(ConfigError, match=key):
        parse_config(CAR.replace(old, new), "here")
