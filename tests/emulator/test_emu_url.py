"""avr:// as a backend and through plain pyserial, in virtual time."""

from __future__ import annotations

import subprocess
import sys

import pytest
import serial

from dart_hal.core.errors import LinkLost, UsageError
from dart_hal.core.url import Url
from dart_hal.devices.links.avr import VirtualLink, open_avr
from dart_hal.devices.links.base import open_backend
from dart_hal.devices.links.emulator import EmulatedNano

pytestmark = pytest.mark.emulator


def port(probe, **options):
    return serial.serial_for_url(f"avr://{probe}?wheel=5", baudrate=500_000, timeout=1, **options)


def test_pyserial_opens_the_emulator(probe):
    with port(probe) as ser:
        assert ser.read(3) == b"B\x01\x00"
        assert ser.write(b"xyz") == 3
        assert ser.read(3) == b"xyz"
        ser.write(b"c")
        answer = ser.read(5)
        assert answer[:1] == b"C"


@pytest.mark.slow
def test_a_timeout_passes_in_virtual_time(probe):
    with port(probe) as ser:
        ser.read(3)
        ser.timeout = 600
        before = ser.nano.now
        assert ser.read(1) == b""
        assert ser.nano.now == pytest.approx(before + 600)


def test_each_open_and_each_dtr_edge_resets(probe):
    with port(probe) as ser:
        assert ser.read(3) == b"B\x01\x00"
        ser.dtr = True
        assert ser.read(1) == b""  # no edge
        ser.dtr = False
        ser.dtr = True
        assert ser.read(3) == b"B\x02\x00"
    ser.open()
    assert ser.read(3) == b"B\x02\x00"


def test_polling_in_waiting_lets_time_pass(probe):
    with port(probe) as ser:
        reads = 0
        while ser.in_waiting < 3:
            reads += 1
        assert reads < 10
        assert ser.read(ser.in_waiting) == b"B\x01\x00"
        ser.reset_input_buffer()
        ser.write(b"xxx")
        ser.flush()
        assert ser.in_waiting >= 1


def test_the_rate_of_the_port_is_the_rate_of_the_line(probe):
    with serial.serial_for_url(f"avr://{probe}", baudrate=115_200, timeout=0.1) as ser:
        assert ser.read(3) != b"B\x01\x00"
        ser.baudrate = 500_000
        ser.write(b"xyz")
        assert ser.read(100)[-3:] == b"xyz"


def test_bad_urls_fail_as_serial_errors(probe):
    with pytest.raises(serial.SerialException, match="has no option"):
        serial.serial_for_url("avr://default?color=red")
    with pytest.raises(serial.SerialException, match="cannot be read"):
        serial.serial_for_url("avr:///no/such.elf")
    with pytest.raises(serial.PortNotOpenError):
        serial.serial_for_url(f"avr://{probe}", do_not_open=True).read(1)


def test_importing_the_links_is_light():
    code = ("import sys, dart_hal.devices.links; "
            "print([m for m in ('numpy', 'ctypes', 'dart_hal.devices.links.emulator')"
            " if m in sys.modules and m != 'ctypes'])")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "dart_hal.devices.links.emulator" not in done.stdout


def test_backend_of_the_firmware(firmware):
    backend = open_backend("avr://default?wheel=10")
    try:
        assert backend.virtual
        assert backend.bus is None
        chunks = [backend.link.read(2.0) for _ in range(30)]
        times = [chunk.t for chunk in chunks if chunk is not None]
        assert len(times) == 30
        assert times == sorted(times)
        assert backend.clock.now() == times[-1]
        assert all(chunk.data.endswith(b"\x00") for chunk in chunks if chunk is not None)
    finally:
        backend.close()
    with pytest.raises(LinkLost):
        backend.link.read(0.1)


def test_options_are_checked(probe):
    for text in ("edges=7", "edges=-2", "wheel=fast", "colour=red"):
        with pytest.raises(UsageError):
            open_avr(Url.parse(f"avr://{probe}?{text}"))


@pytest.mark.parametrize("slice_s", [0.0001, 0.001, 0.01])
def test_read_slices_give_the_same_stream(probe, slice_s):
    def stream(step):
        link = VirtualLink(EmulatedNano(probe))
        data = b""
        while link.now() < 0.2:
            chunk = link.read(step)
            if chunk is not None:
                data += chunk.data
                if chunk.data.endswith(b"\x00"):
                    link.write(b"c" if len(data) % 2 else b"t\x00\x03")  # at its stop bit
        link.close()
        return data

    assert len(stream(slice_s)) > 100
    assert stream(slice_s) == stream(0.05)


def test_sleep_keeps_what_came(probe):
    link = VirtualLink(EmulatedNano(probe))
    link.sleep(0.1)
    assert link.now() == 0.1
    assert link.read(0.0).data == b"B\x01\x00"
    assert link.read(0.0) is None
    link.close()
