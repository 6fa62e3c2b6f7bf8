"""Fixtures of the emulator's tests: the bridge, its test program, a Nano.

Without the bridge or the AVR compiler every test that needs it is skipped
with the reason; DART_HAL_REQUIRE_EMULATOR=1 turns that into a failure.
"""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from dart_hal.core.errors import EmulatorMissing
from dart_hal.devices.links import bridge
from dart_hal.devices.links.emulator import EmulatedNano
from dart_hal.devices.links.image import FIRMWARE_DIR, find_image


class Probe(EmulatedNano):
    """A Nano with the test program, and its vocabulary."""

    def drain(self, until: float) -> bytes:
        """Run to ``until`` [s] across all delimiters; the bytes that came."""
        while self.run(until):
            pass
        return b"".join(data for data, _ in self.read())

    def ask(self, request: bytes, seconds: float = 0.05) -> bytes:
        """Send a request to the program and collect its answer."""
        self.write(request)
        return self.drain(self.now + seconds)

    def counts(self) -> tuple[int, int]:
        """Edges that the program has counted on D2 and D3, modulo 2^16."""
        answer = self.ask(b"c", 0.002)
        assert answer[:1] == b"C"
        return int.from_bytes(answer[1:3], "little"), int.from_bytes(answer[3:5], "little")


def missing(reason: str) -> None:
    if os.environ.get("DART_HAL_REQUIRE_EMULATOR"):
        pytest.fail(reason)
    pytest.skip(reason)


@pytest.fixture(scope="session")
def emulator() -> None:
    """Skips with the reason when the bridge cannot be loaded."""
    try:
        bridge.load()
    except EmulatorMissing as error:
        missing(f"emulator bridge: {error.what}")


@pytest.fixture(scope="session")
def probe(emulator: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The test program firmware/emulator/test/probe.c as ELF (a .hex is in the same folder)."""
    out = tmp_path_factory.mktemp("probe")
    make = ["make", "-s", "-C", str(FIRMWARE_DIR / "emulator"), f"OUT={out}", "probe"]
    try:
        subprocess.run(make, check=True, capture_output=True, text=True)
    except FileNotFoundError:
        missing("make is not installed")
    except subprocess.CalledProcessError as error:
        missing(f"test program does not build: {error.stderr.strip()[-200:]}")
    return out / "probe.elf"


@pytest.fixture(scope="session")
def firmware(emulator: None) -> Path:
    """The firmware image of the car."""
    try:
        return find_image()
    except EmulatorMissing as error:
        missing(f"firmware: {error.what}")
        raise


@pytest.fixture
def make_nano(probe: Path) -> Iterator[Callable[..., Probe]]:
    """Factory of Nanos with the test program, closed at the end; booted to 1 ms."""
    made: list[Probe] = []

    def make(**options: object) -> Probe:
        nano = Probe(probe, **options)  # type: ignore[arg-type]
        made.append(nano)
        nano.drain(0.001)
        nano.marks()
        return nano

    yield make
    for nano in made:
        nano.close()


@pytest.fixture
def nano(make_nano: Callable[..., Probe]) -> Probe:
    return make_nano()
