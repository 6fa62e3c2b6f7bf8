"""Simulated drives, contests of hypotheses on them, and what is reported about it."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from dart_hal.cli.main import main
from dart_hal.recording.dart.reference import SEP_24
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import apply
from dart_lab.diagnosis.suggest import suggest
from dart_lab.diagnosis.suggest.contest import DriveComparison
from dart_lab.diagnosis.suggest.evidence import LOG_TIMING
from dart_lab.diagnosis.suggest.library import CHOICES, rehearse_choices
from dart_lab.diagnosis.suggest.question import make_question
from dart_lab.diagnosis.suggest.side import RecordingComparison
from dart_lab.diagnosis.suggest.virtual import record
from dart_lab.identification.evidence.drive import prepare_drive
from dart_lab.identification.evidence.residuals import Evidence
from dart_lab.identification.experiment.floor import Floor
from tests.diagnosis.suggest.open_question import (
    DRIVE_COMMANDS,
    LARGE_FLOOR,
    QuestionCase,
    diagnosis,
    record_case,
)

GYRO_CASE = QuestionCase("straight", ("gyro_bias", 0.02), "steering_trim")


@pytest.fixture(scope="module")
def question(tmp_path_factory):
    folder = tmp_path_factory.mktemp("open")
    d = diagnosis(GYRO_CASE, [record_case(folder / "one.csv", GYRO_CASE,
                                          DRIVE_COMMANDS["straight"], 5, False)])
    return d, make_question(d, d.causes[0])


@pytest.fixture(scope="module")
def rollouts():
    (drive,) = rehearse_choices(LARGE_FLOOR, None,
                                tuple(c for c in CHOICES if c.name == "rollouts"))
    return drive


@pytest.mark.slow
@pytest.mark.parametrize("effect", ["", "steering_lag:0.06", "mocap_yaw:0.03", "gyro_scale:0.06"])
def test_a_simulated_drive_is_what_its_own_car_predicts(effect, rollouts):
    name, _, k = effect.partition(":")
    p = apply(PAPER, name, k=float(k)) if name else PAPER
    e = Evidence([prepare_drive(record(p, rollouts.commands[0], SEP_24), PAPER.body.l_r, SEP_24)],
                 PAPER.body.l_r)
    own = e.residuals(p, LOG_TIMING)
    other = e.residuals(apply(PAPER, "steering_gain", k=0.1), LOG_TIMING)
    assert len(own.motion) > 8
    assert np.abs(own.motion).mean() < 0.1 * np.abs(other.motion).mean()
    assert np.nanmax(np.abs(own.sensors[:, :2])) < 0.05


@pytest.mark.slow
def test_a_rival_that_is_the_truth_is_found_at_its_size_and_loses_nothing(question, rollouts):
    _, q = question
    truth = apply(PAPER, "grip", k=-0.12)
    setting = q.settings[0]
    evidence = setting.make_evidence([record(truth, rollouts.commands[0], SEP_24)])
    contest = DriveComparison([RecordingComparison(evidence, setting.noise, PAPER, truth, (), {},
                                                   LOG_TIMING)], PAPER)
    same = contest.fit_confounder("grip")
    other = contest.fit_confounder("quadratic_drag")
    assert same.values["k"] == pytest.approx(-0.12, abs=0.005)
    assert same.separation < 0.3
    assert other.separation > 3.0


@pytest.mark.slow
def test_without_rivals_there_is_nothing_to_suggest(question):
    d, _ = question
    alone = replace(d.causes[0], cannot_be_told_from=())
    assert suggest(replace(d, causes=(alone,))) == ()


@pytest.mark.slow
def test_a_suggestion_is_the_same_again_and_is_json_without_nan(question):
    d, _ = question
    first, again = (suggest(d, floor=Floor(3.0, 3.0), seed=4)[0].to_json() for _ in range(2))
    assert first == again
    text = json.dumps(first, allow_nan=False)
    assert json.loads(text)["drive"] == "standstill"
    assert first["enough"]
    assert first["needs"] == "on-board sensors"
    assert [t["least"] >= 4.0 for t in first["tried"]] == [True]


@pytest.mark.slow
def test_what_no_drive_separates_is_reported_and_not_promised(tmp_path, monkeypatch):
    still = tuple(c for c in CHOICES if c.name == "standstill")
    monkeypatch.setattr("dart_lab.diagnosis.suggest.choose.rehearse_choices",
                        lambda floor, model: rehearse_choices(floor, model, still))
    case = QuestionCase("slow waves", ("steering_lag", 0.06), "steering_delay")
    d = diagnosis(case,
                  [record_case(tmp_path / "one.csv", case, DRIVE_COMMANDS[case.drive], 5, True)])
    (s,) = suggest(d)
    assert not s.enough
    assert "none of 1 drives" in s.sentence()
    assert max(p.after for p in s.pairs) < 1.0
    assert s.by_hand.startswith("Steering steps")


@pytest.mark.slow
def test_data_that_should_have_separated_them_contain_more_than_is_simulated(question):
    d, _ = question
    (s,) = suggest(d, floor=Floor(3.0, 3.0))
    assert max(p.before for p in s.pairs if p.effect == s.cause) < 4.0
    assert s.caution() == ""
    surer = replace(s, pairs=tuple(replace(p, before=14.5) for p in s.pairs))
    assert "(14.5)" in surer.caution()


@pytest.mark.slow
def test_a_rival_that_explains_nothing_needs_no_drive(question):
    d, _ = question
    cause = replace(d.causes[0], cannot_be_told_from=("quadratic_drag",))
    (s,) = suggest(replace(d, causes=(cause,)))
    assert (s.drive, s.commands, s.pairs) == ("", (), ())
    assert "already distinguish" in s.sentence()


@pytest.mark.slow
def test_what_is_printed_drives_and_records(question, tmp_path, monkeypatch, capsys):
    d, _ = question
    (s,) = suggest(d, floor=Floor(3.0, 3.0))
    monkeypatch.chdir(tmp_path)
    for line in s.commands:
        words = line.split()
        assert words[0] == "dart-hal"
        with pytest.raises(SystemExit) as ended:
            main([*words[1:], "--url", "sim://?seed=3&nano=mock", "--json"])
        assert ended.value.code == 0
        result = json.loads(capsys.readouterr().out)
        assert (tmp_path / result["recording"]).stat().st_size > 10_000


@pytest.mark.slow
def test_the_prediction(question):
    (s,) = suggest(question[0], floor=Floor(3.0, 3.0))
    assert s.prediction.channel == "gyro"
    bias, trim = s.prediction.curves.values()
    assert np.mean(bias - trim) == pytest.approx(0.02, abs=0.002)


@pytest.mark.long
def test_every_choice_fits_a_hall_and_the_small_ones_come_first():
    drives = list(rehearse_choices(LARGE_FLOOR))
    assert [d.choice.name for d in drives] == [c.name for c in CHOICES]
    assert [d.seconds for d in drives] == sorted(d.seconds for d in drives)
    assert all(math.isclose(len(c.throttle) * 0.01, c.seconds) for d in drives
               for c in d.commands)
    assert all(np.abs(c.steering).max() <= 1.0 for d in drives for c in d.commands)
