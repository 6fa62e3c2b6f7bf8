"""The page "from a measurement to a named cause" is what a diagnosis does.

A small diagnosis runs under a tracer that writes down in which order the functions of
the page are called for the first time.
"""

from __future__ import annotations

import inspect
import re
import sys
from importlib import import_module

import hidden_drive
import pytest
from handbook import DOCS

from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.load import find_model

PAGE = DOCS / "explanation" / "measurement_to_cause.md"
STEP = re.compile(r"^\d+\. `(dart_\w+\.[\w.]+)`", re.MULTILINE)
MOST = 10


def steps() -> list[str]:
    return STEP.findall(PAGE.read_text(encoding="utf-8"))


def function(name: str):
    """A function or method by its dotted name."""
    parts = name.split(".")
    for cut in range(len(parts) - 1, 0, -1):
        try:
            found = import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for part in parts[cut:]:
            found = getattr(found, part)
        return found
    raise LookupError(name)


def first_calls(names: list[str], work) -> list[str]:
    """Those of some functions that ``work()`` calls, in the order of their first calls."""
    waiting = {inspect.unwrap(function(n)).__code__: n for n in names}
    seen: list[str] = []

    def look(frame, event, arg):
        if event == "call" and frame.f_code in waiting:
            seen.append(waiting.pop(frame.f_code))

    sys.setprofile(look)
    try:
        work()
    finally:
        sys.setprofile(None)
    return seen


def test_there_are_at_most_ten():
    assert 5 <= len(steps()) <= MOST


def test_a_name_that_is_gone_is_seen():
    with pytest.raises(AttributeError):
        function("dart_lab.diagnosis.run.diagnosis")


@pytest.mark.more
def test_a_diagnosis_calls_them_in_this_order(tmp_path):
    car = apply(PAPER, "gyro_scale", k=0.1)
    files = [hidden_drive.write(tmp_path / f"car_1_{seed}.csv", car, seed=seed,
                                plan=hidden_drive.Plan(seconds=40.0)) for seed in (1, 2)]
    found = []

    def work():
        train, test = (function("dart_hal.car.runs.read_any")([f])[0] for f in files)
        found.append(function("dart_lab.diagnosis.run.diagnose")(
            *find_model("paper"), train, test, refit=False, only=("gyro_scale", "grip")))

    assert first_calls(steps(), work) == steps()
    assert [c.effect for c in found[0].causes] == ["gyro_scale"]


def test_another_order_is_seen():
    def work():
        find_model("paper")
        function("dart_hal.vehicle.effects.parse")("gyro_scale:0.1")

    order = ["dart_hal.vehicle.load.find_model", "dart_hal.vehicle.effects.parse"]
    assert first_calls(order[::-1], work) == order
