"""A missing package is named with a command that installs it for this interpreter."""

from __future__ import annotations

import shlex
import sys
from importlib import metadata
from pathlib import Path

import pytest

from dart_hal.cli.main import main
from dart_hal.core.process import extras
from dart_hal.core.process.extras import install_command, packages_of

LINES = ["numpy>=1.24", "pyyaml>=6", "websockets>=15", "matplotlib>=3.7; extra == 'plot'",
         'opencv-python-headless>=4.5 ; extra == "camera"', 'pillow>=10.1 ; extra == "camera"',
         "cyclonedds>=0.10.5; (sys_platform == 'linux') and extra == 'dev'"]


@pytest.fixture(autouse=True)
def requirements(monkeypatch):
    monkeypatch.setattr("importlib.metadata.requires", lambda _name: LINES)


def test_extra_becomes_its_packages():
    assert packages_of("camera") == ["opencv-python-headless>=4.5", "pillow>=10.1"]
    assert packages_of("dev") == ["cyclonedds>=0.10.5"]


@pytest.mark.parametrize(("name", "package"), [
    ("websockets", "websockets>=15"), ("yaml", "pyyaml>=6"),
    ("cv2", "opencv-python-headless>=4.5"), ("other", "other")])
def test_import_name_becomes_its_package(name, package):
    assert packages_of(name) == [package]


def test_command_names_this_interpreter(monkeypatch):
    monkeypatch.setattr(extras, "find_spec", lambda _name: object())
    monkeypatch.setattr(sys, "executable", "/srv/my car/.venv/bin/python")
    words = shlex.split(install_command("plot"))
    assert words == [sys.executable, "-m", "pip", "install", "matplotlib>=3.7"]


def test_command_without_pip_is_that_of_uv(monkeypatch, tmp_path):
    monkeypatch.setattr(extras, "find_spec", lambda _name: None)
    monkeypatch.setattr(extras.shutil, "which", lambda _name: None)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert "-m pip install" in install_command("plot")  # nothing better is there
    uv = tmp_path / "dart-hal" / "bin" / "uv"
    uv.parent.mkdir(parents=True)
    uv.write_text("#!/bin/sh\n")
    uv.chmod(0o755)
    assert shlex.split(install_command("plot")) == [
        str(uv), "pip", "install", "--python", sys.executable, "matplotlib>=3.7"]


def test_package_that_is_not_installed_has_no_requirements(monkeypatch):
    def missing(_name):
        raise metadata.PackageNotFoundError

    monkeypatch.setattr("importlib.metadata.requires", missing)
    assert packages_of("plot") == ["plot"]


def test_view_of_a_recording_without_websockets_names_the_command(monkeypatch, capsys, tmp_path):
    for name in [n for n in sys.modules if n.startswith(("websockets", "dart_lab.live.view"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "websockets", None)
    run = tmp_path / "run.mcap"
    run.write_bytes(b"")
    with pytest.raises(SystemExit) as ended:
        main(["view", str(run)])
    message = capsys.readouterr().err
    assert ended.value.code == 2
    assert "D-BUG" not in message
    assert "websockets>=15" in message.replace("\n", " ")


def test_address_without_segno_is_text_with_the_command(monkeypatch, capsys):
    from dart_hal.cli.common.page_address import print_page_address

    monkeypatch.setitem(sys.modules, "segno", None)
    print_page_address(("http://10.0.0.2:8642/#token",), lan=True, as_json=False)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "http://10.0.0.2:8642/#token"
    assert sum("segno" in line for line in lines) == 1
    assert "pip install" in lines[-1]


def test_no_message_names_a_package_that_is_on_no_index():
    """`pip install 'dart-hal[view]'` fetched nothing, or another Python's package."""
    host = Path(__file__).resolve().parents[1] / "host"
    wrong = [path.name for path in host.rglob("*.py")
             if "pip install 'dart-hal" in path.read_text(encoding="utf-8")]
    assert wrong == []
