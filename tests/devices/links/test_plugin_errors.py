"""What goes wrong in another package is reported as that package's."""

from __future__ import annotations

import json
from importlib import metadata

import pytest

from dart_hal.cli.main import main
from dart_hal.core import plugins
from dart_hal.core.errors import DartHalError, LinkLost, PluginFailed, UsageError
from dart_hal.core.plugins import load_plugin
from dart_hal.devices.camera import open_camera
from dart_hal.devices.lidar import open_lidar
from dart_hal.devices.links.base import open_backend
from dart_hal.devices.poses import open_poses
from dart_hal.fleet.transports import open_transport
from dart_hal.vehicle import effects

CODE = """
from dart_hal.core.errors import LinkLost

def refuse_connection(url):
    raise ConnectionRefusedError(111, "Connection refused")

def reject_number(url):
    raise ValueError("port 70000 is out of range")

def forget_argument():
    pass

def return_nothing(url):
    pass

def lose_link(url):
    raise LinkLost("the line is down")

def need_package(url):
    import no_such_package_of_mine
"""
NAMES = ("refuse_connection", "reject_number", "forget_argument", "return_nothing", "lose_link",
         "need_package", "no_such_function")


def scheme(name: str) -> str:
    """A URL scheme has no underscore."""
    return name.replace("_", "-")


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A distribution ``other-car 2.5`` with one backend for each function of ``CODE``."""
    (tmp_path / "other_car.py").write_text(CODE)
    folder = tmp_path / "other_car-2.5.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: other-car\nVersion: 2.5\n")
    entries = "".join(f"{scheme(name)} = other_car:{name}\n" for name in NAMES)
    (folder / "entry_points.txt").write_text(
        f"[dart_hal.backends]\n{entries}[dart_hal.transports]\n{entries}[dart_hal.sensors]\n"
        + "".join(f"{kind}.{scheme(name)} = other_car:{name}\n" for name in NAMES
                  for kind in ("lidar", "camera", "poses")))
    monkeypatch.syspath_prepend(str(tmp_path))


@pytest.mark.parametrize("open_sensor", [open_lidar, open_camera, open_poses])
@pytest.mark.parametrize(("name", "message"), [
    ("refuse_connection", "Connection refused"), ("return_nothing", "returned no sensor")])
def test_an_error_of_a_sensor_names_its_package(package, open_sensor, name, message):
    with pytest.raises(PluginFailed, match=message) as caught:
        open_sensor(f"{scheme(name)}://car")
    assert "other-car 2.5" in caught.value.what


@pytest.mark.slow_except("lidar*")
@pytest.mark.parametrize(("kind", "open_sensor", "url"), [
    ("camera", open_camera, "usb:/dev/no-camera"), ("lidar", open_lidar, "serial://"),
    ("poses", open_poses, "udp://no-port")])
def test_no_package_takes_the_place_of_a_sensor_of_ours(package, tmp_path, kind, open_sensor, url):
    (tmp_path / "other_car-2.5.dist-info" / "entry_points.txt").write_text(
        f"[dart_hal.sensors]\n{kind}.{scheme(url.partition(':')[0])} = other_car:return_nothing\n")
    with pytest.raises(DartHalError) as caught:
        open_sensor(url)
    assert not isinstance(caught.value, PluginFailed)


def test_an_effect_that_cannot_be_imported_names_its_package(package, tmp_path):
    (tmp_path / "other_car-2.5.dist-info" / "entry_points.txt").write_text(
        "[dart_hal.effects]\nfin = other_car:no_such_function\n")
    effects._added_effects.cache_clear()
    try:
        with pytest.raises(PluginFailed, match="fin = other_car:no_such_function") as caught:
            effects._added_effects()
    finally:
        effects._added_effects.cache_clear()
    assert "of other-car failed" in caught.value.what


@pytest.mark.parametrize(("name", "message"), [
    ("refuse_connection", "ConnectionRefusedError: .*Connection refused"),
    ("reject_number", "ValueError: port 70000 is out of range"),
    ("forget_argument", "TypeError"), ("no_such_function", "AttributeError"),
    ("return_nothing", "returned no backend")])
def test_an_error_of_another_package_names_it(package, name, message):
    with pytest.raises(PluginFailed, match=message) as caught:
        open_backend(f"{scheme(name)}://car")
    assert "other-car 2.5" in caught.value.what
    assert f"other_car:{name}" in caught.value.what
    assert "not of DART-HAL" in caught.value.likely


def test_an_error_of_a_transport_names_its_package(package):
    with pytest.raises(PluginFailed, match=r"dart_hal.transports\) of other-car 2.5 failed"):
        open_transport("refuse-connection://room")


def test_a_broken_package_of_verbs_is_named(tmp_path, monkeypatch, capsys):
    (tmp_path / "other_verbs.py").write_text("raise RuntimeError('half installed')\n")
    folder = tmp_path / "other_verbs-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: other-verbs\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text("[dart_hal.verbs]\nother = other_verbs:VERBS\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(SystemExit):
        main(["no-such-verb", "--json"])
    error = json.loads(capsys.readouterr().out)["error"]
    assert "other-verbs 1.0" in error["what"]
    with pytest.raises(SystemExit) as ended:
        main(["stop", "--help"])
    assert not ended.value.code, "a broken plugin does not keep a car from being stopped"


def test_the_line_that_raised_is_reported(package):
    with pytest.raises(PluginFailed) as caught:
        open_backend("refuse-connection://car")
    line = CODE.splitlines().index("    raise ConnectionRefusedError(111, \"Connection refused\")")
    assert caught.value.found == f"other_car.py, line {line + 1}"
    assert isinstance(caught.value.__cause__, ConnectionRefusedError)


@pytest.mark.parametrize(("name", "kind"), [("lose_link", LinkLost), ("need_package", ImportError)])
def test_an_error_that_states_its_cause_passes(package, name, kind):
    with pytest.raises(kind) as caught:
        open_backend(f"{scheme(name)}://car")
    assert not isinstance(caught.value, PluginFailed)


def test_an_error_of_this_distribution_is_not_a_plugins(monkeypatch):
    """The negative control: a mistake in a backend of DART-HAL is still reported as one."""
    (own,) = (e for e in metadata.entry_points(group="dart_hal.backends") if e.name == "sim")
    assert plugins.is_own(own)
    with pytest.raises(KeyError), plugins.attribute_errors(own):
        raise KeyError("a mistake in DART-HAL")


@pytest.mark.parametrize("name", ["refuse_connection", "reject_number"])
def test_the_command_reports_it_as_the_packages(package, name, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["top", "--url", f"{scheme(name)}://car", "--json"])
    assert ended.value.code == 2
    error = json.loads(capsys.readouterr().out)["error"]
    assert error["code"] == "D-PLUG-01"
    assert "other-car 2.5" in error["what"]


def test_a_module_that_is_not_there_names_its_package(tmp_path, monkeypatch):
    folder = tmp_path / "gone-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: gone\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text("[dart_hal.viewers]\ngone = no_such_module_at_all:x\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(UsageError, match="no_such_module_at_all"):
        load_plugin("dart_hal.viewers", "gone")
    assert issubclass(PluginFailed, DartHalError)
