"""The bus of the virtual world: shape, time, faults, log."""

from __future__ import annotations

import errno

import pytest

from dart_hal.core.ports import Bus
from dart_lab.sim.bus import VirtualBus
from dart_lab.sim.pca9685 import Pca9685Model


def make(now=lambda: 0.0):
    return VirtualBus(now, [Pca9685Model()])


def test_has_the_shape_of_a_bus():
    assert isinstance(make(), Bus)


def test_lock_is_exclusive():
    bus = make()
    assert bus.try_lock()
    assert not bus.try_lock()
    bus.unlock()
    assert bus.try_lock()


@pytest.mark.parametrize("address", [0x41, 0x28])
def test_an_absent_chip_is_errno_121(address):
    with pytest.raises(OSError) as caught:
        make().writeto(address, b"\x00")
    assert caught.value.errno == errno.EREMOTEIO == 121


def test_nack_on_demand_counts_down():
    bus = make()
    bus.nack = 2
    for _ in range(2):
        with pytest.raises(OSError):
            bus.writeto(0x40, b"\x00")
    bus.writeto(0x40, b"\x00")
    assert [t.error for t in bus.log] == [121, 121, 0]


@pytest.mark.parametrize("line", ["sda", "scl"])
def test_a_stuck_line_times_out(line):
    bus = make()
    bus.stuck = line
    with pytest.raises(OSError) as caught:
        bus.readfrom_into(0x40, bytearray(1))
    assert caught.value.errno == errno.ETIMEDOUT
    assert bus.scan() == []


def test_transactions_follow_each_other_on_the_wire():
    bus = make()
    for _ in range(3):
        bus.writeto(0x40, bytes(9))
    for one, two in zip(bus.log, list(bus.log)[1:], strict=False):
        assert two.t_start == one.t_stop
        assert one.t_stop - one.t_start == pytest.approx(0.92e-3, abs=1e-5)


def test_slices_of_buffers_as_busio_has_them():
    bus = make()
    bus.writeto(0x40, b"\xff\x00\xff", start=1, end=2)
    buffer = bytearray(b"abc")
    bus.readfrom_into(0x40, buffer, start=1, end=2)
    assert buffer == b"a\x11c"
    bus.writeto_then_readfrom(0x40, b"\x00\xfe", buffer, out_start=1, in_end=1)
    assert buffer[0] == 0x1E


def test_the_log_holds_what_was_written():
    bus = make()
    bus.writeto(0x40, b"\x06\x01")
    assert (bus.log[0].written, bus.log[0].address) == (b"\x06\x01", 0x40)
