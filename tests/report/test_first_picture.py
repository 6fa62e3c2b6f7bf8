"""Each report begins with its picture: the errors of the models, as bars."""

from __future__ import annotations

from dart_lab.study import write_study_page
from dart_lab.study.stages import StageResult

BAR_ROWS = (("error (rms)", "start", "fitted", "constant velocity"),
        ("speed [m/s]", "0.564", "0.448", "0.531"), ("position [m]", "1.43", "0.891", "1.21"))


def test_a_study_begins_with_the_errors_of_its_models(tmp_path):
    results = {"validation": StageResult("validation", "the fit lowers the error", (), BAR_ROWS,
                                         {})}
    text = write_study_page(results, tmp_path / "index.html", "car").read_text()
    first = text.partition("<h2>")[0]
    assert 'class="bars"' in first
    for number in ("0.564", "0.448", "0.891"):
        assert f"<td>{number}<svg" in first
    assert "before bar" in first


def test_a_study_without_validation_has_no_picture(tmp_path):
    results = {"check": StageResult("check", "3 of 3 are good", (), (), {})}
    assert 'class="bars"' not in write_study_page(results, tmp_path / "index.html",
                                                  "car").read_text()
