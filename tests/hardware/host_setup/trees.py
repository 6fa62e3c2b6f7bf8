"""Trees of /proc, /sys, /etc and /dev of the computers of a car, planted below a folder."""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).parent / "computers"
TREE_NAMES = sorted(path.stem for path in FOLDER.glob("*.tree"))


def plant(name: str, root: Path) -> Path:
    """Make the files and links of one computer below ``root``."""
    for line in (FOLDER / f"{name}.tree").read_text(encoding="utf-8").splitlines():
        if not line or line.startswith("#"):
            continue
        path, kind, value = line.partition(" -> " if " -> " in line else " =")
        target = root / path
        target.parent.mkdir(parents=True, exist_ok=True)
        if "->" in kind:
            target.symlink_to(value)
        else:
            text = value.removeprefix(" ").replace("|", "\n")
            target.write_text(text + ("\0" if path.endswith("model") else "\n"), encoding="utf-8")
    return root
