"""The recorded bus is the bus, plus a note of what happened on it."""

from __future__ import annotations

import pytest

from dart_hal.core.errors import BusError
from dart_hal.core.ports import Bus
from dart_hal.recording.bus import RecordedBus
from dart_hal.recording.run import RunReader, RunWriter
from dart_lab.sim.bus import VirtualBus
from dart_lab.sim.pca9685 import Pca9685Model


@pytest.fixture
def recorded_bus(tmp_path):
    writer = RunWriter(tmp_path / "bus.mcap")
    bus = RecordedBus(VirtualBus(lambda: 0.5, [Pca9685Model()]), lambda: 0.5)
    bus.recorder = writer
    return bus, writer


def transactions(writer):
    writer.close()
    return [(b.t, b.address, b.wrote, b.read) for b in RunReader(writer.path).i2c()]


def test_it_has_the_shape_of_a_bus(recorded_bus):
    assert isinstance(recorded_bus[0], Bus)


def test_transactions_are_noted_as_they_were(recorded_bus):
    bus, writer = recorded_bus
    assert bus.try_lock()
    bus.writeto(0x40, b"\xff\x00\x21", start=1)
    answer = bytearray(3)
    bus.writeto_then_readfrom(0x40, b"\x00", answer, in_start=1, in_end=2)
    bus.unlock()
    assert answer[1] == 0x21
    assert transactions(writer) == [(0.5, 0x40, b"\x00\x21", b""),
                                    (0.5, 0x40, b"\x00", b"\x21")]


def test_what_failed_is_not_noted_and_still_fails(recorded_bus):
    bus, writer = recorded_bus
    bus.try_lock()
    with pytest.raises((OSError, BusError)):
        bus.writeto(0x55, b"\x00")
    assert transactions(writer) == []


def test_without_a_recorder_it_only_passes_on(recorded_bus):
    bus, writer = recorded_bus
    bus.recorder = None
    bus.try_lock()
    bus.writeto(0x40, b"\x00\x21")
    assert transactions(writer) == []
