"""House rules that a machine can hold: style, prints, errors, no foreign paths."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from dart_hal.core.errors import CATALOGUE, DartHalError
from tests.common import HOST, ROOT

SOURCES = sorted(HOST.rglob("*.py"))
IN_CI = os.environ.get("CI", "").lower() in ("1", "true", "yes")


def tool(name: str, *args: str) -> subprocess.CompletedProcess[str]:
    """A development tool of this environment; absent it is a skip, on a build server a failure."""
    probe = subprocess.run([sys.executable, "-m", name, "--version"], capture_output=True,
                           check=False)
    if probe.returncode:
        (pytest.fail if IN_CI else pytest.skip)(f"{name} is not installed (pip install -e .[dev])")
    return subprocess.run([sys.executable, "-m", name, *args], capture_output=True, text=True,
                          cwd=ROOT, check=False)


def list_tracked() -> list[Path]:
    """Files of the project: what git knows, else every text file."""
    done = subprocess.run(["git", "ls-files", "-z"], capture_output=True, cwd=ROOT, check=False)
    if done.returncode:
        return [p for p in ROOT.rglob("*") if p.is_file() and ".git" not in p.parts]
    names = done.stdout.decode().split("\0")
    return [p for name in names if name and (p := ROOT / name).is_file()]


def test_ruff():
    done = tool("ruff", "check", "--output-format", "concise", "host", "tests",
                "studies", "examples", "benchmarks")
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize(("package", "found"), [
    ("dart_hal/car", True), ("dart_hal/cli", False), ("dart_lab/diagnosis", True),
    ("dart_lab/cli", False)])
def test_only_the_cli_prints(package, found):
    """It is ruff that looks for it, by the rules of this project: would it see one?"""
    done = subprocess.run([sys.executable, "-m", "ruff", "check", "--select", "T20",
                           "--stdin-filename", f"host/{package}/x.py", "-"],
                          input="print(1)\n", capture_output=True, text=True, cwd=ROOT, check=False)
    assert ("T201" in done.stdout) is found, done.stdout + done.stderr


def test_no_bare_except_and_blind_ones_name_the_reason():
    bad = []
    for path in SOURCES:
        source = path.read_text(encoding="utf-8")
        lines = source.splitlines()
        if not re.search(r"except\s*:|except.*(Base)?Exception", source):
            continue
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.ExceptHandler):
                name = getattr(node.type, "id", "")
                reraised = any(isinstance(n, ast.Raise) for n in ast.walk(node))
                excused = "noqa: BLE001 - " in lines[node.lineno - 1]
                if node.type is None or (name in ("Exception", "BaseException")
                                         and not reraised and not excused):
                    bad.append(f"{path.name}:{node.lineno}")
    assert bad == []


@pytest.mark.parametrize("code", sorted(CATALOGUE))
def test_every_error_has_a_code_a_sentence_and_a_remedy(code):
    cls = CATALOGUE[code]
    assert re.fullmatch(r"D-[A-Z0-9]+-\d\d", code)
    assert cls.__doc__
    assert cls.__doc__.strip().endswith(".")
    error = cls("something happened")
    assert error.remedy
    assert f"error {code}: something happened" in str(error)
    assert "try" in str(error)
    assert set(error.as_json()) == {"code", "what", "found", "expected", "likely", "try", "read"}
    builtin = [b for b in cls.__mro__ if b.__module__ == "builtins"]
    assert builtin[0] is not Exception, "it also inherits the builtin that a caller expects"


def test_every_class_is_in_the_catalogue_under_a_code_of_its_own():
    def below(cls):
        return [sub for c in cls.__subclasses__() for sub in (c, *below(c))]

    import dart_hal.devices.links.image  # noqa: F401 - a room with a refinement of its own

    ours = [c for c in below(DartHalError) if c.__module__.startswith("dart_hal.")]
    assert all(issubclass(c, CATALOGUE[c.code]) for c in ours), "a refinement keeps its code"
    assert {c for c in ours if c.__module__ == "dart_hal.core.errors"} == set(CATALOGUE.values())


def test_every_error_is_documented():
    page = (ROOT / "docs" / "reference" / "errors.md").read_text(encoding="utf-8")
    assert [code for code in CATALOGUE if code not in page] == []


HOSTS = re.compile(r"https?://[\w.-]*(?:pypi|pythonhosted|npmjs|proxy\.golang|jfrog|artifactory|"
                   r"nexus|mirror)[\w.-]*", re.I)
PLACES = re.compile(r"(?<![\w.])/(?:work|home|Users)/\w+|/tmp/venv|/root/")


def leaks(text: str) -> list[str]:
    return [m.group() for pattern in (HOSTS, PLACES) for m in pattern.finditer(text)]


def test_no_registry_and_no_place_of_a_machine_in_the_tree():
    found = {}
    for path in list_tracked():
        if path == Path(__file__) or path.stat().st_size > 2_000_000:
            continue
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            continue
        if hits := leaks(text):
            found[str(path.relative_to(ROOT))] = hits
    assert found == {}


def test_a_leak_would_be_detected():
    """The negative control."""
    assert leaks("pip install -i https://pypi.example.org/simple x")
    assert leaks("open('/work/main/x')")
    assert leaks("/home/somebody/car")
    assert not leaks("https://example.org/work/list and firmware/home/x")
