"""Every example runs unchanged; the URL alone decides on which car."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"
PROGRAMS = sorted(p for p in EXAMPLES.glob("*.py") if "def control(" not in p.read_text()
                  and "diagnose(" not in p.read_text())  # those have tests of their own
SCRIPTS = sorted(p for p in EXAMPLES.glob("*.py") if "def control(" in p.read_text())
RUN_URLS = ["sim://?seed=2&nano=mock"]


def run(args, folder, url) -> str:
    done = subprocess.run([sys.executable, *map(str, args)], capture_output=True, text=True,
                          cwd=folder, env={**os.environ, "DART_HAL_URL": url}, check=False)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    return done.stdout


def test_there_are_examples_of_both_kinds():
    assert len(PROGRAMS) >= 2
    assert SCRIPTS


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda p: p.stem)
@pytest.mark.slow_except("drive_circle")
def test_a_program(program, tmp_path):
    output = run([program], tmp_path, RUN_URLS[0])
    assert any(c.isdigit() for c in output)


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.stem)
def test_a_script_for_drive(script, tmp_path):
    result = json.loads(run(["-m", "dart_hal.cli.main", "drive", script, "--json"], tmp_path,
                            RUN_URLS[0]))
    assert result["summary"]["distance_m"] > 0.5
    assert result["lost"] == 0


@pytest.mark.emulator
@pytest.mark.slow
def test_an_example_on_the_firmware(tmp_path):
    output = run([EXAMPLES / "drive_circle.py"], tmp_path, "sim://?seed=2")
    assert "turned" in output
    assert float(output.rpartition("turned ")[2].split()[0]) > 2.0


def test_without_gymnasium_the_example_names_what_to_install(tmp_path):
    (tmp_path / "gymnasium.py").write_text("raise ImportError('not installed')\n")
    done = subprocess.run([sys.executable, str(EXAMPLES / "learn_to_follow.py")], cwd=tmp_path,
                          capture_output=True, text=True, check=False,
                          env={**os.environ, "PYTHONPATH": str(tmp_path)})
    assert done.returncode == 1
    assert done.stderr.strip() == "this example needs gymnasium: pip install -e '.[gym]'"
