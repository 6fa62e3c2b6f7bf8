"""Budgets of the firmware, and what the image must not contain."""

from __future__ import annotations

import hashlib
import importlib.util
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest
from firmware_rig import FIRMWARE, Rig

Make = Callable[..., Rig]
VECTOR = re.compile(r"^[0-9a-f]+ <(__vector_\d+)>:$")
DIVISION = re.compile(r"<__(u?div|u?mod|u?divmod|[a-z]*sf[23]?|fix|float|mulsi|addsf|mulsf)\w*>")


def budgets_module() -> ModuleType:
    spec = importlib.util.spec_from_file_location("budgets", FIRMWARE / "test/budgets.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    import sys
    sys.modules["budgets"] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.emulator
def test_every_budget_holds(nano: Make, elf: Path, test_elf: Path) -> None:
    budgets, isr = budgets_module().measure(elf, test_elf)
    assert len(budgets) == 9
    assert not [str(b) for b in budgets if b.over]
    assert all(b.value > 0 for b in budgets)
    assert all(0 < cycles <= 200 for cycles in isr.values()), isr


def test_a_budget_can_fail() -> None:
    budget = budgets_module().Budget
    assert budget("x", 11, 10, "B").over
    assert budget("x", 9, 10, "B", floor=True).over
    assert not budget("x", 10, 10, "B").over
    assert not budget("x", 10, 10, "B", floor=True).over


def interrupt_code(listing: str) -> dict[str, str]:
    code: dict[str, list[str]] = {}
    current = None
    for line in listing.splitlines():
        if line.endswith(">:"):
            found = VECTOR.match(line)
            current = found.group(1) if found else None
        elif current:
            code.setdefault(current, []).append(line)
    return {name: "\n".join(lines) for name, lines in code.items()}


def test_no_interrupt_divides_or_calls(elf: Path) -> None:
    listing = subprocess.run(["avr-objdump", "-d", str(elf)], capture_output=True, text=True,
                             check=True).stdout
    code = interrupt_code(listing)
    assert len(code) >= 9
    for name, body in code.items():
        assert not DIVISION.search(body), name
        calls = set(re.findall(r"\br?call\b.*<(\w+)", body))
        if name != "__vector_6":  # the watchdog's ends in the handler that never returns
            assert not {c for c in calls if "div" in c or "sf" in c}, (name, calls)


def test_the_scan_finds_a_division() -> None:
    body = "\t.text\n00000010 <__vector_1>:\n  10:\tcall\t0x20\t; 0x20 <__udivmodhi4>\n"
    assert DIVISION.search(interrupt_code(body)["__vector_1"])


def test_no_float_anywhere(elf: Path) -> None:
    names = subprocess.run(["avr-nm", str(elf)], capture_output=True, text=True,
                           check=True).stdout
    assert not re.search(r"__(add|sub|mul|div)sf3|__fixsf|__floatsi", names)
    assert not re.search(r" (malloc|_ZN14HardwareSerial\w*|twi_\w+|_ZN7TwoWire\w*)$", names, re.M)


def test_the_prebuilt_hex_is_a_fresh_build(elf: Path) -> None:
    fresh = (FIRMWARE / "build/dart_nano.hex").read_bytes()
    prebuilt = (FIRMWARE / "prebuilt/dart_nano.hex").read_bytes()
    assert hashlib.sha256(prebuilt).hexdigest() == hashlib.sha256(fresh).hexdigest(), \
        "make -C firmware prebuilt"


def test_the_checksum_of_the_prebuilt_hex() -> None:
    line = (FIRMWARE / "prebuilt/dart_nano.hex.sha256").read_text().split()
    assert line[1] == "dart_nano.hex"
    assert line[0] == hashlib.sha256((FIRMWARE / "prebuilt/dart_nano.hex").read_bytes()).hexdigest()


@pytest.mark.long
def test_a_build_elsewhere_gives_the_same_bytes(elf: Path, tmp_path: Path) -> None:
    copy = tmp_path / "other/place"
    shutil.copytree(FIRMWARE, copy, ignore=shutil.ignore_patterns("build", "emulator"))
    subprocess.run(["make", "-s", "-C", str(copy), "hex"], check=True, capture_output=True)
    assert (copy / "build/dart_nano.hex").read_bytes() == \
        (FIRMWARE / "build/dart_nano.hex").read_bytes()


def test_core_knows_no_board() -> None:
    for path in (FIRMWARE / "src/core").glob("*.[hc]*"):
        for include in re.findall(r'#include [<"](.+)[>"]', path.read_text()):
            assert include in {"stdint.h", "stddef.h", "string.h"} or "/" not in include, \
                f"{path.name} includes {include}"
            assert not include.startswith(("avr", "Arduino"))


def test_lines_of_80_columns_and_files_of_400_lines() -> None:
    for path in [*(FIRMWARE / "src").rglob("*.cpp"), *(FIRMWARE / "src").rglob("*.h")]:
        lines = path.read_text().splitlines()
        assert path.name == "messages.h" or len(lines) <= 400, path.name
        assert not [n for n, line in enumerate(lines, 1) if len(line) > 80], path.name
