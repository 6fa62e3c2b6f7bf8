"""A checkout in a folder whose name make or the shell split: it builds, or names the reason."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from dart_hal.vehicle.native import build
from tests.common import ROOT

GOOD = ["my car", "it's", "a&b;(c)", "größe #1", "100%=x", "[ab]*?!~", "a,b|c<d>", "x\ty"]
BAD = [":", "$", '"', "`", "\\"]
"""Characters in a path in which no virtual environment works."""
OBJECT = "build/dart_nano/core/identity.cpp.o"
needs_avr = pytest.mark.skipif(shutil.which("avr-g++") is None or shutil.which("make") is None,
                               reason="avr-g++ or make is not installed")


def run(*command, **options):
    return subprocess.run([*map(str, command)], capture_output=True, text=True, check=False,
                          **options)


def firmware_in(folder):
    """A copy of the firmware's sources."""
    target = folder / "firmware"
    target.mkdir(parents=True)
    for name in ("src", "emulator"):
        shutil.copytree(ROOT / "firmware" / name, target / name)
    for name in ("Makefile", "toolchain.sh"):
        shutil.copy(ROOT / "firmware" / name, target)
    return target


@needs_avr
@pytest.mark.emulator
@pytest.mark.slow_except("it's")
@pytest.mark.parametrize("name", [*GOOD, "a$b", 'q"x', "b`c", "e\\f", "a:b"])
def test_firmware_is_compiled_in_a_folder_of_any_name(tmp_path, name):
    firmware = firmware_in(tmp_path / name)
    done = run("make", "-s", "-C", firmware, OBJECT)
    assert done.returncode == 0, done.stderr
    assert (firmware / OBJECT).is_file()


def test_no_makefile_uses_the_absolute_path_of_the_checkout():
    """make takes a path with a space for two words wherever it is expanded."""
    for path in (ROOT / "Makefile", ROOT / "firmware" / "Makefile",
                 ROOT / "firmware" / "emulator" / "Makefile"):
        for line in path.read_text(encoding="utf-8").splitlines():
            if line.startswith(("BAD_CHARACTERS", "$(error")):  # which refuse the rest
                continue
            assert not re.search(r"\$\(CURDIR\)|\$\((abspath|realpath) ", line), f"{path}: {line}"


@pytest.mark.parametrize("name", GOOD)
def test_make_accepts_the_folder(tmp_path, name):
    folder = tmp_path / name
    folder.mkdir()
    (folder / "tests").mkdir()
    shutil.copy(ROOT / "Makefile", folder)
    done = run("make", "-s", "-C", folder, "help")
    assert done.returncode == 0, done.stderr
    assert "make demo" in done.stdout


@pytest.mark.parametrize("character", BAD)
def test_make_refuses_a_folder_in_which_no_environment_works(tmp_path, character):
    folder = tmp_path / f"my{character}car"
    folder.mkdir()
    shutil.copy(ROOT / "Makefile", folder)
    done = run("make", "-s", "-C", folder, "help")
    assert done.returncode == 2
    assert f"contains {character}, found: {folder}" in done.stderr
    assert "Try: move the checkout" in done.stderr


def failing_tools(folder, make):
    """Programs on a PATH of their own: all of the toolchain, and ``make`` as a script."""
    tools = folder / "tools"
    tools.mkdir()
    for name in ("sh", "dirname", "rm", "id", "cat"):
        (tools / name).symlink_to(shutil.which(name))
    for name, text in (("avr-gcc", ""), ("avrdude", ""), ("apt-get", "exit 1"), ("sudo", "exit 1"),
                       ("make", make)):
        (tools / name).write_text(f"#!/bin/sh\n{text}\n")
        (tools / name).chmod(0o755)
    return {**os.environ, "PATH": str(tools)}


def test_toolchain_that_fails_leaves_the_mock_with_a_notice(tmp_path):
    firmware = firmware_in(tmp_path / "my car")
    old = [firmware / "build" / name for name in ("dart_nano.elf", "libdartemu.so")]
    (firmware / "build").mkdir()
    for file in old:
        file.write_text("of yesterday")
    tools = failing_tools(tmp_path, "echo 'error: no such option' >&2; exit 2")
    done = run("sh", firmware / "toolchain.sh", env=tools)
    assert done.returncode == 0
    assert "NOTICE" in done.stdout
    assert "MockNano" in done.stdout
    assert not any(file.exists() for file in old), "older firmware would run in its place"


@pytest.mark.skipif(not Path("/usr/include/simavr/sim_avr.h").exists()
                    or not Path("/usr/share/arduino").exists(), reason="no simavr or Arduino core")
def test_toolchain_that_works_prints_no_notice(tmp_path):
    """The negative control of the notice."""
    firmware = firmware_in(tmp_path / "my car")
    done = run("sh", firmware / "toolchain.sh", env=failing_tools(tmp_path, "exit 0"))
    assert (done.returncode, done.stdout) == (0, "")


@pytest.mark.skipif(build.compiler() is None, reason="no C compiler")
@pytest.mark.slow_except("it's")
@pytest.mark.parametrize("name", [*GOOD, "a$b", 'q"x', "b`c", "e\\f", "a:b"])
def test_kernels_are_compiled_in_a_folder_of_any_name(tmp_path, name):
    source = "double twice(double x) { return 2.0 * x; }\n"
    assert build.compile_kernel(source, build.VARIANTS[0], tmp_path / name).is_file()


def test_compiler_may_lie_in_a_folder_with_a_space(tmp_path, monkeypatch):
    (tmp_path / "my tools").mkdir()
    tool = tmp_path / "my tools" / "cc"
    tool.write_text("#!/bin/sh\n")
    tool.chmod(0o755)
    monkeypatch.setenv("CC", str(tool))
    assert build.compiler() == [str(tool)]
    monkeypatch.setenv("CC", f"'{tool}' -O1")
    assert build.compiler() == [str(tool), "-O1"]


def test_url_of_a_recording_keeps_every_character():
    from dart_hal.core.url import Url

    for name in (*GOOD, "a:b", "a$b", "e\\f", "[x"):
        if "?" not in name:
            assert Url.parse(f"replay:///srv/{name}/run.mcap?car=x").target == (
                f"/srv/{name}/run.mcap")
