"""Imports go down, neither up nor sideways: the contracts of pyproject.toml, held as a test."""

from __future__ import annotations

import ast
import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.common import ROOT

PACKAGE = ROOT / "host" / "dart_hal"


def lint(folder: Path) -> subprocess.CompletedProcess[str]:
    """import-linter over the copy or checkout in ``folder``."""
    if importlib.util.find_spec("importlinter") is None:
        in_ci = os.environ.get("CI", "").lower() in ("1", "true", "yes")
        (pytest.fail if in_ci else pytest.skip)("import-linter is not installed (.[dev])")
    code = "import sys; from importlinter.cli import lint_imports_command; lint_imports_command()"
    return subprocess.run([sys.executable, "-c", code, "--no-cache"], capture_output=True,
                          text=True, cwd=folder, check=False,
                          env={"PYTHONPATH": str(folder / "host"), "PATH": "/usr/bin:/bin"})


def test_the_contracts_hold():
    done = lint(ROOT)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-500:]
    assert "0 broken" in done.stdout


@pytest.fixture
def empty_packages(tmp_path):
    """The contracts over empty modules of the same names."""
    for module in (ROOT / "host").rglob("*.py"):
        copy = tmp_path / "host" / module.relative_to(ROOT / "host")
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.touch()
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return tmp_path


def add_import(folder: Path, package: str, other: str) -> None:
    """Let a package import another one."""
    path = folder / "host" / package.replace(".", "/") / "__init__.py"
    path.write_text(f"import {other}\n")


@pytest.mark.parametrize(("package", "other"), [
    ("dart_hal.core", "dart_hal.cli"), ("dart_hal.vehicle", "dart_hal.core.ports"),
    ("dart_hal.car", "dart_lab.sim"), ("dart_hal.cli", "dart_lab.diagnosis"),
    ("dart_hal.devices.links", "dart_hal.devices.actuation"),
    ("dart_hal.devices.actuation", "dart_hal.devices.links"),
    ("dart_hal.devices.links", "dart_hal.recording"), ("dart_hal.control", "dart_hal.estimation"),
    ("dart_hal.recording", "dart_hal.devices.links"), ("dart_hal.vehicle", "dart_hal.wire"),
    ("dart_hal.devices.lidar", "dart_hal.car"),
    ("dart_hal.devices.poses", "dart_hal.devices.lidar"),
    ("dart_hal.estimation.localisation", "dart_hal.estimation.mapping"),
    ("dart_lab.sim", "dart_lab.identification"), ("dart_lab.report", "dart_lab.sim"),
    ("dart_lab.identification.submodels", "dart_lab.identification.evaluation"),
    ("dart_lab.identification.prediction", "dart_lab.identification.evaluation"),
    ("dart_lab.diagnosis", "dart_lab.live"),
])
@pytest.mark.slow_except("dart_hal.core-dart_hal.cli")
def test_an_import_up_or_sideways_would_be_detected(empty_packages, package, other):
    """The negative control."""
    add_import(empty_packages, package, other)
    done = lint(empty_packages)
    assert done.returncode != 0
    assert package in done.stdout


@pytest.mark.slow
def test_an_import_down_is_free(empty_packages):
    add_import(empty_packages, "dart_lab.cli", "dart_lab.sim")
    add_import(empty_packages, "dart_lab.sim", "dart_hal.cli")
    done = lint(empty_packages)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-500:]


@pytest.mark.slow
def test_a_package_without_a_layer_would_be_detected(empty_packages):
    (empty_packages / "host" / "dart_hal" / "attic.py").touch()
    assert lint(empty_packages).returncode != 0


