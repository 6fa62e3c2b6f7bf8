"""What keeps ``make test`` quick: a test above its CPU seconds fails the run, `few` picks cases."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SAMPLE = """
import time
import pytest

def work(seconds=0.2):
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass

@pytest.fixture(scope="module")
def shared():
    work()

def test_what_others_use_too_is_not_its_own(shared): pass

def test_sleeping_costs_nothing(): time.sleep(0.4)

@pytest.mark.cpu(20)
def test_allowed(): work()

@pytest.mark.more
def test_marked(): work()

@pytest.mark.parametrize("n", [1, 2, 13])
@pytest.mark.few("1*")
def test_cases(n): pass
"""
LATE = "\ndef test_late(): work(0.6)\n"  # late where the machine is four times slower, too
INI = "[pytest]\nmarkers =\n  cpu\n  more\n  few\n"


def run(folder: Path, sample: str, *options: str,
        edit: tuple[str, str] = ("", "")) -> subprocess.CompletedProcess[str]:
    """pytest on a sample, with this suite's hooks; ``edit``: (old, new) text in them."""
    for name in ("conftest.py", "cpu_time.py"):
        (folder / name).write_text(Path(__file__).with_name(name).read_text().replace(*edit))
    (folder / "test_sample.py").write_text(sample)
    (folder / "pytest.ini").write_text(INI)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *options]
    return subprocess.run(command, capture_output=True, text=True, cwd=folder, check=False)


@pytest.mark.more
@pytest.mark.parametrize(("sample", "slow"), [
    pytest.param(SAMPLE, False, marks=pytest.mark.more), (SAMPLE + LATE, True)])
def test_one_that_is_too_slow_and_not_marked_fails_the_run(tmp_path, sample, slow):
    done = run(tmp_path, sample, "--cpu-limit", "0.1", "-m", "not more")
    assert done.returncode == slow, done.stdout
    assert f"{5 + slow} passed, 2 deselected" in done.stdout
    assert done.stdout.count("TOO SLOW") == slow
    assert ("test_late: " in done.stdout) == slow


@pytest.mark.more
def test_a_case_that_is_not_there_is_said(tmp_path):
    done = run(tmp_path, SAMPLE.replace('"1*"', '"1", "x"'), "--collect-only")
    assert done.returncode != 0
    assert "'x'" in done.stdout + done.stderr


@pytest.mark.more
def test_the_table_of_all_characters_is_nobody_s_own(tmp_path):
    """A new checkout has none, and hypothesis makes one for the first test that asks."""
    sample = ("from hypothesis import given, strategies as st\n\n"
              "@given(st.from_regex('[a-z]', fullmatch=True))\ndef test_any(c): pass\n")
    options = ("--cpu-limit", "0.2")
    assert run(tmp_path, sample, *options).returncode == 0
    shutil.rmtree(tmp_path / ".hypothesis")
    done = run(tmp_path, sample, *options, edit=("unicode_data", "other"))
    assert "TOO SLOW" in done.stdout, "the negative control"
