"""A short run of the fuzzers in firmware/test; `make fuzz` runs them by the ten million.

The negative controls are firmwares with one error each: the harness whose law
it breaks must find it from the same seeds.
"""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest
from firmware_rig import FIRMWARE

from dart_hal.wire import codec

RUNS = 2000
CLANG = shutil.which("clang++") or shutil.which("clang++-14")

with_clang = pytest.mark.skipif(
    CLANG is None, reason="clang is not installed: make fuzz brings it")


def fuzz_of(firmware: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location("fuzz", firmware / "test/fuzz.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["fuzz"] = module
    spec.loader.exec_module(module)
    return module


def build(firmware: Path, *names: str) -> None:
    made = subprocess.run(["make", "-s", "-C", str(firmware), f"FUZZ_CXX={CLANG}",
                           *(f"build/fuzz/{name}" for name in names)],
                          capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stdout + made.stderr


def test_the_seeds_name_commands_as_the_firmware_numbers_them() -> None:
    fuzz = fuzz_of(FIRMWARE)
    assert tuple(m.name for m in codec.DOWN) == fuzz.COMMANDS
    assert all(fuzz.seeds(name) for name in fuzz.LONGEST)


@with_clang
@pytest.mark.slow
def test_nothing_is_found_in_a_few_thousand_inputs() -> None:
    fuzz = fuzz_of(FIRMWARE)
    build(FIRMWARE, *fuzz.LONGEST)
    for name in fuzz.LONGEST:
        result = fuzz.run(name, RUNS)
        assert result.finding is None, result.said[-3000:]
        assert result.runs >= RUNS


@with_clang
@pytest.mark.long
@pytest.mark.parametrize(("name", "file", "old", "new"), [
    ("decoder", "core/frame.cpp", "if (size_ == kMaxRx) {", "if (size_ == kMaxRx + 1) {"),
    ("decoder", "core/frame.cpp", "bool const broken = left_ != 0;", "bool const broken = false;"),
    ("params", "core/params.cpp", "value >= spec.low && value <= spec.high",
     "value >= spec.low"),
    ("params", "core/slots.cpp", "current_ ^= 1;", ""),
    ("commands", "core/supervisor.cpp", "return arm && right_token ? kArm", "return arm ? kArm"),
    ("commands", "core/supervisor.cpp", "kLongEnough = ticks_of_ms(500)",
     "kLongEnough = ticks_of_ms(400)"),
], ids=["overflow", "short block", "range", "one slot", "token", "400 ms"])
def test_each_broken_law_is_detected(tmp_path: Path, name: str, file: str, old: str,
                                   new: str) -> None:
    shutil.copytree(FIRMWARE, tmp_path / "firmware",
                    ignore=shutil.ignore_patterns("build", "emulator", "prebuilt"))
    vectors = tmp_path / "tests/wire"
    vectors.mkdir(parents=True)
    shutil.copy(FIRMWARE.parent / "tests/wire/vectors.json", vectors)
    sources = [p for p in (tmp_path / "firmware/src").rglob("*")
               if p.is_file() and old in p.read_text(encoding="utf-8")]
    assert len(sources) == 1, f"{file} no longer has {old!r} once"
    sources[0].write_text(sources[0].read_text(encoding="utf-8").replace(old, new),
                          encoding="utf-8")
    build(tmp_path / "firmware", name)
    fuzz = fuzz_of(tmp_path / "firmware")
    assert fuzz.run(name, 200_000).finding is not None
