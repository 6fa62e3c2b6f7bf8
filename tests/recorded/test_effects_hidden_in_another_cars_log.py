"""A part of the study ``studies/diagnosis/other_car.py``: effects hidden in another car's log."""

from __future__ import annotations

from dataclasses import replace

import pytest

from dart_hal.car.runs import read_any
from dart_hal.vehicle.load import vehicle_of
from dart_lab.importing import read_tables
from studies.diagnosis.other_car import INJECTIONS, fit_model, judge, write_log
from tests.common import ROOT

pytestmark = pytest.mark.slow

LOG = ROOT / "docs" / "notebooks" / "data" / "zheng2022_day1.csv.gz"


@pytest.fixture(scope="module")
def hidden(tmp_path_factory):
    """A function that hides an effect in the log, and judges its diagnosis."""
    folder = tmp_path_factory.mktemp("logs")
    (table,) = read_tables([LOG])
    log = dict(table.columns)
    (recording,), _ = read_any([write_log(log, folder / "log.mcap")])
    model = fit_model(recording)
    frame = replace(recording.marker, source="stated", std=None)

    def judge_injection(name):
        changed = INJECTIONS[name].change(log, vehicle_of(model))
        return judge(name, log, changed, model, frame, folder, {}, ())

    return judge_injection


def test_nothing_is_accepted_in_the_log_as_it_is(hidden):
    assert hidden("nothing").found == {}


@pytest.mark.parametrize("name", ["steering trim", "yaw offset -0.10 rad"])
@pytest.mark.long_except("steering trim")
def test_hidden_effect_is_named_with_its_size_and_nothing_else(hidden, name):
    outcome = hidden(name)
    assert outcome.named, outcome.found
    assert outcome.size_right, outcome.found
    assert not outcome.wrong