def layers_of(package: str) -> list[str]:
    """Layers of a package in its contract, from the top."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    contract = text[text.index(f'containers = ["{package}"]'):]
    return re.findall(r'"(.+)",', contract[contract.index("layers = ["):].partition("\n]")[0])


@pytest.mark.parametrize("package", ["dart_hal", "dart_lab"])
def test_the_page_shows_the_layers_of_the_contract(package):
    text = (ROOT / "docs" / "explanation" / "architecture.md").read_text(encoding="utf-8")
    shown = text.partition(f"### {package}:")[2].partition("```text\n")[2].partition("```")[0]
    lines = [line.partition("  ")[0] for line in shown.splitlines()]
    assert [line for line in lines if line] == layers_of(package)


NO_PACKAGE = {"benchmarks", "contract", "docs", "emulator", "faults", "firmware", "hardware",
              "language", "mutation", "recorded", "soak"}
"""Folders of tests that concern no single package."""


def test_folders_of_tests_have_the_names_of_packages():
    tests = ROOT / "tests"
    folders = {path.relative_to(tests).parts[0] for path in tests.glob("*/**/test_*.py")}
    packages = {path.name for path in (ROOT / "host").glob("dart_*/*") if path.is_dir()}
    assert folders - packages == NO_PACKAGE


def test_studies_import_nothing_of_the_tests():
    wrong = [path for path in (ROOT / "studies").rglob("*.py")
             if re.search(r"^\s*(?:from|import) tests\b", path.read_text(encoding="utf-8"), re.M)]
    assert wrong == []


def find_attributes_by_name(text: str) -> list[str]:
    """Calls of hasattr and getattr in a file: an object is looked through instead of declared."""
    calls = (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call))
    return [call.func.id for call in calls if isinstance(call.func, ast.Name)
            and call.func.id in ("hasattr", "getattr")]


def test_a_car_queries_no_link_by_attribute_names():
    """Optional members are declared in ports.Link; the last line is the control."""
    for path in (PACKAGE / "car").glob("*.py"):
        assert find_attributes_by_name(path.read_text(encoding="utf-8")) == [], path.name
    assert find_attributes_by_name("baud = getattr(link, 'baud', 0)") == ["getattr"]


def list_loaded(statement: str) -> set[str]:
    """Modules that a fresh interpreter has after ``statement``."""
    code = f"{statement}\nimport sys; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_import_dart_hal_is_light():
    got = list_loaded("import dart_hal")
    heavy = {"numpy", "scipy", "matplotlib", "serial", "smbus2", "adafruit_servokit", "board",
             "mcap", "click", "rich", "pandas"}
    assert not heavy & got


def test_a_program_that_imports_the_car_loads_no_vehicle_model_and_no_recording():
    got = list_loaded("from dart_hal import Car")
    assert not {"dart_hal.vehicle.parameters", "dart_hal.control.loop", "dart_hal.recording.run",
                "dart_hal.estimation.room", "shutil"} & got


@pytest.mark.parametrize("statement", [
    "from dart_hal import Car, Fleet", "import dart_hal.car", "import dart_hal.recording",
    "import dart_hal.devices.actuation", "import dart_hal.devices.links.serial_port",
    "import dart_hal.vehicle",
    "import dart_hal.estimation", "import dart_hal.calibration", "import dart_hal.control.speed",
])
@pytest.mark.slow_except("from dart_hal import Car, Fleet")
def test_what_runs_on_the_car_loads_no_plotting_no_fitting_no_servokit(statement):
    got = list_loaded(statement)
    assert not {"scipy", "matplotlib", "adafruit_servokit", "board", "busio", "pandas"} & got
    assert not {"dart_lab.sim", "dart_hal.cli", "dart_lab.diagnosis"} & got


@pytest.mark.parametrize(("verb", "absent"), [
    ((), {"numpy", "scipy.special"}), (("diagnose",), {"scipy.special", "scipy.optimize"}),
    (("calibrate",), {"scipy.special", "scipy.optimize"})])
def test_help_waits_for_no_module_that_only_the_work_needs(verb, absent):
    got = list_loaded("from dart_hal.cli.main import main\n"
                      f"try:\n    main([*{verb!r}, '--help'])\nexcept SystemExit:\n    pass")
    assert "click" in got
    assert not absent & got


@pytest.mark.slow
def test_a_simulated_car_in_full_loads_no_plotting_either(tmp_path):
    """Opened and driven: only what moves it."""
    got = list_loaded("from dart_hal import Car\n"
                      f"with Car.open('sim://?nano=mock', cars={str(tmp_path)!r}) as car:\n"
                      "    next(car.states())")
    assert "dart_lab.sim.world" in got
    assert not {"matplotlib", "pandas", "dart_hal.cli", "dart_lab.sim.truth"} & got
