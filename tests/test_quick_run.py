"""`slow_except` and `long_except` decide what runs; a busy computer repeats real time."""

from __future__ import annotations

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

@pytest.mark.parametrize("n", [1, 2])
@pytest.mark.slow
@pytest.mark.long_except("1")
def test_more_cases(n): pass
"""


def run(folder: Path, sample: str, *options: str) -> subprocess.CompletedProcess[str]:
    """Run pytest on a sample with the hooks of these tests."""
    hooks = Path(__file__).with_name("conftest.py").read_text()
    assert "/proc/pressure/cpu" in hooks
    (folder / "conftest.py").write_text(hooks.replace("/proc/pressure/cpu", "pressure.txt"))
    (folder / "test_sample.py").write_text(sample)
    marks = ("slow", "slow_except", "long", "long_except", "realtime")
    (folder / "pytest.ini").write_text("\n  ".join(["[pytest]\nmarkers =", *marks]) + "\n")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *options]
    return subprocess.run(command, capture_output=True, text=True, cwd=folder, check=False)


@pytest.mark.slow
@pytest.mark.parametrize(("marks", "selected"), [
    ("not slow", ["test_cases[1]", "test_cases[13]"]),
    ("slow and not long", ["test_slow", "test_cases[2]", "test_more_cases[1]"]),
    ("long", ["test_more_cases[2]"])])
def test_cases_that_are_not_named_are_slow_or_long(tmp_path, marks, selected):
    done = run(tmp_path, SAMPLE, "--collect-only", "-m", marks)
    ids = [line.partition("::")[2] for line in done.stdout.splitlines() if "::" in line]
    assert ids == selected


@pytest.mark.slow
def test_a_name_of_no_case_is_an_error(tmp_path):
    done = run(tmp_path, SAMPLE.replace('"1*"', '"1", "x"'), "--collect-only")
    assert done.returncode != 0
    assert "'x'" in done.stdout + done.stderr


LATE_ONCE = """
import time
from pathlib import Path
import pytest

@pytest.mark.realtime
def test_late_once():
    with Path("runs.txt").open("a") as runs:
        print("run", file=runs)
    time.sleep(0.05)
    Path("pressure.txt").write_text("some avg10=0.00 total={waited}")
    assert Path("runs.txt").read_text().count("run") > 1
"""


@pytest.mark.slow
@pytest.mark.parametrize(("waited", "runs"), [(1_000_000, 2), (0, 1)])
def test_a_failure_in_real_time_is_repeated_only_if_the_computer_was_busy(tmp_path, waited, runs):
    (tmp_path / "pressure.txt").write_text("some avg10=0.00 total=0")
    done = run(tmp_path, LATE_ONCE.format(waited=waited))
    assert (tmp_path / "runs.txt").read_text().count("run") == runs
    assert (done.returncode == 0) == (runs == 2), done.stdout
