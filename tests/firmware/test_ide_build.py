"""The sketch compiled and linked by the recipes of the Arduino IDE and by PlatformIO's flags.

The recipes are read from platform.txt and boards.txt of Debian's arduino-core-avr, as the IDE
reads them. The compiler is Debian's avr-gcc 5.4; the IDE brings a newer one (7.3), so what
holds here is the language level, the recipes and the layout of the sketch, not the IDE's bytes.
PlatformIO's flags are those of its Arduino builder for AVR; its download has not been run.
"""

from __future__ import annotations

import configparser
import re
import shlex
import shutil
import subprocess
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import pytest
from firmware_rig import FIRMWARE, Rig, missing

ARDUINO = Path("/usr/share/arduino/hardware/arduino/avr")
FLASH = 28_672
RAM = 1152
"""Bytes: two pages below the 30 720 B that the bootloader leaves; RAM as in the budgets."""
NEEDS_DECIMAL_DIG = "-DDECIMAL_DIG=__DECIMAL_DIG__"
"""Debian's core does not compile with Debian's own compiler without it (WString.cpp). Given to
the core's files only, never to ours."""
RELAXED = "constexpr int sum(int n) { int s = 0; for (int i = 0; i < n; ++i) s += i; return s; }"


@dataclass(frozen=True)
class Builder:
    """Compile, archive and link commands of one tool, as lists of words."""

    compile: Callable[[Path, Path, str], list[str]]
    archive: Callable[[Path, Path], list[str]]
    link: Callable[[Path, list[Path], Path], list[str]]


def properties(*files: Path) -> dict[str, str]:
    lines = [line for file in files for line in file.read_text().splitlines()]
    return dict(line.split("=", 1) for line in lines if "=" in line and line[0] != "#")


def expand(pattern: str, values: dict[str, str]) -> list[str]:
    """The words of a recipe; an unknown name is left empty, as the IDE does."""
    while found := re.search(r"\{([\w.]+)\}", pattern):
        pattern = pattern.replace(found[0], values.get(found[1], ""))
    return shlex.split(pattern)


def arduino_ide(board: str = "nano", cpu: str = "atmega328") -> Builder:
    if not (ARDUINO / "platform.txt").exists() or shutil.which("avr-g++") is None:
        missing("IDE build: arduino-core-avr and gcc-avr not installed")
    p = properties(ARDUINO / "platform.txt", ARDUINO / "boards.txt")
    for prefix in (f"{board}.", f"{board}.menu.cpu.{cpu}."):
        p |= {k.removeprefix(prefix): v for k, v in p.items() if k.startswith(prefix)}
    core = ARDUINO / "cores" / p["build.core"]
    variant = ARDUINO / "variants" / p["build.variant"]
    p |= {"build.arch": "AVR", "runtime.ide.version": "10819", "archive_file": "core.a",
          "build.project_name": "firmware.ino", "includes": f"-I{core} -I{variant}",
          "compiler.warning_flags": p["compiler.warning_flags.all"]}

    def compile_(source: Path, out: Path, extra: str) -> list[str]:
        kind = {".c": "c", ".S": "S", ".cpp": "cpp"}[source.suffix]
        return expand(p[f"recipe.{kind}.o.pattern"], p | {
            "source_file": str(source), "object_file": str(out), "compiler.cpp.extra_flags": extra})

    def archive(out: Path, member: Path) -> list[str]:
        return expand(p["recipe.ar.pattern"],
                      p | {"archive_file_path": str(out), "object_file": str(member)})

    def link(where: Path, objects: list[Path], core: Path) -> list[str]:
        return expand(p["recipe.c.combine.pattern"], p | {
            "build.path": str(core.parent), "object_files": shlex.join(map(str, objects))})

    return Builder(compile_, archive, link)


