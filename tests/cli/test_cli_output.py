"""JSON that every reader of JSON takes: a number that is none is null."""

from __future__ import annotations

import dataclasses
import json
import math
from io import StringIO
from pathlib import Path

import msgspec
import numpy as np
import pytest
from rich.console import Console

from dart_hal.car import Car
from dart_hal.cli.common.output import print_json
from dart_hal.cli.top import make_table
from dart_hal.core.plain_json import plain

NOT_FINITE = [math.nan, math.inf, -math.inf, np.float64("nan"), np.float32("inf"),
              np.array(np.nan)]


def no_constants(name: str) -> None:
    raise AssertionError(f"{name} is no JSON")


def print_and_load(value, capsys):
    print_json(value)
    out, err = capsys.readouterr()
    assert err == ""
    return json.loads(out, parse_constant=no_constants)


@pytest.mark.parametrize("value", NOT_FINITE, ids=repr)
def test_what_is_no_number_is_null(value, capsys):
    assert plain(value) is None
    assert print_and_load({"speed": value}, capsys) == {"speed": None}


@pytest.mark.parametrize("value", NOT_FINITE, ids=repr)
def test_so_it_is_however_deep(value, capsys):
    nested = {"a": [1.5, (value, {"b": [value]})], "c": np.array([1.0, np.nan]), "d": {3: value},
              "e": np.array([[np.inf], [2.0]]), "f": frozenset([math.nan])}
    assert print_and_load(nested, capsys) == {
        "a": [1.5, [None, {"b": [None]}]], "c": [1.0, None], "d": {"3": None},
        "e": [[None], [2.0]], "f": [None]}


def test_what_is_a_number_stays_one(capsys):
    value = {"i": np.int64(3), "f": np.float64(0.1), "b": np.bool_(True), "n": None, "big": 1e300,
             "a": np.arange(3), "p": Path("runs") / "a", 7: -0.5}
    assert print_and_load(value, capsys) == {"i": 3, "f": 0.1, "b": True, "n": None, "big": 1e300,
                                             "a": [0, 1, 2], "p": "runs/a", "7": -0.5}


def test_a_name_in_a_table_is_no_markup():
    """Names come from files of recordings, which anyone may have made."""
    with Car.open("sim://?nano=mock&seed=1") as car:
        state = next(car.states())
        car.files = dataclasses.replace(car.files, config=msgspec.structs.replace(
            car.files.config, name="[/] [bold red]x"))
        console = Console(width=120, record=True, file=StringIO())
        console.print(make_table(car, state))
    assert "[/] [bold red]x" in console.export_text()
