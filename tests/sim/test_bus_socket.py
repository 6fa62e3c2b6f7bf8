"""The socket of a simulated car's I2C bus, spoken byte by byte as in docs/reference/urls.md."""

from __future__ import annotations

import socket
import struct

import pytest

from dart_hal.devices.links.base import open_backend
from dart_lab.sim.serve import BusServer, PacedWorld

PCA9685, MODE1, PRESCALE = 0x40, 0x00, 0xFE


@pytest.fixture
def transfer(tmp_path):
    backend = open_backend("sim://?nano=mock")
    with BusServer(backend, PacedWorld(backend), tmp_path / "i2c"), \
            socket.socket(socket.AF_UNIX) as client:
        client.connect(str(tmp_path / "i2c"))
        client.settimeout(5.0)

        def ask(address: int, data: bytes, size: int) -> bytes:
            client.sendall(struct.pack("<BHH", address, len(data), size) + data)
            return client.recv(1 + size)

        yield ask
    backend.close()


def test_a_register_is_written_and_read_back(transfer):
    assert transfer(PCA9685, bytes([MODE1, 0x10]), 0) == b"\0"  # asleep, or it keeps its prescale
    assert transfer(PCA9685, bytes([PRESCALE, 121]), 0) == b"\0"
    assert transfer(PCA9685, bytes([PRESCALE]), 1) == bytes([0, 121])


def test_an_absent_address_is_an_error_number(transfer):
    assert transfer(0x29, b"\0", 1) == bytes([121])