def platformio() -> Builder:
    ini = configparser.ConfigParser()
    ini.read(FIRMWARE / "platformio.ini")
    assert "build_unflags" not in ini["env"]
    both = ("-Os -Wall -ffunction-sections -fdata-sections -flto -mmcu=atmega328p "
            "-DF_CPU=16000000L -DARDUINO=10808 -DARDUINO_ARCH_AVR -DARDUINO_AVR_NANO "
            f"-DPLATFORMIO=60118 -I{ARDUINO}/cores/arduino "
            f"-I{ARDUINO}/variants/eightanaloginputs {ini['env']['build_flags']}").split()
    only = {".cpp": ["-fno-exceptions", "-fno-threadsafe-statics", "-fpermissive", "-std=gnu++11"],
            ".c": ["-std=gnu11", "-fno-fat-lto-objects"], ".S": ["-x", "assembler-with-cpp"]}
    return Builder(
        lambda source, out, extra: ["avr-g++" if source.suffix == ".cpp" else "avr-gcc", *both,
                                    *only[source.suffix], *extra.split(),
                                    "-c", str(source), "-o", str(out)],
        lambda out, member: ["avr-gcc-ar", "rcs", str(out), str(member)],
        lambda where, objects, core: [
            "avr-gcc", "-o", str(where), "-Os", "-mmcu=atmega328p", "-Wl,--gc-sections", "-flto",
            "-fuse-linker-plugin", *map(str, objects), "-Wl,--start-group", str(core), "-lm",
            "-Wl,--end-group"])


def call(command: list[str]) -> str:
    """Output of the compiler; AssertionError with it when it fails."""
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    return result.stderr


def compile_all(tool: Builder, sources: Iterable[Path], where: Path, extra: str = "",
                ) -> tuple[list[Path], str]:
    """Objects, and the warnings."""
    where.mkdir(parents=True)
    pairs = [(source, where / f"{i}.{source.name}.o") for i, source in enumerate(sources)]
    with ThreadPoolExecutor(2) as pool:
        output = list(pool.map(lambda pair: call(tool.compile(*pair, extra)), pairs))
    return [out for _, out in pairs], "".join(output)


def sketch(where: Path) -> list[Path]:
    """What the IDE compiles: the .ino behind an include of Arduino.h, and src/ below it."""
    ino = FIRMWARE / "firmware.ino"
    assert ino.stem == FIRMWARE.name, "the IDE requires the sketch to be named like its directory"
    cpp = where / "firmware.ino.cpp"
    cpp.write_text(f'#include <Arduino.h>\n#line 1 "{ino}"\n{ino.read_text()}')
    return [cpp, *sorted((FIRMWARE / "src").rglob("*.cpp"))]


def build(tool: Builder, where: Path) -> Path:
    objects, output = compile_all(tool, sketch(where), where / "sketch")
    assert "warning" not in output, output
    core = sorted(f for f in (ARDUINO / "cores/arduino").iterdir()
                  if f.suffix in {".c", ".cpp", ".S"})
    members, _ = compile_all(tool, core, where / "core", f"-w {NEEDS_DECIMAL_DIG}")
    archive = where / "core.a"
    for member in members:
        call(tool.archive(archive, member))
    elf = where / "firmware.ino.elf"
    call(tool.link(elf, objects, archive))
    return elf


def memory(elf: Path) -> tuple[int, int]:
    """Bytes of flash and RAM as the IDE counts them, by the expressions of platform.txt."""
    p = properties(ARDUINO / "platform.txt")
    listing = subprocess.run(["avr-size", "-A", str(elf)], capture_output=True, text=True,
                             check=True).stdout
    def total(name: str) -> int:
        return sum(int(m[1]) for m in re.finditer(p[name], listing, re.M))
    return total("recipe.size.regex"), total("recipe.size.regex.data")


@pytest.mark.parametrize("tool", [arduino_ide, platformio])
@pytest.mark.slow
def test_it_builds_fits_and_runs(tool: Callable[[], Builder], nano: Callable[..., Rig],
                                 tmp_path: Path) -> None:
    elf = build(tool(), tmp_path)
    flash, ram = memory(elf)
    assert 10_000 < flash <= FLASH
    assert ram <= RAM
    rig = nano(elf)
    rig.run(0.5)
    assert len(rig.states()) > 45
    assert rig.hello()["git"] == 0  # only the Makefile knows the sources' hash
    assert rig.hello()["build"] == 1


def test_the_recipes_refuse_newer_cpp(tmp_path: Path) -> None:
    """The control: relaxed constexpr, which gnu++11 does not have."""
    source = tmp_path / "relaxed.cpp"
    source.write_text(f"{RELAXED}\nstatic_assert(sum(3) == 3, \"\");\n")
    with pytest.raises(AssertionError, match="constexpr"):
        call(arduino_ide().compile(source, tmp_path / "relaxed.o", ""))


def test_nothing_is_to_be_copied_into_the_ide() -> None:
    assert not list(FIRMWARE.glob("platform*.txt"))
