"""A sentence and the table below it state the same, and a verdict hides no dropped candidate."""

from __future__ import annotations

import json
import math
import re
import warnings
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from dart_hal.vehicle.load import find_model
from dart_lab.diagnosis import conclude as conclusion
from dart_lab.diagnosis import diagnose
from dart_lab.diagnosis.gains import _relative_reduction
from dart_lab.diagnosis.report.explain import describe_cause
from dart_lab.diagnosis.report.page import page
from dart_lab.diagnosis.report.summary import headline
from dart_lab.diagnosis.result import Considered, Possible
from dart_lab.pages.diagnose_table import show_full
from dart_lab.report.numbers import percent, significant
from tests.diagnosis import made_by_hand as made
from tests.diagnosis.searched import drive


@pytest.fixture(scope="module")
def turned_marker():
    """A marker that is turned: no motion of the car, so a prediction alone gains nothing."""
    file, p = find_model("paper")
    train, test = (drive(("mocap_yaw", 0.05), seconds=24.0, seed=s) for s in (3, 4))
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        return diagnose(file, p, [train], [test], refit=False, only=("mocap_yaw",))


def gains_by_table(d):
    """By cause, the number of its sentence and that of the errors step by step."""
    out = {}
    for i, cause in enumerate(d.causes):
        before, after = (s.horizons["1.0"]["pooled"] for s in d.stages[i:i + 2])
        name = cause.gain.channel
        out[cause.effect] = (cause.gain.test, 1.0 - after[name] / before[name])
    return out


@pytest.mark.slow
def test_sentence_and_table_state_one_number(turned_marker, capsys):
    d = turned_marker
    assert [c.effect for c in d.causes] == ["mocap_yaw"]
    sentence, shown = gains_by_table(d)["mocap_yaw"]
    assert sentence == pytest.approx(shown, abs=1e-9)
    assert sentence > 0.3
    document = json.loads(json.dumps(d.to_json()))
    by_json = [s["errors"]["1.0"]["pooled"]["vy"] for s in document["stages"]]
    assert document["causes"][0]["gain"]["test"] == pytest.approx(1.0 - by_json[1] / by_json[0])
    show_full(d)
    text = " ".join(capsys.readouterr().out.split())
    before, after = (significant(v) for v in by_json[:2])
    assert f"lateral velocity error 1 s ahead on the test recordings falls: {before} -> {after}" \
        in text
    assert re.search(rf"lateral velocity \[m/s\] (\S+ )+{re.escape(before)} {re.escape(after)} "
                     rf"-{percent(sentence)}", text)
    whole = page(d)
    assert f"{before}\u00a0\u2192\u00a0{after} m/s" in whole
    assert f"-{percent(sentence)}".replace(" ", "\u00a0") in whole


def test_numbers_of_two_sources_are_distinguished():
    """The control: a diagnosis by hand, whose sentence was written without its table."""
    sentence, shown = gains_by_table(made.diagnosis(causes=1))["steering_lag"]
    assert sentence != pytest.approx(shown, abs=0.01)


GATE = Considered("steering_lag", 0.12, 161.0, "its gain is below the threshold of chance")
BELOW_CHANCE = Considered("grip", 0.9, 3.0, "its gain is below the threshold of chance")
POSSIBLE = Possible("mass", "is heavier", 0.9, 40.0, "it does not surely lower errors")


@pytest.mark.parametrize("kind", ["unexplained", "nothing_wrong", "partly_explained"])
@pytest.mark.parametrize(("considered", "possible", "named"), [
    ((GATE, BELOW_CHANCE), (), "its gain is below the threshold of chance"),
    ((BELOW_CHANCE,), (POSSIBLE,), "it does not surely lower errors")])
def test_page_states_below_the_verdict_which_gate_rejected_a_candidate(kind, considered, possible,
                                                                        named):
    d = made.diagnosis(kind, 1 if kind == "partly_explained" else 0, kind != "nothing_wrong")
    d = replace(d, causes=tuple(c for c in d.causes if c.effect == "gyro_scale"),
                considered=considered, possible=possible)
    text = headline(d)
    assert named not in text
    assert named in page(d).partition('id="rejected"')[2]


def test_a_candidate_that_a_gate_dropped_is_never_nothing_wrong():
    question = SimpleNamespace(refit=False)
    assert conclusion._verdict(question, None, (), (), {}, (), (POSSIBLE,)) == "unexplained"
    assert conclusion._verdict(question, None, (), (), {}, (), ()) == "nothing_wrong"
    d = replace(made.diagnosis("unexplained", 0, False), considered=(), possible=(POSSIBLE,))
    assert headline(d).startswith("Something is wrong, possibly the car is heavier (mass), but")


def test_verdict_speaks_of_what_the_section_below_it_shows():
    d = replace(made.diagnosis("partly_explained", 1, False), considered=(), possible=())
    changing = replace(d, causes=(replace(d.causes[0], constancy=made.CHANGES),))
    assert "a pattern without a cause" not in headline(changing)
    assert "the size of steering_lag is not constant" in headline(changing)


def test_gain_of_a_cause_is_the_step_of_the_error_table():
    d = made.diagnosis()
    before, after = (d.stages[k].horizons["1.0"]["pooled"]["yaw_rate"] for k in (1, 2))
    assert f"{significant(before)} -> {significant(after)} rad/s" in describe_cause(d, 0)["Gain"]
    sensor = describe_cause(d, 1)["Gain"]
    before, after = (float(np.sqrt(np.nanmean(s.residuals.sensors[:, 1] ** 2)))
                     for s in d.stages[2:4])
    assert f"gyro error on the test recordings falls: {significant(before)}" in sensor
    assert f"-> {significant(after)} rad/s" in sensor


def test_a_gain_that_may_be_chance_is_no_fall():
    d = made.diagnosis(causes=1)
    may_be_chance = replace(d.causes[0], gain=replace(d.causes[0].gain, low=-0.01, high=0.02))
    assert " falls: " in describe_cause(d, 0)["Gain"]
    assert "does not change significantly" in describe_cause(
        replace(d, causes=(may_be_chance,)), 0)["Gain"]


def test_sizes_of_several_recordings_are_stated_with_their_spread():
    d = made.diagnosis(causes=1)
    several = replace(d.causes[0], sizes={"a": (0.9, 0.05), "b": (1.2, 0.1), "c": (0.1, 0.2)})
    text = describe_cause(replace(d, causes=(several,)), 0)["Why"]
    assert "2 of 3 training recordings need it; sizes are 10 % to 120 % of the fitted one" in text
    assert "probability 0.99" in text
    spread = replace(d.causes[0], sizes={"a": (0.999, 0.05), "b": (1.002, 0.1)})
    text = describe_cause(replace(d, causes=(spread,)), 0)["Why"]
    assert "2 of 2 training recordings need it; sizes are 100 % of the fitted one;" in text


def test_nothing_read_has_no_share_and_no_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        assert math.isnan(_relative_reduction(np.empty(0), np.empty(0)))
