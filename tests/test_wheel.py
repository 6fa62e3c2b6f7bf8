"""The package as others get it: a wheel in an empty environment, away from the checkout."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

from dart_hal.core.errors import EmulatorMissing
from dart_hal.devices.links import bridge
from tests.common import ROOT

pytestmark = pytest.mark.slow

PYTHONS = ("3.10", "3.11", "3.12", "3.13")
PROGRAM = """
from dart_hal import Car

with Car.open("sim://?nano=mock") as car:
    for state in car.states(duration=0.1):
        reveal_type(state.speed)
"""
LOWEST_EXTRAS = ("lab", "gym", "table")
LOWEST_PROGRAM = """
import gymnasium, numpy as np
from pathlib import Path
from dart_hal.car import Car
from dart_hal.estimation.localisation.grid import Grid, read_grid, write_grid
from dart_hal import to_dataframe
from dart_hal.core.figures import new_figure, save_figure

with Car.open("sim://?nano=mock", record="run.mcap") as car:
    car.arm()
    for state in car.states(duration=1.0):
        car.drive(steering=0.1, throttle=0.2)
assert len(to_dataframe("run.mcap")) > 90
cars = gymnasium.make_vec("dart_lab.sim.gym:DartCar-v0", num_envs=2)
cars.reset(seed=1)
cars.step(cars.action_space.sample())
occupied = np.eye(4, dtype=bool)
write_grid(Grid(occupied, ~occupied, 0.05, np.zeros(2)), Path("map.yaml"))
assert (read_grid(Path("map.yaml")).occupied == occupied).all()
save_figure(new_figure(), "figure.png")
import dart_lab.live.view.player
print("all good")
"""

SHORT_DEMO = """
import dart_lab.demo.diagnosis as chapter
from dart_hal.cli.main import main

if __name__ == "__main__":  # its processes import this file
    chapter.FIRST_DRIVE_S = chapter.SECOND_DRIVE_S = chapter.THIRD_DRIVE_S = 40.0
    chapter.MAX_CAUSES = 1
    main(["demo"])
"""


def run(*command: object, cwd: Path, **more: str) -> subprocess.CompletedProcess[str]:
    """Without the checkout on Python's path, and without this environment."""
    env = {k: v for k, v in os.environ.items() if k not in {"PYTHONPATH", "VIRTUAL_ENV"}}
    return subprocess.run([str(word) for word in command], cwd=cwd, env=env | more,
                          capture_output=True, text=True, check=False, timeout=900)


def done(*command: object, cwd: Path, **more: str) -> str:
    ended = run(*command, cwd=cwd, **more)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


