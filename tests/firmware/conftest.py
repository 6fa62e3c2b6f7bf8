"""Fixtures of the firmware's tests: its core as a native library, its ELF in simavr.

What a missing tool prevents is skipped with the reason;
DART_HAL_REQUIRE_EMULATOR=1 turns that into a failure.
"""

from __future__ import annotations

import ctypes
import fcntl
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from dart_hal.core.errors import EmulatorMissing
from dart_hal.devices.links import bridge

sys.path.append(str(Path(__file__).parent))
from firmware_rig import FIRMWARE, Rig, missing


def make(target: str, *tools: str) -> None:
    absent = [tool for tool in tools if shutil.which(tool) is None]
    if absent:
        missing(f"firmware target {target}: {', '.join(absent)} not installed")
    with (FIRMWARE / "Makefile").open() as alone:  # no worker loads what another still links
        fcntl.flock(alone, fcntl.LOCK_EX)
        result = subprocess.run(["make", "-s", "-C", str(FIRMWARE), target],
                                capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.fixture(scope="session")
def core() -> ctypes.CDLL:
    """src/core compiled for this machine with UBSan; see firmware/test/native_api.cpp."""
    make("native", "make", "g++")
    lib = ctypes.CDLL(str(FIRMWARE / "build/native/libcore.so"))
    for name in ("core_crc16", "params_crc"):
        getattr(lib, name).restype = ctypes.c_uint16
    for name in ("params_get", "eeprom_illegal"):
        getattr(lib, name).restype = ctypes.c_uint32
    lib.eeprom_cells.restype = ctypes.POINTER(ctypes.c_uint8 * 1024)
    return lib


@pytest.fixture(scope="session")
def elf() -> Path:
    """The release image, built from the sources as they are."""
    make("hex", "make", "avr-g++")
    return FIRMWARE / "build/dart_nano.elf"


@pytest.fixture(scope="session")
def test_elf() -> Path:
    """The image that writes marks to GPIOR0."""
    make("build/dart_nano_test.elf", "make", "avr-g++")
    return FIRMWARE / "build/dart_nano_test.elf"


@pytest.fixture
def nano(elf: Path) -> Iterator[Callable[..., Rig]]:
    """Builds rigs: `nano(eeprom=...)`; closes them at the end."""
    rigs: list[Rig] = []
    try:
        bridge.load()
    except EmulatorMissing as error:
        missing(f"emulator bridge: {error.what}")

    def build(image: Path = elf, **options: object) -> Rig:
        rigs.append(Rig(image, **options))
        return rigs[-1]

    yield build
    for rig in rigs:
        rig.nano.close()
