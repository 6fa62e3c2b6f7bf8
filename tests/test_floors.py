"""Imports go down, never up: the contracts of pyproject.toml, held as a test."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "host" / "dart_hal"
IN_THE_CAR = ("types", "errors", "config", "wire", "vehicle", "links", "actuation", "estimation",
              "recording", "car")


def lint(folder: Path) -> subprocess.CompletedProcess[str]:
    """import-linter over the copy or checkout in ``folder``."""
    if importlib.util.find_spec("importlinter") is None:
        in_ci = os.environ.get("CI", "").lower() in ("1", "true", "yes")
        (pytest.fail if in_ci else pytest.skip)("import-linter is not installed (.[dev])")
    code = "import sys; from importlinter.cli import lint_imports_command; lint_imports_command()"
    return subprocess.run([sys.executable, "-c", code, "--no-cache"], capture_output=True,
                          text=True, cwd=folder, check=False,
                          env={"PYTHONPATH": str(folder / "host"), "PATH": "/usr/bin:/bin"})


def test_the_floors_hold():
    done = lint(ROOT)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-500:]
    assert "0 broken" in done.stdout


def test_a_step_upwards_would_be_seen(tmp_path):
    """The negative control: one import from the ground floor to the roof."""
    shutil.copytree(PACKAGE, tmp_path / "host" / "dart_hal",
                    ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    assert lint(tmp_path).returncode == 0
    with (tmp_path / "host" / "dart_hal" / "types.py").open("a") as types:
        types.write("\nimport dart_hal.cli.main  # noqa\n")
    done = lint(tmp_path)
    assert done.returncode != 0
    assert "dart_hal.types" in done.stdout


def loaded(statement: str) -> set[str]:
    """Modules that a fresh interpreter has after ``statement``."""
    code = f"{statement}\nimport sys; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_import_dart_hal_is_light():
    got = loaded("import dart_hal")
    heavy = {"numpy", "scipy", "matplotlib", "serial", "smbus2", "adafruit_servokit", "board",
             "mcap", "click", "rich", "pandas"}
    assert not heavy & got


@pytest.mark.parametrize("statement", [
    "from dart_hal import Car, Fleet", "import dart_hal.car", "import dart_hal.recording",
    "import dart_hal.actuation", "import dart_hal.links.serial_port", "import dart_hal.vehicle",
    "import dart_hal.estimation", "import dart_hal.calibration", "import dart_hal.control",
])
def test_what_runs_on_the_car_loads_no_plotting_no_fitting_no_servokit(statement):
    got = loaded(statement)
    assert not {"scipy", "matplotlib", "adafruit_servokit", "board", "busio", "pandas"} & got
    assert not {"dart_hal.sim", "dart_hal.cli", "dart_hal.diagnose"} & got


def test_a_simulated_car_in_full_loads_no_plotting_either(tmp_path):
    """Opened and driven: only what moves it."""
    got = loaded("from dart_hal import Car\n"
                 f"with Car.open('sim://?nano=mock', cars={str(tmp_path)!r}) as car:\n"
                 "    next(car.states())")
    assert "dart_hal.sim.world" in got
    assert not {"matplotlib", "pandas", "dart_hal.cli", "dart_hal.sim.truth"} & got
