"""The recipes for contributors are true: their code does what they state in a copy of the tree.

Recipes of other packages run in this process, from a folder on ``sys.path``. Recipes that change
the tree run in a copy of it; here, each of their changes still fits its place.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from shutil import which

import pytest
from handbook import ROOT
from plugin_package import files_of_page, install, on_path
from recipe import (
    RECIPES_PAGE,
    Checkout,
    RecipeFailed,
    apply_changes,
    edited_file,
    headings,
    recipe,
)
from walks import DOTTED_NAME, find_object

from dart_hal.cli.main import main
from dart_hal.core.errors import UsageError
from dart_hal.devices.links.base import open_backend
from dart_hal.vehicle import effects

OF_THE_TREE = ("An effect", "A sensor channel", "A verb", "A message", "A calibration")
"""Recipes that change files of the tree."""
OF_PACKAGES = {"A verb of another package": "hello from sim-0\n", "A backend": "", "A viewer": "",
               "A sensor of another package": "", "A tyre law": "",
               "A calibration of another package": ""}
"""Recipes of other packages, and what their command prints, where that is one line."""


def test_every_recipe_is_followed():
    with_code = [h for h in headings() if recipe(h)]
    assert set(with_code) == {*OF_THE_TREE, *OF_PACKAGES}


def test_every_name_exists():
    names = DOTTED_NAME.findall(RECIPES_PAGE.read_text(encoding="utf-8"))
    assert len(names) > 15
    for name in names:
        find_object(name)


# recipes that change the tree

@pytest.mark.parametrize("heading", headings())
def test_every_change_fits_its_place(heading):
    texts = {}
    for block in recipe(heading):
        if name := edited_file(block):
            texts.setdefault(name, (ROOT / name).read_text(encoding="utf-8"))
            texts[name] = apply_changes(texts[name], block.text, name)
        elif "/" in block.file and heading not in OF_PACKAGES:
            assert not (ROOT / block.file).exists(), f"{block.file} is no dummy any more"
            assert (ROOT / block.file).parent.is_dir()


@pytest.mark.parametrize(("changes", "message"), [
    (" gone\n+new\n", "0 places"), (" twice\n+new\n", "2 places"), ("+new\n", "places"),
    ("once\n", "in front")])
def test_a_change_without_a_single_place_is_detected(changes, message):
    with pytest.raises(RecipeFailed, match=message):
        apply_changes("once\ntwice\ntwice\n", changes)


def test_a_change_is_applied_in_its_place():
    text = "once\ntwice\ntwice\nlast\n"
    assert apply_changes(text,
                         "+before\n once\n@@\n-last\n+end\n") == "before\nonce\ntwice\ntwice\nend\n"


@pytest.mark.slow
@pytest.mark.parametrize("heading", OF_THE_TREE)
@pytest.mark.long_except("An effect")
def test_a_recipe_passes_its_own_checks(heading, tmp_path):
    Checkout(tmp_path / "copy").follow(heading)


@pytest.mark.slow
@pytest.mark.parametrize(("heading", "left_out"), [
    ("An effect", "tests/vehicle/effects/laws.py"),
    ("An effect", "tests/vehicle/effects/test_effect_physics.py"),
    ("An effect", "studies/diagnosis/stranger_causes.py"),
    ("A sensor channel", "host/dart_hal/vehicle/effect.py"),
    ("A sensor channel", "tests/vehicle/effects/effect_drive.py"),
    ("A verb", "host/dart_hal/cli/main.py"),
    pytest.param("A message", "firmware/test/native_api.cpp", marks=pytest.mark.skipif(
        which("g++") is None, reason="g++ compiles the core of the firmware for this machine")),
    ("A message", "firmware/test/fuzz.py"),
    ("A message", "host/dart_lab/sim/mock_nano.py"),
    ("A message", "tests/wire/test_definitions.py"),
    ("A calibration", "host/dart_hal/calibration/measured.py"),
    ("A calibration", "host/dart_hal/core/config/calibration.py"),
    ("A calibration", "host/dart_hal/calibration/order.py")])
@pytest.mark.long_except("*vehicle/effects/laws.py")
def test_a_step_that_is_left_out_is_detected(heading, left_out, tmp_path):
    """The negative control: the checks of the recipe find each step that is missing."""
    assert left_out in [edited_file(block) for block in recipe(heading)]
    with pytest.raises(RecipeFailed):
        Checkout(tmp_path / "copy").follow(heading, skip=lambda b: edited_file(b) == left_out)


# recipes of other packages

@pytest.fixture
def package(tmp_path):
    """Install the package of a recipe for the rest of the test: ``package(heading)``."""
    opened = []

    def put(heading: str) -> Path:
        folder = tmp_path / "package"
        install(folder, files_of_page(RECIPES_PAGE, heading))
        opened.append(on_path(folder))
        opened[-1].__enter__()
        return folder

    yield put
    for one in opened:
        one.__exit__(None, None, None)


def commands(heading: str) -> list[list[str]]:
    """Arguments of ``dart-hal`` in the commands of a recipe."""
    return [command.replace('"', "").split()[1:] for block in recipe(heading)
            if block.kind == "sh" and block.runs for command in block.commands()]


def run_verb(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Exit status and output of ``dart-hal``."""
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    return int(ended.value.code or 0), capsys.readouterr().out


