"""Flash images: formats, bounds, and the message when one is missing."""

from __future__ import annotations

import shutil
import struct
import subprocess

import pytest

from dart_hal.core.errors import EmulatorMissing
from dart_hal.devices.links import bridge, image
from dart_hal.devices.links.image import (
    FIRMWARE_DIR,
    FLASH_SIZE,
    ImageError,
    find_image,
    load_image,
    parse_elf,
    parse_hex,
    with_bootloader,
)


def record(address, data, kind=0):
    raw = bytes([len(data), address >> 8, address & 0xFF, kind]) + data
    return ":" + (raw + bytes([-sum(raw) & 0xFF])).hex().upper() + "\n"


END_RECORD = record(0, b"", 1)


def elf(*segments, machine=83, cut=0):
    """Segments (kind, load address, bytes) as a minimal ELF file."""
    n = len(segments)
    blob = b""
    table = b""
    base = 52 + 32 * n
    for kind, load, data in segments:
        table += struct.pack("<8I", kind, base + len(blob), load, load, len(data), len(data), 5, 1)
        blob += data
    head = struct.pack("<16sHHIIIIIHHHHHH", b"\x7fELF\x01\x01\x01", 2, machine, 1, 0, 52, 0, 0,
                       52, 32, n, 0, 0, 0)
    return (head + table + blob)[:len(head + table + blob) - cut]


def test_hex_round_trip_with_a_gap():
    text = record(0, b"\x01\x02") + record(0x10, b"\x03") + END_RECORD
    assert parse_hex(text) == b"\x01\x02" + b"\xff" * 14 + b"\x03"


def test_hex_addresses_extend():
    text = record(0, b"\x07\x80", 2) + record(0, b"\xaa", 0) + END_RECORD  # segment 0x0780 = 0x7800
    assert parse_hex(text)[0x7800] == 0xAA
    assert parse_hex(record(0, bytes(4), 3) + record(0, b"\x01") + END_RECORD) == b"\x01"


@pytest.mark.parametrize(("text", "message"), [
    ("hello\n", "line 1 is no Intel hex"),
    (record(0, b"\x01")[:-3] + "00\n" + END_RECORD, "checksum"),
    (record(0, b"\x01"), "end record missing"),
    (record(0, b"\x01", 9) + END_RECORD, "record type 0x09"),
    (END_RECORD, "contains no byte"),
    (record(FLASH_SIZE - 1, b"\x01\x02") + END_RECORD, "beyond the flash"),
    (record(0, b"\x00\x01", 4) + record(0, b"\x01") + END_RECORD, "beyond the flash"),
])
def test_bad_hex_is_refused_with_its_place(text, message):
    with pytest.raises(ImageError, match=message):
        parse_hex(text)


def test_last_byte_of_the_flash_is_allowed():
    assert len(parse_hex(record(FLASH_SIZE - 1, b"\x01") + END_RECORD)) == FLASH_SIZE


def test_elf_takes_load_addresses_and_leaves_ram_out():
    blob = elf((1, 0, b"code"), (1, 0x100, b"data"), (1, 0x800100, b"ram"), (4, 0, b"note"))
    flash = parse_elf(blob)
    assert flash[:4] == b"code"
    assert flash[0x100:] == b"data"
    assert len(flash) == 0x104


@pytest.mark.parametrize(("blob", "message"), [
    (b"\x7fELF", "too short"),
    (elf((1, 0, b"x"), machine=62), "no 32-bit AVR"),
    (elf((1, FLASH_SIZE - 2, b"xyz")), "beyond the flash"),
    (elf((1, 0, b"code"), cut=2), "beyond the file"),
    (elf((1, 0x800100, b"ram")), "contains no byte"),
])
def test_bad_elf_is_refused(blob, message):
    with pytest.raises(ImageError, match=message):
        parse_elf(blob)


