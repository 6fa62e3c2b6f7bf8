"""Firmware without one of its safety layers: built once from changed sources."""

from __future__ import annotations

import hashlib
import shutil
import subprocess
import tempfile
from pathlib import Path

FIRMWARE_FOLDER = Path(__file__).resolve().parents[3] / "firmware"

Change = tuple[str, str, str]
"""File below firmware/, the text there, the text that replaces it."""


def image(name: str, changes: tuple[Change, ...]) -> Path:
    """The ELF with these changes; AssertionError when the source no longer reads so."""
    sources = hashlib.sha256(repr(changes).encode())
    for path in sorted((FIRMWARE_FOLDER / "src").rglob("*.[ch]*")):
        sources.update(path.read_bytes())
    made = Path(tempfile.gettempdir()) / f"dart-fault-table-{os_user()}"
    elf = made / f"{name}-{sources.hexdigest()[:16]}.elf"
    if not elf.is_file():
        _build(elf, changes)
    return elf


def os_user() -> str:
    """Two users of one machine must not share a folder."""
    return hashlib.sha256(str(Path.home()).encode()).hexdigest()[:8]


def _build(elf: Path, changes: tuple[Change, ...]) -> None:
    elf.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "firmware"
        shutil.copytree(FIRMWARE_FOLDER, copy, ignore=shutil.ignore_patterns("build", "emulator"))
        for file, old, new in changes:
            path = copy / file
            text = path.read_text()
            assert old in text, f"{file} no longer has {old!r}"
            path.write_text(text.replace(old, new))
        done = subprocess.run(["make", "-s", "-C", str(copy), "hex"], capture_output=True,
                              text=True, check=False)
        assert done.returncode == 0, done.stderr
        part = elf.with_suffix(".part")
        shutil.copy(copy / "build" / "dart_nano.elf", part)
        part.replace(elf)
