"""`slow_except` decides which cases of a test `make test` runs."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SAMPLE = """
import pytest

@pytest.mark.slow
def test_slow(): pass

@pytest.mark.parametrize("n", [1, 2, 13])
@pytest.mark.slow_except("1*")
def test_cases(n): pass
"""


def run(folder: Path, sample: str, *options: str) -> subprocess.CompletedProcess[str]:
    """Run pytest on a sample with the hooks of these tests."""
    shutil.copy(Path(__file__).with_name("conftest.py"), folder)
    (folder / "test_sample.py").write_text(sample)
    (folder / "pytest.ini").write_text("[pytest]\nmarkers =\n  slow\n  slow_except\n")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *options]
    return subprocess.run(command, capture_output=True, text=True, cwd=folder, check=False)


@pytest.mark.slow
@pytest.mark.parametrize(("marks", "selected"), [
    ("not slow", ["test_cases[1]", "test_cases[13]"]), ("slow", ["test_slow", "test_cases[2]"])])
def test_cases_that_are_not_named_are_slow(tmp_path, marks, selected):
    done = run(tmp_path, SAMPLE, "--collect-only", "-m", marks)
    ids = [line.partition("::")[2] for line in done.stdout.splitlines() if "::" in line]
    assert ids == selected


@pytest.mark.slow
def test_a_name_of_no_case_is_an_error(tmp_path):
    done = run(tmp_path, SAMPLE.replace('"1*"', '"1", "x"'), "--collect-only")
    assert done.returncode != 0
    assert "'x'" in done.stdout + done.stderr
