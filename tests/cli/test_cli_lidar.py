"""What ``doctor`` and ``find`` say of a lidar."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from dart_hal.links import attached

URL = "sim://?nano=mock&physics=kinematic&seed=1"


def checked(ran):
    return next((c for c in ran.json["checks"] if c["id"] == "lidar"), None)


@pytest.mark.cpu(4)
def test_the_doctor_looks_at_it(verb):
    good = checked(verb("doctor", "--url", f"{URL}&lidar=1", "--seconds", 2, "--json"))
    assert good["verdict"] == "ok"
    assert "revolutions, 7." in good["found"]
    blind = checked(verb("doctor", "--url", f"{URL}&lidar=gap=0.8", "--seconds", 2, "--json"))
    assert blind["verdict"] == "warn"
    assert "nothing comes back from" in blind["found"]
    assert "lidar.md" in blind["try"]


def test_a_car_without_one_is_not_asked(verb):
    assert checked(verb("doctor", "--url", URL, "--seconds", 1, "--json")) is None


def test_a_lidar_that_says_nothing_is_a_warning(verb):
    silent = checked(verb("doctor", "--url", f"{URL}&lidar=lost=0.9", "--seconds", 1, "--json"))
    assert silent["verdict"] == "warn"


def test_its_adapter_is_known_by_its_bridge(verb, monkeypatch):
    port = SimpleNamespace(device="/dev/ttyUSB1", vid=0x10C4, pid=0xEA60, serial_number=None,
                           description="CP2102 USB to UART")
    monkeypatch.setattr(attached.list_ports, "comports", lambda: [port])
    monkeypatch.setattr(attached, "holders", lambda device: iter(()))
    told = verb("find", "--json").json
    assert "YDLidar" in told["ports"][0]["bridge"]
    assert any("DART_HAL_LIDAR=serial:///dev/ttyUSB1" in hint for hint in told["hints"])
