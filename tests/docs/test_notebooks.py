"""The notebooks run from their first cell to their last, and come to what the handbook shows."""

from __future__ import annotations

import re
import sys

import pytest
from handbook import DOCS, ROOT, broken_links

jupytext = pytest.importorskip("jupytext")
sys.path.insert(0, str(DOCS))
import nbformat  # noqa: E402 - after the skip
import notebooks  # noqa: E402
from nbclient.exceptions import CellExecutionError  # noqa: E402

NOTEBOOKS = sorted(notebooks.FOLDER.glob("*.py"))
MAX_BYTES = 700_000
"""Bytes of one with its pictures."""
OUTPUTS = {
    "another_labs_car": r"cause: steering_delay 0\.(?:0[89]|1[0-5])\d "
                        r"[\s\S]*limit = 1\.4[\s\S]*speed \[m/s\] +0\.\d+ +0\.[67]\d +1\.1",
    "calibrate_identify_diagnose": r"steering_lag, k 0\.1[0-3]\d ",
    "exercise_for_a_class": r"diagnose +3 +3 +3 +3 +12",
    "own_controller": r"the paper's +[1-9]\.\d cm rms[^\n]*\nidentified +0\.\d cm rms",
}
"""What each comes to: the late steering is found, and a speed loop predicts a fast drive better
than constant velocity; the lag is found in addition to the model's own, all hidden faults are named
and no other, and contouring control is within 1 cm by the identified model, but not by the
paper's."""


def collect_output(notebook):
    return "\n".join(out.get("text", "") for cell in notebook.cells if cell.cell_type == "code"
                     for out in cell.outputs)


def pictures(notebook):
    return [out.data["image/png"] for cell in notebook.cells if cell.cell_type == "code"
            for out in cell.outputs if "image/png" in out.get("data", {})]


def test_there_is_one_for_each_reader():
    assert {source.stem for source in NOTEBOOKS} == OUTPUTS.keys()


@pytest.mark.parametrize("source", NOTEBOOKS, ids=lambda p: p.stem)
def test_what_is_shown_is_the_text_and_what_came_of_it(source):
    shown = nbformat.read(source.with_suffix(".ipynb"), as_version=4)
    text = notebooks.read(source)
    assert [(c.cell_type, c.source) for c in shown.cells] == [
        (c.cell_type, c.source) for c in text.cells]
    assert re.search(OUTPUTS[source.stem], collect_output(shown))
    assert len(pictures(shown)) >= 2
    assert source.with_suffix(".ipynb").stat().st_size <= MAX_BYTES
    prose = "\n\n".join(c.source for c in text.cells if c.cell_type == "markdown")
    assert broken_links(source, prose) == []
    assert f"`{source.relative_to(ROOT)}`" in prose


@pytest.mark.parametrize("source", NOTEBOOKS, ids=lambda source: source.stem)
@pytest.mark.long
def test_it_runs_from_its_first_cell_to_its_last(source, tmp_path):
    notebook = notebooks.executed(source, tmp_path)
    assert re.search(OUTPUTS[source.stem], collect_output(notebook)), collect_output(notebook)
    assert len(pictures(notebook)) >= 2


@pytest.mark.slow
def test_a_cell_that_fails_is_detected(tmp_path):
    """The control, of Python and of the shell."""
    for cell in ("# %%\n1 / 0\n", '# %% language="sh"\n# dart-hal docter\n'):
        (tmp_path / "x.py").write_text(cell)
        with pytest.raises(CellExecutionError):
            notebooks.executed(tmp_path / "x.py", tmp_path)
