"""A real pty: plain pyserial, reset on open, no spinning."""

from __future__ import annotations

import select
import time
from itertools import pairwise

import pytest
import serial

from dart_hal.devices.links import pty as pty_module
from dart_hal.devices.links.emulator import EmulatedNano
from dart_hal.devices.links.pty import Pty

pytestmark = [pytest.mark.emulator, pytest.mark.realtime]


def wait_for(condition, seconds=5.0):
    deadline = time.monotonic() + seconds
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.005)
    return condition()


@pytest.fixture
def served_nano(probe):
    with EmulatedNano(probe) as nano, Pty(nano) as pty:
        yield nano, pty


def test_echo_with_plain_pyserial(served_nano):
    _, pty = served_nano
    with serial.Serial(pty.path, 500_000, timeout=5, exclusive=True) as ser:
        assert ser.read(3)[:1] == b"B"
        ser.write(b"hxyz\n\r\x03")
        assert ser.read(7) == b"hxyz\n\r\x03"  # raw: nothing is translated
    assert pty.dropped == 0


def test_each_open_resets(served_nano):
    _, pty = served_nano
    for n in (1, 2, 3):
        with serial.Serial(pty.path, 500_000, timeout=5) as ser:
            boot = ser.read(3)
            assert (boot[0], boot[2]) == (ord("B"), 0)
            assert boot[1] & 2  # external reset
            assert pty.opens == n
        assert wait_for(lambda: not pty.is_open)


class SlowSerial(serial.Serial):
    """Set aside by the kernel between opening the port and discarding what had come."""

    patience = 0.03

    def _reset_input_buffer(self):
        select.select([self.fd], [], [], self.patience)
        super()._reset_input_buffer()


@pytest.mark.parametrize(("hold", "patience", "kept"), [
    (1.0, 0.03, True), (0.0, 5.0, False)])  # the control: without the hold it is lost
def test_a_slow_open_does_not_lose_the_boot_message(served_nano, monkeypatch, hold, patience, kept):
    """Longer than it is and than it must be, so that a busy machine is no third case."""
    monkeypatch.setattr(pty_module, "RESET_HOLD_TIME", hold)
    monkeypatch.setattr(SlowSerial, "patience", patience)
    with SlowSerial(served_nano[1].path, 500_000, timeout=5.0 if kept else 0.3) as ser:
        assert (ser.read(1) == b"B") == kept


def test_without_reset_on_open_the_program_runs_on(probe):
    with EmulatedNano(probe) as nano, Pty(nano, reset_on_open=False) as pty:
        assert wait_for(lambda: nano.now > 0.05)
        with serial.Serial(pty.path, 500_000, timeout=0.3) as ser:
            assert ser.read(1) == b""  # no boot message
            ser.write(b"x")
            assert ser.read(1) == b"x"


def test_time_does_not_pass_until_the_port_is_opened(served_nano):
    nano, _ = served_nano
    cpu = time.process_time()
    time.sleep(0.3)
    assert nano.now == 0.0
    assert time.process_time() - cpu < 0.15  # half a core would be a spin


def test_the_tick_sees_every_millisecond(probe):
    ticks: list[float] = []
    with (EmulatedNano(probe) as nano, Pty(nano, tick=ticks.append) as pty,
          serial.Serial(pty.path, 500_000, timeout=5) as ser):
        ser.read(3)
        assert wait_for(lambda: nano.now > 0.1)
    gaps = [b - a for a, b in pairwise(ticks)]
    assert len(ticks) >= 100
    assert max(gaps) <= 0.001 + 1e-9


def test_the_ports_rate_reaches_the_nano(served_nano):
    _, pty = served_nano
    with serial.Serial(pty.path, 115_200, timeout=0.3) as ser:
        assert ser.read(3) != b"B\x03\x00"
        ser.baudrate = 500_000
        ser.reset_input_buffer()
        assert wait_for(lambda: (ser.write(b"x"), ser.read(50)[-1:] == b"x")[1])


def test_a_failure_of_the_thread_is_raised_by_close(probe):
    def broken(t):
        raise ZeroDivisionError("tick")

    with EmulatedNano(probe) as nano:
        pty = Pty(nano, tick=broken)
        pty.start()
        with serial.Serial(pty.path, 500_000, timeout=0.2) as ser:
            ser.read(1)
        with pytest.raises(ZeroDivisionError):
            pty.close()


def test_a_pacing_thread_that_dies_is_detected_and_its_failure_raised(nano):
    def tick(t: float) -> None:
        raise RuntimeError("the world ended")

    port = Pty(nano, tick, reset_on_open=False)
    port.start()
    deadline = time.monotonic() + 10.0
    while port.alive and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not port.alive
    with pytest.raises(RuntimeError, match="the world ended"):
        port.close()


def test_a_served_car_rolls_on_while_the_port_is_closed(probe):
    with EmulatedNano(probe) as nano, Pty(nano, always=True) as pty:
        assert wait_for(lambda: nano.now > 0.05)
        with serial.Serial(pty.path, 500_000, timeout=5) as ser:
            assert ser.read(3)[0] == ord("B")  # and an open still resets
        then = nano.now
        assert wait_for(lambda: nano.now > then + 0.05)
