"""Flash images of the ATmega328P: conversion of Intel hex and AVR ELF to bytes.

The loaders check every address before they place a byte: an image that does not fit the flash is
refused with its address, never truncated.
"""

from __future__ import annotations

import os
import struct
from pathlib import Path

from dart_hal.core.errors import EmulatorMissing

# Bytes of flash of the ATmega328P.
FLASH_SIZE = 32 * 1024

# The firmware of the checkout; missing in an installed package.
FIRMWARE_DIR = Path(__file__).resolve().parents[4] / "firmware"

# The prebuilt image in an installed package; missing in a checkout.
PACKAGED = Path(__file__).resolve().parents[2] / "prebuilt" / "dart_nano.hex"

# Start of the 2 KiB boot section that the Nano's fuses reserve [byte address].
BOOT_START = 0x7800

# From Debian's arduino-core-avr; its optiboot hex is too long and never starts the program.
BOOTLOADER = Path("/usr/share/arduino/hardware/arduino/avr/bootloaders/atmega/"
                  "ATmegaBOOT_168_atmega328.hex")

# Machine number of AVR in an ELF header.
_EM_AVR = 83
# First address of RAM and EEPROM sections for the linker of avr-gcc.
_DATA_SPACE = 0x800000


class ImageError(EmulatorMissing, ValueError):
    """A file that is no image for this flash; the message has the place and the reason."""

    likely_default = "another file than a firmware image"
    remedy_default = "avr://default runs the firmware of this version"


class _Flash:
    """Bytes that a file placed, 0xFF elsewhere."""

    def __init__(self, source: str, size: int) -> None:
        self.source = source
        self.data = bytearray(b"\xff" * size)
        self.end = 0

    def place(self, address: int, chunk: bytes) -> None:
        stop = address + len(chunk)
        if stop > len(self.data):
            raise ImageError(
                f"{self.source}: bytes {address:#x}..{stop - 1:#x} lie beyond the flash",
                expected=f"addresses below {len(self.data):#x}",
                remedy="build the image for the ATmega328P")
        self.data[address:stop] = chunk
        self.end = max(self.end, stop)

    def bytes(self) -> bytes:
        if not self.end:
            raise ImageError(f"{self.source}: contains no byte for the flash")
        return bytes(self.data[:self.end])


def parse_hex(text: str, source: str = "image", size: int = FLASH_SIZE) -> bytes:
    """Convert Intel hex (types 00 to 05) to the bytes from address 0 to the last one placed.

    Gaps are 0xFF. Raises ImageError on a syntax error, a wrong checksum, a missing end record or a
    byte beyond ``size``.
    """
    flash = _Flash(source, size)
    base = 0
    for number, line in enumerate(text.split(), 1):
        where = f"{source}: line {number}"
        try:
            record = bytes.fromhex(line[1:])
        except ValueError:
            record = b""
        if line[:1] != ":" or len(record) < 5 or len(record) != record[0] + 5:
            raise ImageError(f"{where} is no Intel hex record", found=line[:44])
        if sum(record) & 0xFF:
            raise ImageError(f"{where} has a wrong checksum", found=line[:44])
        address, kind, data = record[1] << 8 | record[2], record[3], record[4:-1]
        if kind == 0:
            flash.place(base + address, data)
        elif kind == 1:
            return flash.bytes()
        elif kind in (2, 4) and len(data) == 2:
            base = int.from_bytes(data, "big") << (4 if kind == 2 else 16)
        elif kind not in (3, 5):
            raise ImageError(f"{where} has record type {kind:#04x}", found=line[:44])
    raise ImageError(f"{source}: end record missing", likely="the file was cut off")


def parse_elf(blob: bytes, source: str = "image", size: int = FLASH_SIZE) -> bytes:
    """Convert AVR ELF32 to flash bytes: each loadable segment at its load address.

    Segments for RAM, EEPROM and fuses (0x800000 and up) are ignored; .data is placed at its load
    address in flash. Raises ImageError.
    """
    try:
        head = struct.unpack_from("<16sHHIIIIIHHHHHH", blob)
    except struct.error:
        raise ImageError(f"{source} is too short for an ELF file") from None
    if head[0][:6] != b"\x7fELF\x01\x01" or head[2] != _EM_AVR:
        raise ImageError(f"{source} is no 32-bit AVR ELF file", found=f"machine {head[2]}")
    flash = _Flash(source, size)
    offset = head[5]
    entry = head[9]
    count = head[10]
    for i in range(count):
        try:
            kind, start, _, load, length = struct.unpack_from("<IIIII", blob, offset + i * entry)
        except struct.error:
            raise ImageError(f"{source}: program header {i} lies beyond the file") from None
        if kind != 1 or length == 0 or load >= _DATA_SPACE:
            continue
        if start + length > len(blob):
            raise ImageError(f"{source}: segment {i} lies beyond the file",
                             likely="the file was cut off")
        flash.place(load, blob[start:start + length])
    return flash.bytes()


def load_image(path: str | os.PathLike[str]) -> bytes:
    """Load the flash bytes of a .hex or .elf file. Raises EmulatorMissing (ImageError is one)."""
    path = Path(path)
    try:
        blob = path.read_bytes()
    except OSError as error:
        raise EmulatorMissing(f"firmware image {path} cannot be read", found=str(error.strerror),
                              likely="a wrong path",
                              remedy="avr://default runs the firmware of this version") from None
    if blob[:4] == b"\x7fELF":
        return parse_elf(blob, str(path))
    try:
        return parse_hex(blob.decode("ascii"), str(path))
    except UnicodeDecodeError:
        raise ImageError(f"{path} is neither Intel hex nor ELF") from None


def find_image() -> Path:
    """Find the firmware image: $DART_HAL_FIRMWARE, the checkout's build, the prebuilt hex.

    Raises EmulatorMissing with every path that was tried.
    """
    named = os.environ.get("DART_HAL_FIRMWARE")
    if named:
        if not Path(named).is_file():
            raise EmulatorMissing(f"$DART_HAL_FIRMWARE names {named}, which is no file")
        return Path(named)
    places = [FIRMWARE_DIR / "build" / "dart_nano.elf", FIRMWARE_DIR / "build" / "dart_nano.hex",
              FIRMWARE_DIR / "prebuilt" / "dart_nano.hex", PACKAGED]
    for place in places:
        if place.is_file():
            return place
    raise EmulatorMissing("no firmware image: neither built nor prebuilt",
                          expected=", ".join(str(p) for p in places),
                          likely="the firmware was not built", remedy="make firmware")


def with_bootloader(image: bytes, bootloader: str | os.PathLike[str] = BOOTLOADER) -> bytes:
    """Combine ``image`` (may be empty) with a bootloader, as in the flash of a new Nano.

    Raises ImageError when they overlap, EmulatorMissing without the file.
    """
    boot = load_image(bootloader)
    if len(image) > BOOT_START:
        raise ImageError(f"an image of {len(image)} bytes reaches into the boot section",
                         expected=f"at most {BOOT_START} bytes")
    if boot[:BOOT_START].strip(b"\xff"):
        raise ImageError(f"{bootloader} places bytes below the boot section",
                         expected=f"addresses from {BOOT_START:#x}")
    return image.ljust(BOOT_START, b"\xff") + boot[BOOT_START:]
