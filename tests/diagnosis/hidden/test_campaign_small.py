"""A few cases of the campaign from files to verdict, and the laws of its score."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dart_hal.vehicle.effects import catalogue, own_effects
from dart_hal.vehicle.load import find_model
from studies.diagnosis import campaign, claims_checked
from studies.diagnosis.campaign_cases import GROUPS, Case, car, cases, habits, model_file, thinned
from studies.diagnosis.campaign_score import confusion, grades, rows, score
from studies.diagnosis.known_frame import read
from studies.diagnosis.out_of_catalogue import FAMILY, FAR, NEAR
from studies.diagnosis.stranger import Car
from studies.diagnosis.stranger_causes import CAUSES, EITHER_SIGN, SIZES
from studies.diagnosis.stranger_files import Habits, record

CASE_SECONDS = (60.0, 40.0)
ONE_OF_A_KIND = ("large/steering_lag/0", "null/nothing/0", "pair/motor_gain+mocap_offset_y/0",
                 "far/compass_gyro/0", "near/square_cornering/0")
MORE_CASES = ("large/gyro_bias/0", "large/grip/0", "large/mocap_offset_x/0", "near/filtered_gyro/0")
STEP_HABITS = Habits(style="steps")
NOT_HIDDEN = {"encoder_axle"}
"""Effects without a second implementation yet: the campaign never hides them."""


def make_result(*effects, like=(), flagged=False, size=1.0):
    return {"causes": [{"effect": e, "parameters": {"k": {"value": size, "std": 0.1}},
                        "cannot_be_told_from": list(like)} for e in effects],
            "unexplained": [{}] if flagged else []}


def claims(*groups):
    return {"parameters": [{"group": g} for g in groups], "causes": []}


def case(*hidden, group="medium", size=1.0):
    return Case(group, 0, tuple((name, size) for name in hidden))


@pytest.mark.parametrize(("question", "answer", "outcome"), [
    (case("grip"), make_result("grip"), "right"),
    (case("grip"), make_result("mass", like=("grip",)), "right"),
    (case("grip"), make_result("mass", like=("grip", "a", "b", "c")), "wrong"),
    (case("grip"), make_result("mass"), "wrong"),
    (case("grip"), make_result(), "missed"),
    (case("grip"), {"error": "no window"}, "missed"),
    (case(group="null"), make_result(), "right"),
    (case(group="null"), make_result("grip"), "wrong"),
    (case(group="null"), make_result(flagged=True), "missed"),
    (case(group="null"), {"error": "no window"}, "missed"),
    (case("grip", "mass", group="pair"), make_result("mass", "grip"), "right"),
    (case("grip", "mass", group="pair"), make_result("mass", "grip", "gyro_bias"), "wrong"),
    (case("grip", "mass", group="pair"), make_result("grip"), "missed"),
    (case("grip", "mass", group="pair"), make_result("grip", like=("mass",)), "missed"),
    (case("carpet", group="far"), make_result("grip", flagged=True), "right"),
    (case("carpet", group="far"), make_result("grip"), "wrong"),
    (case("carpet", group="far"), make_result(), "missed"),
    (case("cubic_drag", group="near"), make_result("quadratic_drag"), "right"),
    (case("cubic_drag", group="near"), make_result("grip"), "wrong"),
    (case("friction", group="wrong"), claims("friction"), "right"),
    (case("friction", group="wrong"), claims("drive force"), "right"),
    (case("friction", "motor", group="wrong"), claims("drive force"), "right"),
    (case("friction", group="wrong"), claims("friction", "rear tyre"), "wrong"),
    (case("friction", "rear tyre", group="wrong"), claims("friction"), "missed"),
    (case("friction", group="wrong"), claims("friction") | make_result("grip"), "wrong"),
    (case("friction", "grip", group="wrong and one"), claims("friction") | make_result("grip"),
     "right"),
    (case("friction", "grip", group="wrong and one"), claims("friction"), "missed")])
def test_an_answer_is_judged(question, answer, outcome):
    assert score(question, answer).outcome == outcome


def test_interval_of_a_size_holds_the_hidden_one_or_not():
    assert score(case("grip", size=1.16), make_result("grip", size=1.0)).held == (True,)
    assert score(case("grip", size=1.17), make_result("grip", size=1.0)).held == (False,)
    assert score(case("grip"), make_result("mass", like=("grip",))).held == ()


def test_the_size_that_was_found_is_held_against_the_hidden_one():
    assert score(case("grip", size=-0.1), make_result("grip", size=-0.12)).off == pytest.approx(0.2)
    assert score(case("grip", size=-0.1), make_result("grip", size=0.1)).off == pytest.approx(2.0)
    assert score(case("grip"), make_result("mass", like=("grip",))).off is None


def test_a_row_counts_and_meets_its_target():
    of = [(case("grip"), score(case("grip"), make_result("grip")), 2.0)] * 19
    row, = rows([*of, (case("mass"), score(case("mass"), make_result()), 4.0)])
    assert (row.n, row.shares["right"], row.shares["missed"]) == (20, 0.95, 0.05)
    assert row.seconds == pytest.approx(2.1)
    assert row.ok
    low, = rows([*of, *[(case("mass"), score(case("mass"), make_result("grip")), 4.0)] * 2])
    assert low.ok is False
    assert confusion(of)["grip"] == {"grip": 19}


def test_every_effect_has_an_independent_car_of_the_sizes_that_the_catalogue_states():
    for name, sizes in SIZES.items():
        stated = catalogue()[name].parameters[0]
        assert stated.sizes == pytest.approx(sizes), name
        assert (stated.low < 0.0) >= (name in EITHER_SIGN), name
    assert set(CAUSES) == set(SIZES)
    assert set(own_effects()) - NOT_HIDDEN == set(CAUSES), "docs/contributing/recipes.md, An effect"


def test_strange_causes_are_in_no_catalogue_and_families_are():
    assert not (set(FAR) | set(NEAR)) & set(catalogue())
    assert set(FAMILY) == set(NEAR)
    assert set().union(*FAMILY.values()) <= set(catalogue())
    assert len(FAR) >= 16
    assert len(NEAR) >= 12


def test_every_case_is_one_of_its_kind():
    everything = cases()
    assert len({c.key for c in everything}) == len(everything)
    assert {c.group for c in everything} == set(GROUPS)
    assert len(thinned(everything, 3)) == 3 * len(GROUPS)


def test_the_paper_of_the_independent_simulator_is_that_of_the_package(tmp_path):
    path = tmp_path / "stated.toml"
    path.write_text(model_file(0.035))
    _, ours = find_model("paper")
    model, theirs = find_model(path)
    assert theirs.tyres.front_B == pytest.approx(ours.tyres.front_B)
    assert theirs.tyres.rear_cornering_stiffness == pytest.approx(
        ours.tyres.rear_cornering_stiffness)
    assert theirs.motor == ours.motor
    assert theirs.friction == ours.friction
    assert model.friction["a"].std == pytest.approx(0.035 * ours.friction.a)


@pytest.mark.slow
def test_a_seed_writes_one_file(tmp_path):
    texts = [record(tmp_path / f"{i}.csv", Car(), Habits(), 5.0, seed).read_bytes()
             for i, seed in enumerate((1, 1, 2))]
    assert texts[0] == texts[1] != texts[2]


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """The file of the car in which nothing is hidden."""
    path = tmp_path_factory.mktemp("plain") / "b.csv"
    return record(path, Car(), STEP_HABITS, 25.0, 3).read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("name", [*CAUSES, *FAR, *NEAR])
def test_what_is_hidden_shows_in_the_file(tmp_path, plain, name):
    """The negative control of the campaign: a cause that changes nothing could not be found."""
    group = "large" if name in CAUSES else "far" if name in FAR else "near"
    which = next(c for c in cases([group]) if c.hidden[0][0] == name)
    with_it = record(tmp_path / "a.csv", car(which, np.random.default_rng(0)), STEP_HABITS, 25.0, 3)
    assert with_it.read_bytes() != plain


def test_habits_cover_the_ways_of_recording():
    drawn = [habits(c, np.random.default_rng(c.number)) for c in cases(["medium"])]
    assert {h.commands for h in drawn} == {"lockstep", "clock10", "clock20", "anytime"}
    assert {h.place for h in drawn} == {"sep24", "jul24"}
    assert len({h.style for h in drawn}) == 4


def test_without_mocap_the_file_has_ten_columns(tmp_path):
    recording = read(record(tmp_path / "a.csv", Car(), Habits(mocap_columns=False), 10.0, 1))
    assert recording.schema == "A"
    assert len(recording.messages.t) == pytest.approx(100, abs=2)


@pytest.mark.slow
def test_a_run_is_resumed_and_a_crash_is_a_result(tmp_path, monkeypatch, capsys):
    ran = []

    def ask(model: str, train: Path, test: Path, refit: bool):
        ran.append(train.name)
        if len(ran) == 1:
            raise ValueError("oh")
        return make_result()

    real = campaign.run
    monkeypatch.setattr(campaign, "run", lambda c, seconds, asked: real(c, seconds, ask))
    order = ["--only", "null", "--cases", "2", "--seconds", "4", "4", "--jobs", "1", "--json",
             "--out", str(tmp_path / "r.jsonl")]
    assert campaign.main(order) == 0
    assert campaign.main([*order, "--strict"]) == 1, "a crash does not count as silence"
    assert len(ran) == 2
    first, second = map(json.loads, (tmp_path / "r.jsonl").read_text().splitlines())
    assert first["error"] == "ValueError: oh"
    assert second["causes"] == []
    assert '"group": "null"' in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("key", [*ONE_OF_A_KIND, *MORE_CASES])
@pytest.mark.long_except(*ONE_OF_A_KIND)
def test_from_files_to_names(key):
    """With the base as it is: all that is named, nothing where nothing is hidden."""
    one = replace(next(c for c in cases() if c.key == key), base="fixed")
    assert score(one, campaign.run(one, CASE_SECONDS)).outcome == "right"


def test_names_are_counted_by_their_stated_probability():
    result = make_result("grip", "mass")
    for cause, p in zip(result["causes"], (0.99, 0.85), strict=True):
        cause["probability"] = p
    assert grades([(case("grip"), result)]) == [(0.99, True), (0.85, False)]
    assert grades([(case(group="null"), result)]) == [(0.99, False), (0.85, False)]
    assert grades([(case("carpet", group="far"), result)]) == []


@pytest.mark.slow
def test_a_claim_states_the_truth_about_itself():
    """Its cost on a recording five times as long, and its probability by all sets of groups."""
    line = claims_checked.run(cases(["wrong"], (), 2000)[0], sets=True)
    assert all(abs(search - every) < 0.05 for search, every in line["sets"].values())
    (cost,) = line["costs"].values()
    assert cost["shown"]
    assert cost["ci90"][0] < cost["long"] < cost["ci90"][1]
