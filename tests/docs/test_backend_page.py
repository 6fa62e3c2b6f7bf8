"""The page "writing a backend": its code drives a simulated Nano behind a TCP socket."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import threading
import time
import tty
from dataclasses import MISSING, fields

import pytest
from handbook import DOCS
from plugin_package import files_of_page, install, on_path

from dart_hal.car import Car
from dart_hal.core.errors import LinkLost, UsageError
from dart_hal.devices.links.base import Backend, open_backend
from dart_hal.devices.links.pty import Pty
from dart_lab.sim.serve import BusServer, PacedWorld
from tests.common import WAIVED_GATES

BACKEND_PAGE = DOCS / "how_to" / "backend.md"


class Converter:
    """A serial-to-TCP converter: one client of a socket gets the bytes of a serial port."""

    def __init__(self, port: str) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = "{}:{}".format(*self._listener.getsockname())
        self._serial = os.open(port, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self._serial)
        self._client: socket.socket | None = None
        threading.Thread(target=self._carry, daemon=True).start()

    def _carry(self) -> None:
        with contextlib.suppress(OSError, ValueError):
            self._client, _ = self._listener.accept()
            while True:
                ready, _, _ = select.select([self._client, self._serial], [], [])
                if self._serial in ready:
                    self._client.sendall(os.read(self._serial, 4096))
                if self._client in ready:
                    data = self._client.recv(4096)
                    if not data:
                        return
                    os.write(self._serial, data)

    def close(self) -> None:
        for one in (self._listener, self._client):
            if one is not None:
                with contextlib.suppress(OSError):
                    one.shutdown(socket.SHUT_RDWR)
                one.close()
        os.close(self._serial)


@pytest.fixture
def package(tmp_path):
    """The package of the page, installed."""
    folder = tmp_path / "package"
    install(folder, files_of_page(BACKEND_PAGE))
    with on_path(folder):
        yield


@pytest.fixture
def served_car(tmp_path, armed_esc):
    """A simulated car in real time: (address of its Nano, spec of its bus, name, folder)."""
    backend = open_backend("sim://?nano=mock")
    paced = PacedWorld(backend)
    file = tmp_path / "cars" / backend.car / "car.toml"
    file.parent.mkdir(parents=True)
    file.write_text(backend.car_toml)
    bus = tmp_path / "i2c"
    with BusServer(backend, paced, bus), Pty(paced, always=True) as port:
        converter = Converter(port.path)
        yield converter, bus, backend.car, tmp_path / "cars"
        converter.close()


@pytest.mark.slow
def test_the_backend_of_the_page_reads_states(package, served_car):
    converter, _, name, cars = served_car
    with Car.open(f"tcp://{converter.address}", car=name, cars=cars) as car:
        states = list(car.states(duration=0.2, timeout=10.0))
        assert states[-1].seq > states[0].seq + 10
        assert not car.drives, "without its bus the car is not driven"


@pytest.mark.slow
@pytest.mark.realtime
def test_the_backend_of_the_page_drives(package, served_car):
    converter, bus, name, cars = served_car
    with Car.open(f"tcp://{converter.address}?i2c=unix:{bus}", car=name, cars=cars) as car:
        assert car.drives
        list(car.states(duration=0.7, timeout=10.0))
        car.arm(waive=WAIVED_GATES)
        speeds = []
        for state in car.states(duration=1.5, timeout=10.0):
            car.drive(throttle=0.35)
            speeds.append(state.speed)
        assert max(speeds) > 0.2


def read_until(link, deadline: float) -> None:
    """Read all that still comes."""
    while time.monotonic() < deadline:
        link.read(1.0)


def test_a_connection_that_ends_is_a_lost_link(package, served_car):
    converter = served_car[0]
    backend = open_backend(f"tcp://{converter.address}")
    deadline = time.monotonic() + 10.0
    while converter._client is None and time.monotonic() < deadline:
        time.sleep(0.005)
    converter._client.shutdown(socket.SHUT_RDWR)
    with pytest.raises(LinkLost):
        read_until(backend.link, deadline)
    backend.close()
    with pytest.raises(LinkLost):
        backend.link.read(0.0)


@pytest.mark.parametrize("text", ["tcp://nohost", "tcp://h:1?i2x=1"])
def test_a_url_that_the_backend_does_not_know_is_refused(package, text):
    with pytest.raises(UsageError):
        open_backend(text)


def test_the_page_states_every_field():
    """Fields of ``Backend`` and those that the page names are the same."""
    text = BACKEND_PAGE.read_text(encoding="utf-8")
    table = [row.split("|")[1] for row in text.splitlines() if row.startswith("| `")]
    named = {part.strip(" `") for cell in table for part in cell.split(",")}
    assert named == {f.name for f in fields(Backend)}
    needed = [f.name for f in fields(Backend) if f.default is MISSING
              and f.default_factory is MISSING]
    assert needed == ["url", "link", "clock"]