def test_hex_and_elf_of_one_program_agree(probe):
    assert load_image(probe) == load_image(probe.with_suffix(".hex"))


def test_missing_images_name_the_places(tmp_path, monkeypatch):
    monkeypatch.delenv("DART_HAL_FIRMWARE", raising=False)
    monkeypatch.setattr(image, "FIRMWARE_DIR", tmp_path)
    with pytest.raises(EmulatorMissing) as error:
        find_image()
    assert "prebuilt" in str(error.value)
    monkeypatch.setenv("DART_HAL_FIRMWARE", str(tmp_path / "no.elf"))
    with pytest.raises(EmulatorMissing, match=r"DART_HAL_FIRMWARE names .*no\.elf"):
        find_image()
    with pytest.raises(EmulatorMissing, match="cannot be read"):
        load_image(tmp_path / "no.elf")


def test_images_are_searched_in_order(tmp_path, monkeypatch):
    monkeypatch.delenv("DART_HAL_FIRMWARE", raising=False)
    monkeypatch.setattr(image, "FIRMWARE_DIR", tmp_path)
    for place in ("prebuilt/dart_nano.hex", "build/dart_nano.hex", "build/dart_nano.elf"):
        (tmp_path / place).parent.mkdir(exist_ok=True)
        (tmp_path / place).write_text("x")
        assert find_image() == tmp_path / place
    monkeypatch.setenv("DART_HAL_FIRMWARE", str(tmp_path / "prebuilt/dart_nano.hex"))
    assert find_image() == tmp_path / "prebuilt/dart_nano.hex"


def test_missing_bridge_states_how_to_build_it(tmp_path, monkeypatch):
    monkeypatch.setenv("DART_HAL_EMULATOR", str(tmp_path / "no.so"))
    with pytest.raises(EmulatorMissing, match="DART_HAL_EMULATOR") as error:
        bridge.load()
    assert "make firmware" in str(error.value)
    (tmp_path / "no.so").write_bytes(b"not a library")
    with pytest.raises(EmulatorMissing, match="does not load"):
        bridge.load()


@pytest.mark.emulator
def test_a_library_that_is_no_bridge_is_refused(emulator, monkeypatch):
    import ctypes.util

    name = ctypes.util.find_library("simavr")
    monkeypatch.setattr(bridge, "find_library", lambda: name)
    with pytest.raises(EmulatorMissing, match="no bridge of this version"):
        bridge.load()


def test_bootloader_and_program_must_not_overlap(tmp_path):
    boot = tmp_path / "boot.hex"
    boot.write_text(record(0x7800, b"boot") + END_RECORD)
    flash = with_bootloader(b"app", boot)
    assert (flash[:3], flash[0x7800:]) == (b"app", b"boot")
    with pytest.raises(ImageError, match="boot section"):
        with_bootloader(bytes(0x7801), boot)
    boot.write_text(record(0x100, b"boot") + END_RECORD)
    with pytest.raises(ImageError, match="below the boot section"):
        with_bootloader(b"app", boot)


def test_an_untested_simavr_is_refused_unless_requested(tmp_path):
    if shutil.which("make") is None:
        pytest.skip("make is not installed")
    (tmp_path / "sim_core_config.h").write_text('#define CONFIG_SIMAVR_VERSION "9.9"\n')

    def check(*options):
        return subprocess.run(["make", "-C", str(FIRMWARE_DIR / "emulator"), "check", *options],
                              capture_output=True, text=True)

    refused = check(f"INCLUDE={tmp_path}")
    assert refused.returncode != 0
    assert "simavr 9.9 is not tested" in refused.stderr
    forced = check(f"INCLUDE={tmp_path}", "UNTESTED_SIMAVR=1")
    assert forced.returncode == 0
    assert "warning: simavr 9.9" in forced.stderr
    absent = check(f"INCLUDE={tmp_path}/none")
    assert absent.returncode != 0
    assert "libsimavr-dev" in absent.stderr
