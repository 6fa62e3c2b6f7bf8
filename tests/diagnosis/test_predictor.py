"""The best predictor: effects that help on recordings left out of the fit, and none else."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from tempfile import mkdtemp
from types import SimpleNamespace

import numpy as np
import pytest

from dart_hal.cli.main import main
from dart_hal.core.errors import UsageError
from dart_hal.vehicle import PAPER
from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.flat import value
from dart_hal.vehicle.load import find_model
from dart_lab.diagnosis import diagnose
from dart_lab.diagnosis.error_summaries import geometric_mean
from dart_lab.diagnosis.predictor import _PredictorSearch
from dart_lab.diagnosis.report import page
from dart_lab.diagnosis.report.words import predictor
from dart_lab.diagnosis.write import predictor_model, write_predictor
from dart_lab.pages.diagnose_table import show_full
from studies.diagnosis import hidden_drive
from studies.diagnosis.known_frame import read

SIZE = 2.5
"""N/rad of cornering drag: the car loses .1 m/s more in a second than any refit explains."""


@lru_cache(maxsize=2)
def drives(*, hidden):
    car = apply(PAPER, "cornering_drag", k=SIZE) if hidden else PAPER
    folder = Path(mkdtemp())
    return [read(hidden_drive.write(folder / f"car_1_{seed}.csv", car, seed=seed,
                                    plan=hidden_drive.Plan(seconds=16.0)))
            for seed in (11, 12, 13, 14, 15)]


@lru_cache(maxsize=2)
def diagnose_hidden(*, hidden):
    """Diagnosis of four drives, judged by a fifth; causes are not searched."""
    *train, test = drives(hidden=hidden)
    model, vehicle = find_model("paper")
    return diagnose(model, vehicle, train, [test], max_causes=0, only=("gyro_bias",),
                    predictor=True)


def errors_at_1_s(horizons):
    pooled = horizons["1.0"]["pooled"]
    return np.array([pooled[c] for c in ("vx", "yaw_rate", "position", "yaw_deg")])


@pytest.mark.slow
def test_a_hidden_effect_is_in_the_predictor_and_predicts_a_test_drive():
    d = diagnose_hidden(hidden=True)
    b = d.predictor
    assert list(b.effects) == ["cornering_drag"]
    size = b.effects["cornering_drag"]["k"]
    assert abs(size.value - SIZE) < 3.0 * size.std
    assert size.std < 0.2 * SIZE
    assert b.ratio.high < 0.8
    refitted = d.stages[1]
    assert refitted.label == "refitted"
    assert np.all(errors_at_1_s(b.horizons) < errors_at_1_s(refitted.horizons))
    assert errors_at_1_s(b.horizons)[0] < 0.4 * errors_at_1_s(refitted.horizons)[0]


@pytest.mark.slow
def test_from_six_recordings_on_the_refit_is_the_reported_one(tmp_path, monkeypatch):
    """Also where useless effects were tried before it."""
    monkeypatch.setattr(_PredictorSearch, "candidates",
                        lambda *_: ["cornering_drag", "lateral_pull", "load_transfer"])
    monkeypatch.setattr("dart_lab.diagnosis.predictor.MAX_NEEDLESS_RISE", -1.0)
    *train, test = [read(hidden_drive.write(tmp_path / f"car_1_{seed}.csv", PAPER, seed=seed,
                                            plan=hidden_drive.Plan(seconds=10.0)))
                    for seed in range(21, 28)]
    model, vehicle = find_model("paper")
    d = diagnose(model, vehicle, train, [test], max_causes=0, only=("gyro_bias",), predictor=True)
    assert not d.predictor.effects
    assert d.predictor.vehicle == d.stages[1].vehicle


@pytest.mark.slow
def test_where_nothing_is_hidden_the_refit_is_the_predictor():
    d = diagnose_hidden(hidden=False)
    assert d.predictor.effects == {}
    assert d.predictor.ratio == pytest.approx((1.0, 1.0, 1.0))
    assert errors_at_1_s(d.predictor.horizons) == pytest.approx(
        errors_at_1_s(d.stages[1].horizons), rel=0.05)


@pytest.mark.slow
def test_every_recording_is_left_out_once():
    b = diagnose_hidden(hidden=True).predictor
    assert len(b.left_out) == 4
    for one in b.left_out.values():
        ratios = np.array(one.predictor) / np.array(one.refitted)
        assert one.ratio == pytest.approx(np.exp(np.log(ratios).mean()))
    assert b.ratio.value == pytest.approx(geometric_mean(
        one.ratio for one in b.left_out.values()).value)


def test_the_interval_of_ratios_holds_the_truth_in_nine_of_ten_draws():
    rng = np.random.default_rng(5)
    truth = 0.8
    inside = 0
    for _ in range(1000):
        ratio = geometric_mean(truth * np.exp(rng.normal(0.0, 0.3, size=6)))
        inside += ratio.low < truth < ratio.high
    assert 870 < inside < 930


@pytest.mark.slow
def test_its_file_is_a_model_with_the_same_numbers(tmp_path):
    d = diagnose_hidden(hidden=True)
    train = drives(hidden=True)[:4]
    base, _ = find_model("paper")
    path = write_predictor(d, tmp_path / "predictor.toml", base, train, "command")
    model, vehicle = find_model(path)
    assert model.name == "paper-predictor"
    assert model.provenance["method"] == "best predictor"
    assert list(model.provenance["effects"]) == ["cornering_drag"]
    assert len(model.provenance["files"]) == 4
    for name in ("cornering_drag.k", *d.predictor.parameters):
        assert value(vehicle, name) == pytest.approx(value(d.predictor.vehicle, name), rel=1e-6)
    entry = next(e for e in model.effects if e.name == "cornering_drag").parameters["k"]
    assert entry.std == pytest.approx(d.predictor.effects["cornering_drag"]["k"].std, rel=1e-6)


def test_a_diagnosis_without_one_cannot_write_it():
    from tests.diagnosis import made_by_hand as made

    base, _ = find_model("paper")
    with pytest.raises(ValueError, match="predictor=True"):
        predictor_model(made.diagnosis(), base, [])


@pytest.mark.slow
@pytest.mark.parametrize(("hidden", "sentence"), [
    (True, "Best predictor: with cornering_drag the errors 1 s ahead in recordings left out are "),
    pytest.param(False, "Best predictor: the refitted parameters alone.", marks=pytest.mark.slow)])
def test_terminal_page_and_json_state_the_same(hidden, sentence, capsys):
    d = diagnose_hidden(hidden=hidden)
    show_full(d)
    assert sentence in " ".join(capsys.readouterr().out.split())
    text = page(d)
    assert sentence in text
    assert 'id="predictor"' in text
    answer = json.loads(json.dumps(d.to_json()))["predictor"]
    assert answer["ratio_ci90"] == pytest.approx(d.predictor.ratio[1:])
    assert len(answer["left_out"]) == 4


class FitsOfKnownLoss:
    """Fits whose L depends on the number of effects alone; the first effect is needed least."""

    def __init__(self, criteria):
        self.criteria = criteria

    def fit(self, vehicle, start):
        names = [a.name for a in vehicle.effects]
        return SimpleNamespace(vehicle=vehicle, wald_statistic=lambda parameters: float(
            names.index(parameters[0].partition(".")[0])))

    def judge(self, fit):
        return SimpleNamespace(fit=fit, criterion=self.criteria[len(fit.vehicle.effects)])


@pytest.mark.parametrize(("criteria", "sizes"), [
    ({4: -1.0, 3: -0.95, 2: -0.98, 1: -0.91}, [4, 3, 2, 1]),
    ({4: -0.95, 3: -1.0, 2: -0.89}, [4, 3, 2])])
def test_effects_are_dropped_in_turn_until_errors_are_far_larger(criteria, sizes):
    car = PAPER
    for name in ("cornering_drag", "load_transfer", "rear_saturation", "roll_compliance"):
        car = apply(car, name)
    fits = FitsOfKnownLoss(criteria)
    tried = _PredictorSearch(fits, frozenset()).drop_in_turn(fits.fit(car, None))
    kept = [[a.name for a in one.fit.vehicle.effects] for one in tried]
    assert list(map(len, kept)) == sizes
    assert all(names == kept[0][-len(names):] for names in kept)


@pytest.mark.slow
def test_a_better_fit_without_effects_is_called_one():
    b = diagnose_hidden(hidden=False).predictor
    assert "No effects significantly lower" in predictor(b)
    factors = (0.5, 0.6, 0.5, 0.6)
    left_out = {name: replace(one, predictor=tuple(f * e for e in one.refitted))
                for f, (name, one) in zip(factors, b.left_out.items(), strict=True)}
    text = predictor(replace(b, left_out=left_out))
    assert "fitted with equal weight for each recording: the errors" in text
    assert "are 45 % smaller [" in text
    assert "No effects" not in text


def test_a_page_without_one_has_no_section():
    from tests.diagnosis import made_by_hand as made

    assert 'id="predictor"' not in page(made.diagnosis())


@pytest.mark.slow
def test_two_recordings_are_refused_before_anything_is_searched():
    model, vehicle = find_model("paper")
    one, two, _, _, test = drives(hidden=False)
    with pytest.raises(UsageError, match="too few recordings") as refused:
        diagnose(model, vehicle, [one, two], [test], predictor=True)
    assert refused.value.found.startswith("2 training recording")


@pytest.mark.slow
def test_the_command_line_refuses_it_without_a_refit(tmp_path, capsys):
    files = [r.path for r in drives(hidden=False)]
    with pytest.raises(SystemExit) as ended:
        main(["diagnose", "--no-refit", "--out-predictor", str(tmp_path / "p.toml"),
              "--train", *map(str, files)])
    assert ended.value.code == 2
    assert "a predictor needs a refit" in capsys.readouterr().err
    assert not (tmp_path / "p.toml").exists()


@pytest.mark.slow
def test_the_command_line_writes_it(tmp_path, capsys):
    files = [str(r.path) for r in drives(hidden=True)]
    with pytest.raises(SystemExit) as ended:
        main(["diagnose", "--model", "paper", "--max-causes", "0", "--only", "gyro_bias",
              "--out-predictor", str(tmp_path / "p.toml"), "--json", "--train", *files[:4],
              "--test", files[4]])
    assert ended.value.code == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["predictor"]["model"] == str(tmp_path / "p.toml")
    assert list(answer["predictor"]["effects"]) == ["cornering_drag"]
    _, vehicle = find_model(tmp_path / "p.toml")
    assert [a.name for a in vehicle.effects] == ["cornering_drag"]
