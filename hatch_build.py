"""Compiles the vehicle kernels while the package is built, if there is a C compiler.

Without one, or when it fails, the package is built all the same: the first use
tries again, and numpy computes what nobody compiled. The libraries are for the
processor they were built on, so a wheel that holds them says which platform it
is for (any Python 3 of it), and on another processor of that platform they are not found.
"""

from __future__ import annotations

import importlib.util
import sys
import sysconfig
from pathlib import Path
from types import ModuleType
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

NATIVE = Path("host", "dart_hal", "vehicle", "native")


class KernelHook(BuildHookInterface):
    """Runs for wheels, editable ones too; a source archive holds no library."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        if self.target_name != "wheel":
            return
        build = _module(Path(self.root) / NATIVE / "build.py")
        try:
            libraries = build.build_committed()
        except (build.CannotCompile, OSError) as why:
            self.app.display_warning(f"vehicle kernels not compiled, numpy takes over: {why}")
            return
        self.app.display_info(f"{len(libraries)} libraries of vehicle kernels compiled")
        if version != "editable":
            build_data["artifacts"] += [str(NATIVE / "_built" / "*.so")]
            build_data["pure_python"] = False
            platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
            build_data["tag"] = f"py3-none-{platform}"


def _module(path: Path) -> ModuleType:
    """build.py by itself: the package cannot be imported before it is installed."""
    spec = importlib.util.spec_from_file_location("dart_hal_native_build", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module
