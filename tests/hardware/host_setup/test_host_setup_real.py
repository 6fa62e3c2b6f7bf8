"""The same script with the real uv, the real package index and the real package.

Only the system around it is made of fakes; processor and C library are this
computer's.
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest
from setup_box import DATA, ROOT, Box, list_announced


def real_uv() -> str:
    if importlib.util.find_spec("uv") is None:
        pytest.skip("uv is not installed (pip install -e .[dev])")
    from uv import find_uv_bin

    return str(find_uv_bin())


def network() -> dict[str, str]:
    """How this computer reaches the network: certificates, proxies, another index."""
    names = ("SSL_CERT_FILE", "SSL_CERT_DIR", "UV_DEFAULT_INDEX", "UV_INDEX_URL")
    return {k: v for k, v in os.environ.items()
            if k in names or k.lower() in ("http_proxy", "https_proxy", "no_proxy")}


@pytest.fixture
def box(tmp_path: Path) -> Box:
    """A fresh computer that has a Python 3.11, as a Raspberry Pi has."""
    made = Box(tmp_path)
    python = Path(sys.base_prefix) / "bin" / "python3.11"
    if not python.exists():
        pytest.skip("these tests do not run on Python 3.11")
    (made.folder / "tools" / "python3.11").symlink_to(python)
    return made


@pytest.mark.slow
def test_from_nothing_to_a_doctor_that_is_content(box: Box) -> None:
    script = ROOT / "host" / "setup" / "setup.sh"
    uv = real_uv()
    done = box.run("--uv", uv, "--car", "mine", script=script, timeout=900, **network())
    assert done.returncode == 0, done.stdout + done.stderr
    program = box.root / "usr/local/bin/dart-hal"
    home = {"HOME": str(box.home), "PATH": "/usr/bin:/bin"}
    outcome = subprocess.run([program, "doctor", "--url", "sim://?seed=3&nano=mock"], env=home,
                             capture_output=True, text=True, check=False, cwd=box.home)
    assert "PCA9685 answers correctly" in outcome.stdout, outcome.stdout + outcome.stderr
    assert " fail " not in outcome.stdout
    held = subprocess.run([program, "stop", "--car", "mine", "--url",
                           "serial:///dev/dart-nano?i2c=250"], env=home, capture_output=True,
                          text=True, check=False, cwd=box.home)
    assert "no such bus" in held.stderr, "the car's files are found, the bus is not here"

    again = box.run("--uv", uv, script=script)
    assert list_announced(again.stdout) == [], again.stdout
    undone = box.run("--remove", script=script)
    assert undone.returncode == 0
    assert not (box.home / DATA / "current").exists()
    assert (box.home / DATA / "cars" / "mine" / "car.toml").exists()
