"""``i2c=auto`` is resolved before anything is opened, also for the guard."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from dart_hal.cli.stop import require_real_car
from dart_hal.core.errors import BusMissing
from dart_hal.core.url import Url
from dart_hal.devices.links import computers, serial_port

URL = "serial:///dev/ttyUSB9?i2c=auto"


def test_the_number_reaches_bus_guard_and_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    refuse_to_open = []
    monkeypatch.setattr(computers, "find_bus", lambda root=None: 7)
    monkeypatch.setattr(serial_port, "SerialLink", lambda *_: SimpleNamespace(close=lambda: None))
    monkeypatch.setattr(serial_port, "open_bus", refuse_to_open.append)
    backend = serial_port.open_serial(Url.parse(URL))
    assert refuse_to_open == ["7"]
    assert backend.url.options["i2c"] == "7", "the guard opens the bus by this"
    assert require_real_car(URL).options["i2c"] == "7"


def test_without_such_a_bus_no_port_is_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse_to_open(*_: object) -> None:
        raise AssertionError("opening the port restarts the Nano")

    monkeypatch.setattr(computers, "i2c_buses", lambda *_: [])
    monkeypatch.setattr(serial_port, "SerialLink", refuse_to_open)
    with pytest.raises(BusMissing, match="i2c=auto finds no bus"):
        serial_port.open_serial(Url.parse(URL))