def test_a_verb_of_another_package_runs(package, capsys):
    heading = "A verb of another package"
    package(heading)
    (arguments,) = commands(heading)
    assert run_verb(arguments, capsys) == (0, OF_PACKAGES[heading])
    code, printed = run_verb(["--help"], capsys)
    assert code == 0
    assert "print the name of a car" in printed


def test_a_verb_that_is_not_installed_is_unknown(capsys):
    """The negative control."""
    (arguments,) = commands("A verb of another package")
    code, _ = run_verb(arguments, capsys)
    assert code == 2


@pytest.mark.slow
def test_the_shortest_backend_opens_a_car(package, capsys):
    (arguments,) = commands("A backend")
    code, _ = run_verb(arguments, capsys)
    assert code == 2, "the negative control: not installed"
    package("A backend")
    code, printed = run_verb(arguments, capsys)
    assert code == 0
    assert json.loads(printed)["frames"] > 10
    assert open_backend("twin://7").car == "sim-7"


@pytest.mark.slow
def test_a_calibration_of_another_package_measures_and_is_listed(package, capsys, tmp_path):
    heading = "A calibration of another package"
    (arguments,) = commands(heading)
    arguments += ["--cars", str(tmp_path / "cars")]
    assert run_verb(arguments, capsys)[0] == 2, "the negative control: not installed"
    package(heading)
    code, printed = run_verb(arguments, capsys)
    assert code == 0
    found = json.loads(printed)
    assert found["quantities"]["imu.gyro_bias"]["unit"] == "rad/s"
    assert Path(found["written"]).is_relative_to(tmp_path)
    assert "gyro_bias = " in Path(found["written"]).read_text()
    code, printed = run_verb(["calibrate", "--help"], capsys)
    assert code == 0
    assert "The bias of the gyro at rest." in printed
    assert run_verb(["calibrate", "bias", "--seconds", "0.5"], capsys)[0] == 2


@pytest.mark.parametrize("changes", [
    {"dart_bias.py": None}, {"pyproject.toml": ("procedures", "viewers")},
    {"pyproject.toml": ("bias = ", "other = ")}, {"dart_bias.py": ("BIAS = ", "OTHER = ")},
    {"dart_bias.py": ("measure=measure,", "")}, {"dart_bias.py": ("plan=plan, ", "")}])
def test_a_calibration_of_another_package_needs_each_step(changes, tmp_path, capsys):
    """The negative control."""
    heading = "A calibration of another package"
    files = files_of_page(RECIPES_PAGE, heading)
    for name, change in changes.items():
        assert change is None or change[0] in files[name]
        files[name] = "" if change is None else files[name].replace(*change)
    install(tmp_path, files)
    with on_path(tmp_path):
        arguments = [*commands(heading)[0], "--cars", str(tmp_path / "cars")]
        assert run_verb(arguments, capsys)[0] == 2


def test_a_viewer_sees_the_car(package, capsys):
    (program,) = programs("A viewer")
    with pytest.raises(UsageError, match="peak"):
        exec(program, {})
    package("A viewer")
    exec(program, {})
    assert capsys.readouterr().out == "0.0 m/s\n"


@pytest.mark.slow
def test_a_source_of_poses_of_another_package_is_opened(package, capsys):
    (program,) = programs("A sensor of another package")
    with pytest.raises(UsageError, match="is not a source of poses"):
        exec(program, {})
    package("A sensor of another package")
    exec(program, {})
    assert capsys.readouterr().out == "1.0 2.0\n"


def test_a_tyre_law_changes_the_turn(package, capsys):
    (program,) = programs("A tyre law")
    own_catalogue = effects.catalogue.cache_clear, effects._added_effects.cache_clear
    for forget in own_catalogue:
        forget()
    with pytest.raises(UsageError, match="linear_tyres"):
        exec(program, {})
    for forget in own_catalogue:
        forget()
    package("A tyre law")
    try:
        exec(program, {})
    finally:
        for forget in own_catalogue:
            forget()
    base, linear = (float(line.split()[0]) for line in capsys.readouterr().out.splitlines())
    assert abs(linear - base) > 0.1


def programs(heading: str) -> list[str]:
    """Python blocks of a recipe that are no files."""
    return [b.text for b in recipe(heading) if b.kind == "python" and b.runs and not b.file]


def test_a_package_is_found_by_a_process_of_its_own(package):
    """As pip installs it, not only in the process of the tests."""
    folder = package("A verb of another package")
    code = ("from dart_hal.core.plugins import list_plugins; "
            "print(*list_plugins('dart_hal.verbs'))")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True,
                          cwd=folder)
    assert {"hello", "laboratory"} <= set(done.stdout.split())
