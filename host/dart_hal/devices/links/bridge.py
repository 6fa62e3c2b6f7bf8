"""The C bridge to simavr: search, loading, signatures, version check.

firmware/emulator/emu.h documents each function. The library is built on the user's computer
(`make -C firmware emulator`) and is not part of the package.
"""

from __future__ import annotations

import ctypes as c
import os
from functools import cache
from pathlib import Path

from dart_hal.core.errors import EmulatorMissing
from dart_hal.devices.links.image import FIRMWARE_DIR

# EMU_ABI of the emu.h that the signatures below follow.
ABI = 5

REMEDY = "make firmware" if FIRMWARE_DIR.is_dir() else (
    "clone the project and run `make firmware` in it (a wheel carries no emulator), then "
    "export DART_HAL_EMULATOR=CLONE/firmware/build/libdartemu.so")

_P = c.c_void_p
_U64 = c.c_uint64
_D = c.c_double
_I = c.c_int
_SIGNATURES: dict[str, tuple[object, ...]] = {
    # name: result, arguments
    "emu_abi": (_I,),
    "emu_simavr": (c.c_char_p,),
    "emu_log": (c.c_char_p,),
    "emu_new": (_P, c.c_char_p, c.c_uint32, c.c_uint32),
    "emu_free": (None, _P),
    "emu_clock": (None, _P, _D),
    "emu_reset": (None, _P, _I),
    "emu_boot": (None, _P, _P),
    "emu_run": (_I, _P, _U64),
    "emu_step": (_I, _P, _U64, _P),
    "emu_now": (_U64, _P),
    "emu_uart_read": (_I, _P, _P, _P, _I),
    "emu_uart_write": (_I, _P, c.c_char_p, _I),
    "emu_uart_baud": (None, _P, _D),
    "emu_uart_stats": (None, _P, _P),
    "emu_chatter": (_I, _P, _I, _D, _I),
    "emu_ring": (_I, _P, _I, _P, _I),
    "emu_wheel": (None, _P, _D),
    "emu_position": (_D, _P),
    "emu_edges": (_U64, _P, _I),
    "emu_imu": (None, _P, _P, _P),
    "emu_imu_fault": (None, _P, _I, _D),
    "emu_imu_config": (None, _P),
    "emu_imu_reset": (None, _P),
    "emu_imu_setup": (None, _P, _P),
    "emu_imu_peek": (_I, _P, _I),
    "emu_i2c": (None, _P, _I, _D, _D, _I),
    "emu_pin": (None, _P, _I, _I, _I),
    "emu_capture": (None, _P, _I),
    "emu_pin_state": (_I, _P, _I, _I),
    "emu_divider": (None, _P, _D, _D),
    "emu_pin_log": (_I, _P, _P, _P, _P, _I),
    "emu_eeprom_get": (_I, _P, _P, _I),
    "emu_eeprom_set": (_I, _P, c.c_char_p, _I),
    "emu_eeprom_tear": (None, _P, _I),
    "emu_flash_get": (_I, _P, _P, _I),
    "emu_isr": (None, _P, _I, _P),
    "emu_mark": (_I, _P, _P, _P, _I),
    "emu_stack": (None, _P, _P),
    "emu_peek": (_I, _P, _I),
    "emu_poke": (None, _P, _I, _I),
    "emu_hang": (None, _P, _I),
    "emu_freeze": (None, _P, _I),
    "emu_vcc": (None, _P, _I),
    "emu_power": (None, _P, _I),
}


def find_library() -> Path:
    """Return the path of the bridge: $DART_HAL_EMULATOR, then the checkout's build.

    Raises EmulatorMissing.
    """
    named = os.environ.get("DART_HAL_EMULATOR")
    place = Path(named) if named else FIRMWARE_DIR / "build" / "libdartemu.so"
    if not place.is_file():
        why = "$DART_HAL_EMULATOR names" if named else "the emulator bridge is not built: there is"
        raise EmulatorMissing(f"{why} {place}, which is no file" if named else f"{why} no {place}",
                              remedy=REMEDY)
    return place


def load() -> c.CDLL:
    """Load the bridge once and return it. Raises EmulatorMissing with the loader's message."""
    return _load(str(find_library()))


@cache
def _load(path: str) -> c.CDLL:
    try:
        library = c.CDLL(path)
    except OSError as error:
        raise EmulatorMissing(f"the emulator bridge does not load: {error}",
                              likely="libsimavr is not installed", remedy=REMEDY) from error
    try:
        for name, (result, *arguments) in _SIGNATURES.items():
            function = getattr(library, name)
            function.restype = result
            function.argtypes = arguments
        abi = library.emu_abi()
    except AttributeError as error:
        raise EmulatorMissing(f"{path} is no bridge of this version: {error}",
                              remedy=REMEDY) from error
    if abi != ABI:
        raise EmulatorMissing(f"{path} was built from another version", found=f"ABI {abi}",
                              expected=f"ABI {ABI}", remedy=REMEDY)
    return library
