"""The demo's last chapter: what it hides, what it may know of it, and the real car."""

from __future__ import annotations

import pytest

from dart_hal.core.errors import UsageError
from dart_hal.core.process import jobs
from dart_hal.core.url import Url
from dart_lab.demo import real as demo_real
from dart_lab.demo.diagnosis import (
    MISSING_EFFECTS,
    WRONG_PARAMETERS,
    DiagnosisChapter,
    choose_hidden_effects,
    remove_hidden_effects,
)


def url(text):
    return Url.parse(text)


def test_the_seed_decides_what_is_hidden():
    drawn = {seed: choose_hidden_effects(url(f"sim://?seed={seed}"), seed) for seed in range(1, 40)}
    assert drawn[7] == choose_hidden_effects(url("sim://?seed=7"), 7)
    assert drawn[7][1] != drawn[8][1]
    assert {one.name for _, (one, _) in drawn.values()} == set(MISSING_EFFECTS)
    assert {one.name for _, (_, one) in drawn.values()} == set(WRONG_PARAMETERS)
    tables = MISSING_EFFECTS | WRONG_PARAMETERS
    for text, two in drawn.values():
        assert f"effect={two[0].name}:" in text
        assert f",{two[1].name}:" in text
        for one in two:
            low, high, signed = tables[one.name]
            assert low <= (abs(one.values[0]) if signed else one.values[0]) <= high
    signs = {v.values[0] > 0.0 for _, (_, v) in drawn.values() if WRONG_PARAMETERS[v.name][2]}
    assert signs == {True, False}


def test_an_effect_of_the_url_is_what_is_hidden():
    given = url("sim://?seed=3&effect=steering_lag:0.06,gyro_scale:0.03&nano=mock")
    text, hidden = choose_hidden_effects(given, 3)
    assert {a.name for a in hidden} == {"steering_lag", "gyro_scale"}
    assert Url.parse(text).options == given.options
    healthy = Url.parse(remove_hidden_effects(given))
    assert healthy.options == {"seed": "3", "nano": "mock"}
    assert remove_hidden_effects(url("sim://")) == "sim://"
    with pytest.raises(UsageError):
        choose_hidden_effects(url("sim://?effect=steering_fog:1"), 0)


def test_an_effect_that_no_car_can_have_is_refused_before_anything_is_driven(verb, tmp_path):
    refused = verb("demo", "--url", "sim://?nano=mock&effect=mocap_latency:0.03", "--out",
                   tmp_path / "demo", "--json")
    assert "motion capture" in refused.error["what"]
    assert not (tmp_path / "demo").exists()


def test_what_is_not_named_is_not_called_named():
    class Nothing:
        verdict = "nothing_wrong"
        causes = ()

    hidden = choose_hidden_effects(url("sim://?seed=7"), 7)[1]
    assert not DiagnosisChapter(hidden, Nothing(), {}).found
    assert DiagnosisChapter(hidden, Nothing(), {}).to_json()["named"] is False


def test_the_excerpt_is_found_from_the_sources_or_the_folder_it_is_run_in(tmp_path, monkeypatch):
    shipped = demo_real.find_excerpt()
    assert shipped is not None
    monkeypatch.setattr("dart_hal.__file__", str(tmp_path / "lib" / "site" / "dart_hal" / "x.py"))
    monkeypatch.chdir(tmp_path)
    assert demo_real.find_excerpt() is None
    for name in (*demo_real.TRAIN, *demo_real.TEST):
        (tmp_path / demo_real.FOLDER / name).mkdir(parents=True)
    assert demo_real.find_excerpt() == tmp_path / demo_real.FOLDER


@pytest.mark.long
def test_the_real_car_in_a_process_of_its_own(tmp_path):
    section, result = next(jobs.start_in_background(demo_real.section, demo_real.find_excerpt(),
                                     tmp_path / demo_real.PAGE))
    assert result["verdict"] in ("explained", "partly_explained", "unexplained", "parameters_only")
    assert (tmp_path / demo_real.PAGE).stat().st_size > 10_000
    assert demo_real.PAGE in section
    assert "<svg" in section
    # later days, so a better model in what matters most
    assert result["gain"]["vx"]["test_ci95"][0] > 0.0
    assert result["gain"]["position"]["test_ci95"][0] > 0.0
