"""With CI set, a test that needs the emulator may not be skipped."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SAMPLE_TEST = """
import pytest

@pytest.mark.emulator
def test_needs_the_emulator():
    pytest.skip("no simavr here")

def test_needs_recordings():
    pytest.skip("no recordings here")

@pytest.mark.emulator
@pytest.mark.xfail(strict=True)
def test_what_the_emulator_shows_to_be_wrong():
    assert False
"""


@pytest.mark.slow
@pytest.mark.parametrize(("ci", "failed"), [("true", 1), ("", 0)])
def test_a_missing_emulator_fails_on_a_build_server_alone(tmp_path, ci, failed):
    shutil.copy(Path(__file__).with_name("conftest.py"), tmp_path)
    (tmp_path / "test_sample.py").write_text(SAMPLE_TEST)
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers =\n    emulator: x\n")
    done = subprocess.run([sys.executable, "-m", "pytest", "-p", "no:cacheprovider", str(tmp_path)],
                          capture_output=True, text=True, cwd=tmp_path, check=False,
                          env={**os.environ, "CI": ci})
    assert done.returncode == failed, done.stdout
    assert ("1 failed" in done.stdout) == bool(failed)
    assert f"{2 - failed} skipped" in done.stdout
    assert "1 xfailed" in done.stdout