@pytest.fixture(scope="module")
def uv() -> str:
    found = shutil.which("uv", path=f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    return found or pytest.skip("uv is not installed")


@pytest.fixture(scope="module")
def wheel(uv, tmp_path_factory) -> Path:
    return build_wheel(uv, tmp_path_factory.mktemp("dist"))


@pytest.fixture(scope="module")
def any_wheel(uv, tmp_path_factory) -> Path:
    return build_wheel(uv, tmp_path_factory.mktemp("any"), DART_HAL_WHEEL="any")


def build_wheel(uv: str, folder: Path, **variables: str) -> Path:
    made = run(uv, "build", "--wheel", "--out-dir", folder, ROOT, cwd=folder, **variables)
    if made.returncode and "error sending request" in made.stderr:
        pytest.skip("the packages that build the wheel cannot be fetched")
    assert made.returncode == 0, made.stderr
    return next(folder.glob("*.whl"))


def find_python(uv: str, version: str, folder: Path) -> str:
    """Path of an installed Python, also of one that no shim of pyenv selects; or ""."""
    pyenv = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv") / "versions"
    path = os.pathsep.join([*map(str, pyenv.glob(f"{version}.*/bin")), os.environ["PATH"]])
    found = run(uv, "python", "find", "--no-python-downloads", "--no-project", version, cwd=folder,
                PATH=path)
    return "" if found.returncode else found.stdout.strip()


def install(uv: str, wheel: Path, home: Path, python: str, *more: str, extras: str = "") -> Path:
    """The environment's folder of programs."""
    done(uv, "venv", "--python", python, home, cwd=home.parent)
    done(uv, "pip", "install", "--python", home / "bin" / "python",
         f"dart-hal{extras} @ {wheel.as_uri()}", *more, cwd=home.parent)
    return home / "bin"


@pytest.fixture(scope="module")
def programs(uv, wheel, tmp_path_factory) -> Path:
    return install(uv, wheel, tmp_path_factory.mktemp("env") / "env", sys.executable, "mypy",
                   "pyright", extras="[lab]")


@pytest.fixture
def program(tmp_path) -> Path:
    path = tmp_path / "program.py"
    path.write_text(PROGRAM, encoding="utf-8")
    return path


def test_the_wheel_is_for_any_python_of_its_platform(wheel):
    platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
    assert wheel.name.endswith(f"-py3-none-{platform}.whl")
    names = zipfile.ZipFile(wheel).namelist()
    assert "dart_hal/py.typed" in names
    assert any(n.startswith("dart_hal/vehicle/native/_built/kernel-") for n in names)


def read_page(wheel: Path) -> str:
    """The metadata of a wheel: headers, then the page that an index shows."""
    with zipfile.ZipFile(wheel) as archive:
        name = next(n for n in archive.namelist() if n.endswith(".dist-info/METADATA"))
        return archive.read(name).decode()


def test_wheel_for_every_system_needs_no_compiler(uv, any_wheel, tmp_path):
    assert any_wheel.name.endswith("-py3-none-any.whl")
    assert not [n for n in zipfile.ZipFile(any_wheel).namelist() if n.endswith((".so", ".pyd"))]
    programs = install(uv, any_wheel, tmp_path / "env", sys.executable)
    drive = tmp_path / "drive.py"
    drive.write_text((ROOT / "tests" / "drive_installed.py").read_text(encoding="utf-8"))
    done(programs / "python", drive, cwd=tmp_path, PATH=str(programs),
         XDG_CACHE_HOME=str(tmp_path))
    assert not list(tmp_path.glob("dart-hal/kernels/*.so")), "nothing was compiled"


def test_portable_libraries_get_a_tag_that_indexes_take(uv, tmp_path):
    pytest.importorskip("auditwheel")
    wheel = build_wheel(uv, tmp_path, DART_HAL_WHEEL="portable")
    names = [n for n in zipfile.ZipFile(wheel).namelist() if n.endswith(".so")]
    assert names
    assert all("-portable-" in name for name in names), "those of this processor stay here"
    shown = done(sys.executable, "-m", "auditwheel", "show", wheel, cwd=tmp_path)
    assert "manylinux_2_" in shown


@pytest.mark.parametrize("home", ["", "https://example.org/dart-hal/"])
def test_page_of_an_index_has_no_relative_link(uv, tmp_path, home):
    page = read_page(build_wheel(uv, tmp_path, DART_HAL_WHEEL="any", DART_HAL_HOME=home))
    assert not re.search(r"\]\((?!https://|#)", page)
    assert ("https://example.org/dart-hal/docs/explanation/safety.md" in page) is bool(home)
    assert ("Project-URL: Security, https://example.org/dart-hal/SECURITY.md" in page) is bool(home)
    assert "Classifier: Operating System :: Microsoft :: Windows" in page
    assert "names what that model gets wrong" in page


def test_mypy_sees_the_speed_as_a_number(programs, program):
    output = done(programs / "mypy", "--strict", program, cwd=program.parent)
    assert 'Revealed type is "builtins.float"' in output or 'Revealed type is "float"' in output


def test_pyright_sees_the_speed_as_a_number(programs, program):
    if shutil.which("node") is None:
        pytest.skip("pyright needs node, which is not installed")
    output = run(programs / "pyright", "--pythonpath", programs / "python", program,
                 cwd=program.parent)
    if "npm" in output.stderr and "information" not in output.stdout:
        pytest.skip(f"pyright cannot be fetched: {output.stderr.splitlines()[-1]}")
    assert 'Type of "state.speed" is "float"' in output.stdout, output.stdout + output.stderr


@pytest.mark.parametrize("python", PYTHONS)
def test_its_needs_can_be_met_for_every_python(uv, wheel, tmp_path, python):
    needs = tmp_path / "needs.in"
    needs.write_text(f"dart-hal @ {wheel.as_uri()}\n", encoding="utf-8")
    output = done(uv, "pip", "compile", "--python-version", python, "--only-binary", ":all:", needs,
                  cwd=tmp_path)
    assert "numpy==" in output


@pytest.mark.parametrize("python", PYTHONS)
@pytest.mark.long_except("3.10", "3.13")
def test_it_drives_with_every_python_of_this_machine(uv, wheel, tmp_path, python):
    found = find_python(uv, python, tmp_path)
    if not found:
        pytest.skip(f"Python {python} is not installed")
    programs = install(uv, wheel, tmp_path / "env", found)
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    program = readme.partition("```python\n")[2].partition("```")[0]
    assert "from dart_hal import Car, Pursuit, figure_of_eight" in program
    done(programs / "python", "-c", program, cwd=tmp_path, DART_HAL_URL="sim://?nano=mock")
    # The live page is in the base install.
    done(programs / "python", "-c", "import dart_lab.live.view.serve", cwd=tmp_path)
    refused = run(programs / "dart-hal", "follow", "oval", "--speed", "1", "--plot", "a.png",
                  cwd=tmp_path)
    assert "matplotlib" in refused.stderr, "what is not installed is named"
    assert "pip install" in refused.stderr


@pytest.mark.parametrize("which", [0, -1], ids=["oldest", "newest"])
def test_lowest_versions_work_together(uv, wheel, tmp_path, which):
    """On the oldest and newest Python here, with the lowest versions that pyproject.toml allows.

    gymnasium 1.0 was allowed though the vector environment needs 1.1.
    """
    pythons = [path for version in PYTHONS if (path := find_python(uv, version, tmp_path))]
    if which and len(pythons) == 1:
        pytest.skip("one Python is installed; the other case uses it")
    python = tmp_path / "env" / "bin" / "python"
    versions = tmp_path / "versions.txt"
    extras = [word for extra in LOWEST_EXTRAS for word in ("--extra", extra)]
    done(uv, "venv", "--python", pythons[which], tmp_path / "env", cwd=tmp_path)
    done(uv, "pip", "compile", "--python", python, "--resolution", "lowest-direct",
         "--only-binary", ":all:", *extras, ROOT / "pyproject.toml", "-o", versions, cwd=tmp_path)
    done(uv, "pip", "install", "--python", python, "-r", versions, wheel, cwd=tmp_path)
    assert "all good" in done(python, "-c", LOWEST_PROGRAM, cwd=tmp_path, MPLBACKEND="agg")


def test_the_base_install_needs_these_packages_alone(wheel):
    """The list of the page on architecture; each further one is a decision."""
    with zipfile.ZipFile(wheel) as archive:
        about = next(n for n in archive.namelist() if n.endswith(".dist-info/METADATA"))
        lines = archive.read(about).decode().splitlines()
    needed = [line for line in lines if line.startswith("Requires-Dist:")
              and "extra ==" not in line and "python_version <" not in line]
    names = {re.match(r"Requires-Dist: ([\w-]+)", line)[1] for line in needed}
    assert names == {"numpy", "scipy", "pyserial", "smbus2", "adafruit-circuitpython-servokit",
                     "click", "rich", "msgspec", "tomlkit", "mcap", "portalocker", "websockets"}


@pytest.mark.parametrize("emulator", [False, True])
@pytest.mark.long_except("True")
def test_the_demo_runs_in_an_empty_folder(programs, tmp_path, emulator):
    """On the mock, which is reported; from the emulator where one is built.

    With drives half as long and one cause: what is found is judged in the checkout.
    """
    place = tmp_path / "libdartemu.so"
    if emulator:
        try:
            place = bridge.find_library()
        except EmulatorMissing as missing:
            pytest.skip(f"no emulator: {missing.what}")
    folder = tmp_path / "empty"
    folder.mkdir()
    program = tmp_path / "demo.py"
    program.write_text(SHORT_DEMO, encoding="utf-8")
    ended = run(programs / "python", program, cwd=folder, NO_COLOR="1", COLUMNS="400",
                DART_HAL_EMULATOR=str(place))
    assert ended.returncode == 0, ended.stdout + ended.stderr
    output = " ".join(ended.stderr.split())  # standard output has the answers alone
    assert ("firmware in the emulator" in output) is emulator
    assert ("MockNano instead of the firmware" in output) is not emulator
    assert ("clone the project" in output) is not emulator  # there is no Makefile here
    assert "mapped, then followed in the own map" in " ".join(ended.stdout.split())
    assert list(folder.rglob("*.html"))
