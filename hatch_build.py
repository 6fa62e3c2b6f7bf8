"""Compiles the vehicle kernels while the package is built, and writes its page for an index.

A plain build compiles them for this processor, if there is a C compiler. Without one, or when it
fails, the package is built all the same: the first use tries again, and numpy computes what is not
compiled. ``DART_HAL_WHEEL`` selects a wheel to publish:

``any``       no library in it, for every system (py3-none-any)
``portable``  libraries for every processor of this platform; auditwheel gives it a manylinux tag

``DART_HAL_HOME`` is the address under which the files of this project are public. Relative links of
README.md are written with it; without it they become text, because they lead nowhere on an index.
"""

from __future__ import annotations

import importlib.util
import os
import re
import sys
import sysconfig
from pathlib import Path
from types import ModuleType
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface

NATIVE = Path("host", "dart_hal", "vehicle", "native")
# [text](target) and ![text](target) whose target is no address and no heading of the page.
RELATIVE_LINK = re.compile(r"(!?)\[([^\[\]]*)\]\((?![a-z]+:|#)([^()\s]+)\)")


class KernelHook(BuildHookInterface):
    """Runs for wheels, editable ones too; a source archive holds no library."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        kind = os.environ.get("DART_HAL_WHEEL", "")
        if self.target_name != "wheel" or kind == "any":
            return
        build = _module(Path(self.root) / NATIVE / "build.py")
        try:
            libraries = build.build_committed(portable=kind == "portable")
        except (build.CannotCompile, OSError) as why:
            self.app.display_warning(f"vehicle kernels not compiled, numpy takes over: {why}")
            return
        self.app.display_info(f"{len(libraries)} libraries of vehicle kernels compiled")
        if version != "editable":
            build_data["artifacts"] += [str(NATIVE / "_built" / path.name) for path in libraries]
            build_data["pure_python"] = False
            platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
            build_data["tag"] = f"py3-none-{platform}"


class PageHook(MetadataHookInterface):
    """Writes the readme and the addresses of the project."""

    def update(self, metadata: dict[str, Any]) -> None:
        home = os.environ.get("DART_HAL_HOME", "").rstrip("/")
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        metadata["readme"] = {"content-type": "text/markdown", "text": rewrite_links(text, home)}
        metadata["urls"] = {name: f"{home}/{path}".rstrip("/") for name, path in (
            ("Homepage", ""), ("Documentation", "docs/index.md"), ("Changelog", "CHANGELOG.md"),
            ("Security", "SECURITY.md"))} if home else {}


def rewrite_links(text: str, home: str) -> str:
    """Return Markdown whose relative links begin with ``home``; "" leaves their text alone."""
    def rewrite(link: re.Match[str]) -> str:
        mark, words, path = link.groups()
        return f"{mark}[{words}]({home}/{path})" if home else words

    before = None
    while before != text:  # a picture may be the text of a link
        before = text
        text = RELATIVE_LINK.sub(rewrite, text)
    return text


def _module(path: Path) -> ModuleType:
    """build.py by itself: the package cannot be imported before it is installed."""
    spec = importlib.util.spec_from_file_location("dart_hal_native_build", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module
