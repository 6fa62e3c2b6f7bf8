"""A Nano with the real firmware, and a host that only knows the wire."""

from __future__ import annotations

import os
import shutil
import struct
import subprocess
from pathlib import Path
from typing import Any

import pytest

from dart_hal.devices.links.emulator import EmulatedNano
from dart_hal.wire import codec, messages
from dart_hal.wire.decoder import FrameDecoder

FIRMWARE = Path(__file__).parents[2] / "firmware"
BOARD_ID = 0x0DA27001
MARKS = [(i + 0.5) / 20 for i in range(20)]  # the wheel is between two

FLAG = {name: 1 << bit for bit, name in enumerate(messages.STATE_FLAGS)}


def missing(reason: str) -> None:
    """Skip with the reason, or fail where the emulator is required."""
    if os.environ.get("DART_HAL_REQUIRE_EMULATOR"):
        pytest.fail(reason)
    pytest.skip(reason)


def crc16(data: bytes, crc: int = 0xFFFF) -> int:
    """CRC-16 CCITT, bit by bit: a second opinion."""
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def slot(magic: int, counter: int, data: bytes) -> bytes:
    """One EEPROM record as firmware/src/core/slots.h draws it."""
    body = struct.pack("<HBBH", magic, 1, 0, counter) + data
    return body + struct.pack("<H", crc16(body))


def eeprom_image(board_id: int = BOARD_ID, boots: int = 4, **params: int) -> bytes:
    """EEPROM of a board that has been used: identity, and parameters if any are given."""
    image = bytearray(b"\xff" * 1024)
    record = slot(0x4944, boots, struct.pack("<IH", board_id, boots))
    image[0xE0:0xE0 + len(record)] = record
    if params:
        values = {p.name: p.default for p in messages.PARAMS} | params
        words = [values[p.name] // (100 if p.name == "baud" else 1) for p in messages.PARAMS]
        record = slot(0x5044, 1, struct.pack(f"<{len(words)}H", *words))
        image[0xA0:0xA0 + len(record)] = record
    return bytes(image)


def build_patched(where: Path, *changes: tuple[str, str, str]) -> Path:
    """ELF of a copy of the firmware with (file, old text, new text) replaced. Build `elf` first:
    its objects of the Arduino core are used again."""
    copy = where / "firmware"
    shutil.copytree(FIRMWARE, copy, ignore=lambda _, names: {
        n for n in names if n in {"emulator", "native"} or n.startswith(("dart_nano", "libdart"))})
    for name, old, new in changes:
        path = copy / name
        text = path.read_text()
        assert old in text, f"{name} no longer has {old!r}"
        path.write_text(text.replace(old, new))
    subprocess.run(["make", "-s", "-C", str(copy), "build/dart_nano.elf"], check=True,
                   capture_output=True)
    return copy / "build/dart_nano.elf"


class Rig:
    """`run` collects frames as (time, message name, values); `send` numbers its own."""

    def __init__(self, image: Path, eeprom: bytes | None = None, **options: Any) -> None:
        self.nano = EmulatedNano(image, eeprom=eeprom_image() if eeprom is None else eeprom,
                                 **options)
        self.nano.set_ring(0, MARKS)
        self.decoder = FrameDecoder()
        self.frames: list[tuple[float, str, dict[str, Any]]] = []
        self.raw = b""
        self.seq = 0

    @property
    def now(self) -> float:
        return self.nano.now

    def run(self, seconds: float) -> list[tuple[float, str, dict[str, Any]]]:
        until = self.nano.now + seconds
        start = len(self.frames)
        while self.nano.now < until - 1e-9:
            self.nano.run(until)
            for data, t in self.nano.read():
                self.raw += data
                for frame in self.decoder.feed(data):
                    self.frames.append((t, frame.message.name, frame.as_dict()))
        return self.frames[start:]

    def send(self, name: str, **values: Any) -> int:
        message = messages.BY_NAME[name]
        full = {f.name: 0 for f in message.fields} | values
        self.nano.write(codec.encode(message, self.seq, full))
        self.seq = (self.seq + 1) & 0xFF
        return self.seq - 1 & 0xFF

    def ask(self, name: str, answer: str, seconds: float = 0.15, **values: Any) -> dict[str, Any]:
        """Send and return the first answer; AssertionError when none comes."""
        self.send(name, **values)
        found = [v for _, n, v in self.run(seconds) if n == answer]
        assert found, f"no {answer} after {name}"
        return found[0]

    def hello(self) -> dict[str, Any]:
        found = [v for _, n, v in self.frames if n == "HELLO"]
        return found[-1] if found else self.ask("HELLO_REQ", "HELLO", proto=1)

    def beat(self, seconds: float, mode: int, token: int | None = None, flags: int = 0,
             period: float = 0.02) -> None:
        """Heartbeats for a while."""
        token = self.hello()["boot_nonce"] if token is None else token
        for _ in range(round(seconds / period)):
            self.send("HEARTBEAT", host_id=1, throttle=15000, steering=15000,
                      arm_token=token, mode=mode, flags=flags)
            self.run(period)

    def states(self, since: float = 0.0) -> list[dict[str, Any]]:
        return [v for t, n, v in self.frames if n == "STATE" and t >= since]

    def state(self) -> dict[str, Any]:
        return self.states()[-1]
