"""Flashing without hardware: avrdude over the pty, through the real bootloader."""

from __future__ import annotations

import shutil
import subprocess

import pytest
import serial
from serial import SerialException

from dart_hal.devices.links.emulator import EmulatedNano
from dart_hal.devices.links.image import BOOTLOADER, load_image
from dart_hal.devices.links.pty import Pty
from dart_hal.wire.decoder import FrameDecoder

pytestmark = pytest.mark.emulator

needs_tools = pytest.mark.skipif(shutil.which("avrdude") is None or not BOOTLOADER.is_file(),
                                 reason="avrdude or Debian's ATmegaBOOT image is not installed")


def flash(path, image):
    command = ["avrdude", "-c", "arduino", "-p", "m328p", "-P", path, "-b", "57600", "-D",
               "-U", f"flash:w:{image}:i"]
    return subprocess.run(command, capture_output=True, text=True, timeout=60)


@pytest.mark.slow
@needs_tools
def test_avrdude_programs_a_blank_nano_and_the_program_starts(probe):
    image = probe.with_suffix(".hex")
    with EmulatedNano(b"", bootloader=True) as nano, Pty(nano) as pty:
        done = flash(pty.path, image)
        assert done.returncode == 0, done.stderr
        assert "verified" in done.stderr
        program = load_image(image)
        assert nano.flash[:len(program)] == program
        with serial.Serial(pty.path, 500_000, timeout=5) as ser:
            assert ser.read(1) == b"B"


@needs_tools
@pytest.mark.long
def test_avrdude_programs_the_firmware_and_it_sends_hello(firmware):
    """Write, verify, then a clean stream that begins with HELLO."""
    with EmulatedNano(b"", bootloader=True) as nano, Pty(nano) as pty:
        done = flash(pty.path, firmware.with_suffix(".hex"))
        assert done.returncode == 0, done.stderr
        decoder = FrameDecoder()
        names = []
        with serial.Serial(pty.path, 500_000, timeout=5) as ser:
            while len(names) < 300:
                data = ser.read(200)
                assert data, f"silent after {len(names)} frames"
                names += [frame.message.name for frame in decoder.feed(data)]
    counters = decoder.counters
    assert "HELLO" in names[:20]
    assert names.count("STATE") > 200
    assert (counters.crc, counters.cobs, counters.gaps) == (0, 0, 0)


@needs_tools
def test_the_bootloader_waits_and_starts_the_program(probe):
    with EmulatedNano(probe, bootloader=True) as nano:
        nano.run(0.5)
        assert nano.read() == []
        assert nano.run(3.0)
        assert 1.0 < nano.now < 2.0  # about the delay of the real one
        assert nano.read()[0][0][:1] == b"B"


@needs_tools
@pytest.mark.slow
def test_a_watchdog_reset_under_the_old_bootloader_loops_for_ever(probe):
    with EmulatedNano(probe, bootloader=True) as nano:
        assert nano.run(3.0)
        nano.read()
        nano.write(b"w")
        assert nano.run(nano.now + 5.0) is False
        assert nano.read() == []
        nano.reset("power")
        assert nano.run(nano.now + 3.0)


def test_without_a_board_avrdude_fails(probe, tmp_path):
    if shutil.which("avrdude") is None:
        pytest.skip("avrdude is not installed")
    assert flash(str(tmp_path / "nothing"), probe.with_suffix(".hex")).returncode != 0
    with pytest.raises(SerialException):
        serial.Serial(str(tmp_path / "nothing"))
