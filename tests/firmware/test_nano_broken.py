"""Negative controls: a firmware broken on purpose must fail what the real one passes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from firmware_rig import Rig, build_patched, eeprom_image

pytestmark = [pytest.mark.emulator, pytest.mark.long]
Make = Callable[..., Rig]

DEAF_LOOP = ("src/core/supervisor.cpp",
             "{Safety::kLive, Safety::kTripped, kStop | kLost, 0}",
             "{Safety::kLive, Safety::kTripped, kStop, 0}")
DEAF_INTERRUPT = ("src/board/outputs.cpp", "    outputs_cut();\n", "")
NO_WATCHDOG = (("src/main.cpp",
                "  board::watchdog_start(settings.safety_out != 0, settings.wdt_reset);\n", ""),
               ("src/board/boot.cpp", "    WDTCSR |= _BV(WDIE);\n", ""))


def cut_after(rig: Rig, hang: bool = False) -> float | None:
    """Seconds from the last beat (or the hang) to D6 low; None = it stays high."""
    rig.run(0.5)
    rig.beat(0.6, 0)
    rig.beat(0.1, 1)
    assert rig.nano.pins()["D6"] == 1
    rig.nano.pin_log()
    begin = rig.now
    if hang:
        rig.nano.hang()
        for _ in range(25):
            rig.send("HEARTBEAT", arm_token=rig.hello()["boot_nonce"], mode=1)
            rig.run(0.02)
    else:
        rig.run(0.5)
    lows = [e.t for e in rig.nano.pin_log() if e.pin == "D6" and e.level == 0]
    return lows[0] - begin if lows else None


def test_the_interrupt_alone_cuts(nano: Make, elf: Path, tmp_path: Path) -> None:
    rig = nano(build_patched(tmp_path, DEAF_LOOP), eeprom=eeprom_image(safety_out=1))
    after = cut_after(rig)
    assert after is not None
    assert after <= 0.12


def test_the_loop_alone_cuts(nano: Make, elf: Path, tmp_path: Path) -> None:
    rig = nano(build_patched(tmp_path, DEAF_INTERRUPT), eeprom=eeprom_image(safety_out=1))
    after = cut_after(rig)
    assert after is not None
    assert after <= 0.12


def test_without_both_nothing_cuts(nano: Make, elf: Path, tmp_path: Path) -> None:
    rig = nano(build_patched(tmp_path, DEAF_LOOP, DEAF_INTERRUPT),
               eeprom=eeprom_image(safety_out=1))
    assert cut_after(rig) is None


def test_a_hang_without_watchdog_waits_for_the_beat_counter(nano: Make, elf: Path,
                                                            tmp_path: Path) -> None:
    whole = nano(eeprom=eeprom_image(safety_out=1))
    lame = nano(build_patched(tmp_path, *NO_WATCHDOG), eeprom=eeprom_image(safety_out=1))
    with_watchdog = cut_after(whole, hang=True)
    without = cut_after(lame, hang=True)
    assert with_watchdog is not None
    assert without is not None
    assert with_watchdog <= 0.08 < without <= 0.13
