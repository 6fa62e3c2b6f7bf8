"""The busio-shaped adapter on smbus2, with the kernel's device replaced."""

from __future__ import annotations

import errno
from typing import ClassVar

import pytest
import smbus2

from dart_hal.core.errors import BusError
from dart_hal.devices.links.smbus import SmbusBus


class Device:
    """Replaces ``smbus2.SMBus``: 16 registers at 0x40, and errors on demand."""

    registers: ClassVar[bytearray] = bytearray(range(16))
    error: ClassVar[int] = 0
    pointer = 0

    def __init__(self, number: int) -> None:
        if number != 1:
            raise FileNotFoundError(errno.ENOENT, "No such file or directory")

    def i2c_rdwr(self, *messages: smbus2.i2c_msg) -> None:
        for message in messages:
            if self.error or message.addr != 0x40:
                raise OSError(self.error or errno.EREMOTEIO, "Remote I/O error")
            if message.flags & 1:
                for k in range(message.len):
                    message.buf[k] = self.registers[self.pointer + k]
            elif message.len:
                data = bytes(message)
                self.pointer = data[0]
                self.registers[data[0]:data[0] + len(data) - 1] = data[1:]

    def close(self) -> None:
        pass


@pytest.fixture
def bus(monkeypatch) -> SmbusBus:
    monkeypatch.setattr(smbus2, "SMBus", Device)
    monkeypatch.setattr(Device, "registers", bytearray(range(16)))
    return SmbusBus(1)


def test_slices_of_the_buffers_are_honoured(bus: SmbusBus) -> None:
    bus.writeto(0x40, bytes([99, 4, 77, 78, 99]), start=1, end=4)
    into = bytearray(6)
    bus.writeto_then_readfrom(0x40, bytes([99, 3]), into, out_start=1, in_start=2, in_end=5)
    assert list(into) == [0, 0, 3, 77, 78, 0]
    bus.readfrom_into(0x40, into, end=1)
    assert into[0] == 3


def test_the_bus_can_be_locked_once(bus: SmbusBus) -> None:
    assert bus.try_lock()
    assert not bus.try_lock()
    bus.unlock()
    assert bus.try_lock()


def test_a_scan_finds_what_acknowledges(bus: SmbusBus) -> None:
    assert bus.scan() == [0x40]


@pytest.mark.parametrize(("number", "word"), [
    (errno.EREMOTEIO, "decimal 40 for 0x40"), (errno.ETIMEDOUT, "stays low"),
    (errno.EIO, "loose jumper"), (errno.EBUSY, "device tree")])
def test_an_errno_is_explained(bus: SmbusBus, monkeypatch, number, word) -> None:
    monkeypatch.setattr(Device, "error", number)
    with pytest.raises(BusError) as caught:
        bus.writeto(0x40, b"\x00")
    assert caught.value.errno == number
    assert f"Errno {number}" in caught.value.found
    assert word in caught.value.likely
    assert "/dev/i2c-1" in caught.value.what
    assert caught.value.remedy


def test_a_missing_bus_gives_the_place_to_look_at(monkeypatch) -> None:
    monkeypatch.setattr(smbus2, "SMBus", Device)
    with pytest.raises(BusError, match="/dev/i2c-7") as caught:
        SmbusBus(7)
    assert "[pwm] bus" in caught.value.remedy
