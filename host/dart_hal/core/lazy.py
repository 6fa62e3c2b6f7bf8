"""Load the public names of a package on first use.

The stub of the package, ``__init__.pyi``, has a line ``from MODULE import NAME as NAME`` for each.
Type checkers read the same file.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any


def read_public_names(package: str, init_file: str) -> tuple[
        Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package for the names of its stub.

    init_file: the ``__file__`` of the package.
    """
    stub = Path(init_file).with_name("__init__.pyi").read_text(encoding="utf-8")
    imports = [line.split() for line in stub.splitlines() if line.startswith("from ")]
    module_of = {name: module for _, module, _, name, *_ in imports}

    def load(name: str) -> Any:
        """Import a public name."""
        if name not in module_of:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        # The list of names also imports a name that is a module.
        return getattr(__import__(module_of[name], fromlist=[name]), name)

    def list_names() -> list[str]:
        """Return the public names, for completion."""
        return sorted(names)

    names = list(module_of)
    return load, list_names, names
