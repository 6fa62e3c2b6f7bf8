"""A sentence and the table below it say the same, and a verdict hides no dropped candidate."""

from __future__ import annotations

import json
import math
import re
import warnings
from dataclasses import replace
from types import SimpleNamespace

import made_by_hand as made
import numpy as np
import pytest
from searched import drive

from dart_hal.cli.diagnose_table import show
from dart_hal.diagnose import conclude as conclusion
from dart_hal.diagnose import diagnose
from dart_hal.diagnose.gains import _share
from dart_hal.diagnose.report.page import page
from dart_hal.diagnose.report.words import sentence, verdict
from dart_hal.diagnose.result import Considered, Possible
from dart_hal.report.numbers import percent
from dart_hal.vehicle.load import find_model


@pytest.fixture(scope="module")
def turned_marker():
    """A marker that is turned: no motion of the car, so a prediction alone gains nothing."""
    file, p = find_model("paper")
    train, test = (drive(("mocap_yaw", 0.05), seconds=24.0, seed=s) for s in (3, 4))
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        return diagnose(file, p, [train], [test], refit=False, only=("mocap_yaw",))


def gains_by_table(d):
    """By cause, what its sentence says and what the errors step by step say."""
    out = {}
    for i, cause in enumerate(d.causes):
        before, after = (s.horizons["1.0"]["pooled"] for s in d.stages[i:i + 2])
        name = cause.gain.channel
        out[cause.effect] = (cause.gain.test, 1.0 - after[name] / before[name])
    return out


@pytest.mark.more
def test_sentence_and_table_state_one_number(turned_marker, capsys):
    d = turned_marker
    assert [c.effect for c in d.causes] == ["mocap_yaw"]
    said, shown = gains_by_table(d)["mocap_yaw"]
    assert said == pytest.approx(shown, abs=1e-9)
    assert said > 0.3
    document = json.loads(json.dumps(d.to_json()))
    by_json = [s["errors"]["1.0"]["pooled"]["vy"] for s in document["stages"]]
    assert document["causes"][0]["gain"]["test"] == pytest.approx(1.0 - by_json[1] / by_json[0])
    show(d)
    text = " ".join(capsys.readouterr().out.split())
    number = percent(said)
    assert f"removes {number}" in text
    assert re.search(rf"lateral velocity: [^:]*, {number} ", text)
    assert f"removes {number}" in page(d)


def test_numbers_of_two_sources_are_told_apart():
    """The control: a diagnosis by hand, whose sentence was written without its table."""
    said, shown = gains_by_table(made.diagnosis(causes=1))["steering_lag"]
    assert said != pytest.approx(shown, abs=0.01)


GATE = Considered("steering_lag", 0.12, 161.0, math.nan, "gains no more than nothing at all might")
FAINT = Considered("grip", 0.9, 3.0, math.nan, "gains no more than nothing at all might")
POSSIBLE = Possible("mass", "is heavier", 0.9, 40.0, "it does not surely lower errors")


@pytest.mark.parametrize("kind", ["unexplained", "nothing_wrong", "partly_explained"])
@pytest.mark.parametrize(("considered", "possible", "named"), [
    ((GATE, FAINT), (), "steering_lag (gains no more than nothing at all might (p = 0.12))"),
    ((FAINT,), (POSSIBLE,), "mass (it does not surely lower errors)")])
def test_verdict_names_the_candidates_that_a_gate_dropped(kind, considered, possible, named):
    d = made.diagnosis(kind, 1 if kind == "partly_explained" else 0, kind != "nothing_wrong")
    d = replace(d, causes=tuple(c for c in d.causes if c.effect == "gyro_scale"),
                considered=considered, possible=possible)
    text = verdict(d)
    assert named in text
    assert "grip" not in text
    assert "o effect of the catalogue" not in text


def test_a_candidate_that_a_gate_dropped_is_never_nothing_wrong():
    question = SimpleNamespace(refit=False)
    assert conclusion._verdict(question, None, (), (), {}, (), (POSSIBLE,)) == "unexplained"
    assert conclusion._verdict(question, None, (), (), {}, (), ()) == "nothing_wrong"
    d = replace(made.diagnosis("unexplained", 0, False), considered=(), possible=(POSSIBLE,))
    assert verdict(d).startswith("Something is wrong, possibly mass, but")


def test_verdict_says_that_the_catalogue_has_none_where_no_candidate_was_dropped():
    """The control."""
    d = replace(made.diagnosis("unexplained", 0, True), considered=(FAINT,), possible=())
    assert "No effect of the catalogue explains how" in verdict(d)


def test_verdict_speaks_of_what_the_section_below_it_shows():
    d = replace(made.diagnosis("partly_explained", 1, False), considered=(), possible=())
    changing = replace(d, causes=(replace(d.causes[0], constancy=made.CHANGES),))
    assert "something is left" not in verdict(changing)
    assert "the size of steering_lag is not constant" in verdict(changing)


def test_sentence_says_of_what_each_number_is():
    text = sentence(made.diagnosis().causes[0])
    assert "removes 41 % [36 %, 47 %] of the yaw rate error" in text
    assert "errors of motion and sensors together are 1.21 [1.14, 1.29] times as large" in text


def test_nothing_read_has_no_share_and_no_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        assert math.isnan(_share(np.empty(0), np.empty(0)))
