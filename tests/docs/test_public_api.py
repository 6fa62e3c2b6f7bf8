"""What users import: the names of two packages, and nothing deeper."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest
from handbook import ROOT

import dart_hal
import dart_lab

PUBLIC = ("dart_hal", "dart_lab")
USE_CASES = tuple(f"dart_hal.control.{name}" for name in (
    "crossing", "curvature_aware", "monitoring", "platoon", "shared_plans"))
"""Packages of one use case each, which its example alone imports."""
EXTENDED = ("dart_hal.vehicle",)
"""What a package that adds an effect imports."""
ON_JAX = ("dart_lab.sim.jax", "dart_hal.vehicle.flat")
"""What the extra `jax` adds, and a vehicle of traced parameters."""
PROGRAMS = [ROOT / "README.md", *sorted((ROOT / "docs" / "tutorials").glob("*.md")),
            *sorted((ROOT / "docs" / "notebooks").glob("*.py")),
            *sorted((ROOT / "examples").rglob("*.py"))]


def programs_in(path: Path) -> list[str]:
    """Python programs of a file: itself, or the code blocks of a page."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        return [text]
    return re.findall(r"```python\n(.*?)```", text, re.DOTALL)


PYTHON_PAGE = ROOT / "docs" / "reference" / "python.md"
ENTRY = re.compile(r"^\.\. auto\w+:: (dart_\w+)\.(\w+)$", re.MULTILINE)


def test_the_page_of_the_reference_has_each_public_name_once():
    listed = ENTRY.findall(PYTHON_PAGE.read_text(encoding="utf-8"))
    assert len(set(listed)) == len(listed)
    public = {(p.__name__, name) for p in (dart_hal, dart_lab) for name in p.__all__}
    assert set(listed) == public - {("dart_hal", "__version__"), ("dart_hal", "errors")}


@pytest.mark.parametrize("number", range(len(programs_in(PYTHON_PAGE))))
@pytest.mark.slow
def test_a_program_of_the_reference_runs(number, tmp_path):
    for folder in ("cars", "tests"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    done = subprocess.run([sys.executable, "-c", programs_in(PYTHON_PAGE)[number]], cwd=tmp_path,
                          capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout


def imports_below(program: str) -> list[str]:
    """Modules below the public packages that a program imports."""
    modules = []
    for node in ast.walk(ast.parse(program)):
        if isinstance(node, ast.ImportFrom):
            modules.append(node.module or "")
        elif isinstance(node, ast.Import):
            modules += [alias.name for alias in node.names]
    return [m for m in modules if m.startswith(tuple(f"{p}." for p in PUBLIC))]


@pytest.mark.parametrize("path", PROGRAMS, ids=lambda p: p.name)
def test_a_program_for_users_imports_public_names_alone(path):
    allowed = {"use_cases": USE_CASES, "plugin": EXTENDED, "jax": ON_JAX}.get(
        path.parent.name, ())
    deeper = [m for program in programs_in(path) for m in imports_below(program)
              if not m.startswith(allowed or "-")]
    assert deeper == []


def test_a_deeper_import_would_be_detected():
    assert imports_below("from dart_hal.car import Car") == ["dart_hal.car"]
    assert imports_below("def f():\n    import dart_lab.sim.light") == ["dart_lab.sim.light"]
    assert imports_below("from dart_hal import Car") == []


@pytest.mark.parametrize("package", [dart_hal, dart_lab], ids=PUBLIC)
def test_every_public_name_is_there_and_completion_offers_it_alone(package):
    assert all(getattr(package, name) is not None for name in package.__all__)
    assert dir(package) == sorted(package.__all__)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        package.nothing  # noqa: B018


@pytest.mark.slow
def test_a_verb_is_a_function_after_its_package_was_imported():
    program = ("import dart_lab.diagnosis, dart_lab.identification.evaluation\n"
               "from dart_lab import diagnose, evaluate, identify\n"
               "print(callable(diagnose), callable(evaluate), callable(identify))")
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True,
                          check=True)
    assert done.stdout.split() == ["True"] * 3
