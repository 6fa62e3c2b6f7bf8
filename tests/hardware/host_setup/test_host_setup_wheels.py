"""Every core dependency comes ready built for the oldest computer of a car.

JetPack 4: Python 3.11 on aarch64 with glibc 2.27. What is not built for it
would have to be compiled on the car, which takes hours and mostly fails.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from setup_box import ROOT, SETUP

GLIBC = 27
"""Minor version of JetPack 4's C library."""
TARGET = ("--only-binary", ":all:", "--python-version", "3.11")
PLATFORMS = ("manylinux2014_aarch64", *(f"manylinux_2_{n}_aarch64" for n in range(17, GLIBC + 1)))
PIN_LINE = re.compile(r"^([a-z0-9][a-z0-9-]*)==(\S+)")


def read_pins(text: str) -> dict[str, str]:
    """{name: version} of a list of pins."""
    found = (PIN_LINE.match(line) for line in text.splitlines())
    return {m[1]: m[2] for m in found if m}


def test_every_core_dependency_is_pinned() -> None:
    """Fast, and always: the list of dependencies and the list of pins belong together."""
    project = (ROOT / "pyproject.toml").read_text()
    block = re.search(r"^dependencies = \[(.*?)^\]", project, re.DOTALL | re.MULTILINE)
    assert block is not None
    required = {re.split(r"[><=;\s]", d)[0] for d in re.findall(r'"([^"]+)"', block[1])
                if "python_version <" not in d}
    pins = set(read_pins((SETUP / "constraints.txt").read_text()))
    assert required - pins == set()
    assert len(required) >= 10
    assert required - (pins - {"numpy"}) == {"numpy"}, "the control"


def resolve_pins(folder: Path) -> dict[str, str]:
    """All that would be installed on the car, transitively, by the pins."""
    out = folder / "resolved.txt"
    done = subprocess.run(
        [sys.executable, "-m", "uv", "pip", "compile", "-q", "--no-annotate", "--no-header",
         "--extra", "view", "--extra", "map",
         "--python-platform", "aarch64-manylinux_2_28", *TARGET, "-c", SETUP / "constraints.txt",
         "-o", out, ROOT / "pyproject.toml"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return read_pins(out.read_text())


def has_wheel(name: str, version: str, folder: Path) -> bool:
    """Whether there is a wheel for the old C library, or one without machine code."""
    tags = [word for p in PLATFORMS for word in ("--platform", p)]
    done = subprocess.run(
        [sys.executable, "-m", "pip", "download", "-q", "--disable-pip-version-check", "--no-deps",
         "--only-binary=:all:", "--python-version", "311", "--implementation", "cp", "--abi",
         "cp311", "--abi", "abi3", "--abi", "none", *tags, "-d", folder, f"{name}=={version}"],
        capture_output=True, text=True, check=False)
    return done.returncode == 0


@pytest.mark.long
def test_wheels_for_the_old_c_library(tmp_path: Path) -> None:
    probe = subprocess.run([sys.executable, "-m", "uv", "--version"], capture_output=True,
                           check=False)
    if probe.returncode:
        pytest.skip("uv is not installed (pip install -e .[dev])")
    all_of_them = resolve_pins(tmp_path)
    assert {"numpy", "scipy", "adafruit-blinka", "sysv-ipc"} <= set(all_of_them)
    offenders = [f"{n}=={v}" for n, v in all_of_them.items() if not has_wheel(n, v, tmp_path)]
    assert offenders == [], f"no wheel for aarch64, glibc 2.{GLIBC}: {', '.join(offenders)}"
    pins = read_pins((SETUP / "constraints.txt").read_text())
    assert all_of_them == {n: v for n, v in pins.items() if n in all_of_them}, "nothing unpinned"
    assert not has_wheel("evdev", "1.9.2", tmp_path), "the control: published as source only"
    assert not has_wheel("eclipse-zenoh", "1.0.0", tmp_path), "and one built for 2.28"
