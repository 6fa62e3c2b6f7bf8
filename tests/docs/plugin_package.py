"""A package of a page's code blocks, as pip would install it, on ``sys.path``."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import handbook

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


def files_of_page(page: Path, heading: str = "") -> dict[str, str]:
    """Read the files that a page shows, by name; ``heading``: of that section alone."""
    text = page.read_text(encoding="utf-8")
    if heading:
        _, found, below = text.partition(f"\n## {heading}\n")
        assert found, f"{page.name} has no section {heading!r}"
        text = below.partition("\n## ")[0]
    return {block.file: block.text for block in handbook.blocks(text) if block.file}


def install(folder: Path, files: Mapping[str, str]) -> None:
    """Write the files and the metadata that their ``pyproject.toml`` describes."""
    project = tomllib.loads(files["pyproject.toml"])["project"]
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    metadata = folder / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n",
        encoding="utf-8")
    lines = []
    for group, entries in project.get("entry-points", {}).items():
        lines += [f"[{group}]", *(f"{name} = {value}" for name, value in entries.items()), ""]
    (metadata / "entry_points.txt").write_text("\n".join(lines), encoding="utf-8")


@contextmanager
def on_path(folder: Path) -> Iterator[None]:
    """Import from a folder, and forget afterwards what was imported from it."""
    sys.path.insert(0, str(folder))
    importlib.invalidate_caches()
    try:
        yield
    finally:
        sys.path.remove(str(folder))
        importlib.invalidate_caches()
        for name, module in list(sys.modules.items()):
            if str(getattr(module, "__file__", None) or "").startswith(str(folder)):
                del sys.modules[name]
