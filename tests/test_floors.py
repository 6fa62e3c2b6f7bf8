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

ROOT = Path(__file__).parents[1]
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


def test_the_floors_hold():
    done = lint(ROOT)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-500:]
    assert "0 broken" in done.stdout


@pytest.fixture
def house(tmp_path):
    """The contracts over a package of the same rooms with nothing in them."""
    package = tmp_path / "host" / "dart_hal"
    for room in PACKAGE.iterdir():
        if room.suffix == ".py" or (room / "__init__.py").is_file():
            place = package / room.name / ("" if room.suffix else "__init__.py")
            place.parent.mkdir(parents=True, exist_ok=True)
            place.touch()
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    return tmp_path


def let_import(house: Path, room: str, other: str) -> None:
    place = house / "host" / "dart_hal" / room
    place = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
    place.write_text(f"import dart_hal.{other}\n")


@pytest.mark.parametrize(("room", "other"), [
    ("types", "cli"), ("vehicle", "ports"),                             # up; the physics
    ("links", "actuation"), ("actuation", "links"),                     # sideways
    ("links", "recording"), ("recording", "links"), ("control", "estimation"),
    ("vehicle", "wire"), ("report", "car"), ("sim", "calibration"), ("identify", "evaluate"),
    ("evaluate", "identify"), ("predict", "evaluate"), ("lidar", "car"), ("poses", "lidar"),
    ("lidar", "localisation"), ("localisation", "sim"),
])
@pytest.mark.few("types-cli")
def test_an_import_up_or_sideways_would_be_seen(house, room, other):
    """The negative control."""
    let_import(house, room, other)
    done = lint(house)
    assert done.returncode != 0
    assert f"dart_hal.{room}" in done.stdout


@pytest.mark.more
def test_an_import_down_is_free_and_on_the_ground_floor_any(house):
    let_import(house, "cli", "sim")
    let_import(house, "types", "errors")
    done = lint(house)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-500:]


@pytest.mark.more
def test_a_room_without_a_floor_would_be_seen(house):
    (house / "host" / "dart_hal" / "attic.py").touch()
    assert lint(house).returncode != 0


def floors() -> list[str]:
    """Lines of the contract, from the roof down."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    return re.findall(r'"(.+)",', text[text.index("layers = ["):].partition("\n]")[0])


def test_the_drawing_shows_the_floors_of_the_contract():
    text = (ROOT / "docs" / "explanation" / "architecture.md").read_text(encoding="utf-8")
    drawn = text.partition("## Rooms and floors")[2].partition("```text\n")[2].partition("```")[0]
    lines = [line.partition("  ")[0] for line in drawn.splitlines()]
    assert [line for line in lines if line] == floors()


def asked_by_name(text: str) -> list[str]:
    """Calls of hasattr and getattr in a file: an object is looked through instead of declared."""
    calls = (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call))
    return [call.func.id for call in calls if isinstance(call.func, ast.Name)
            and call.func.id in ("hasattr", "getattr")]


def test_a_car_asks_no_link_what_it_has():
    """Optional members are declared in ports.Link; the last line is the control."""
    for path in (PACKAGE / "car").glob("*.py"):
        assert asked_by_name(path.read_text(encoding="utf-8")) == [], path.name
    assert asked_by_name("baud = getattr(link, 'baud', 0)") == ["getattr"]


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
    "import dart_hal.devices.actuation", "import dart_hal.devices.links.serial_port",
    "import dart_hal.vehicle",
    "import dart_hal.estimation", "import dart_hal.calibration", "import dart_hal.control.speed",
])
@pytest.mark.few("from dart_hal import Car, Fleet")
def test_what_runs_on_the_car_loads_no_plotting_no_fitting_no_servokit(statement):
    got = loaded(statement)
    assert not {"scipy", "matplotlib", "adafruit_servokit", "board", "busio", "pandas"} & got
    assert not {"dart_lab.sim", "dart_hal.cli", "dart_lab.diagnose"} & got


@pytest.mark.more
def test_a_simulated_car_in_full_loads_no_plotting_either(tmp_path):
    """Opened and driven: only what moves it."""
    got = loaded("from dart_hal import Car\n"
                 f"with Car.open('sim://?nano=mock', cars={str(tmp_path)!r}) as car:\n"
                 "    next(car.states())")
    assert "dart_lab.sim.world" in got
    assert not {"matplotlib", "pandas", "dart_hal.cli", "dart_lab.sim.truth"} & got
