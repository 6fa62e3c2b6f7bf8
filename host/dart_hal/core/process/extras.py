"""Optional packages: the command that installs them for the interpreter that runs this."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import sys
from importlib.util import find_spec
from pathlib import Path

from dart_hal.core.errors import UsageError

DISTRIBUTION = "dart-hal"
# Packages by the name under which they are imported, where the two differ.
PACKAGES = {"PIL": "pillow", "cv2": "opencv-python-headless", "serial": "pyserial",
            "yaml": "pyyaml", "zenoh": "eclipse-zenoh"}


def install_command(*names: str) -> str:
    """Return the shell command that installs the packages of extras, or packages by import name.

    It names the packages themselves, because this package is on no index, and this interpreter,
    because the first ``pip`` on the path may be that of another Python. Environments without
    pip, as ``uv venv`` makes them, are served by uv. Example::

        install_command("plot")  # ".venv/bin/python -m pip install 'matplotlib>=3.7'"
    """
    packages = [package for name in names for package in packages_of(name)]
    if find_spec("pip") is None:
        uv = shutil.which("uv") or installed_uv()
        if uv:
            return shlex.join([uv, "pip", "install", "--python", sys.executable, *packages])
    return shlex.join([sys.executable, "-m", "pip", "install", *packages])


def missing_module_error(name: str, what: str) -> UsageError:
    """Return the error of ``what``, which needs a Python module that cannot be imported.

    A module of Python itself, such as termios, belongs to the system and cannot be installed.
    """
    if name in sys.stdlib_module_names:
        return UsageError(f"{what} needs Python's module {name}, which this system lacks",
                          found=sys.platform, expected="Linux or macOS",
                          remedy="on Windows run it in WSL; sim:// works here")
    return UsageError(f"{what} needs the Python package {name}",
                      found=f"{name} is not installed for {sys.executable}",
                      remedy=install_command(name))


def packages_of(name: str) -> list[str]:
    """Return the requirements of an extra, or the requirement that provides an import name."""
    from importlib.metadata import PackageNotFoundError, requires

    try:
        lines = requires(DISTRIBUTION) or []
    except PackageNotFoundError:
        lines = []
    # A line of the metadata: "matplotlib>=3.7; extra == 'plot'".
    parts = [line.replace('"', "'").partition(";")[::2] for line in lines]
    extra = [package.strip() for package, marker in parts
             if marker.replace(" ", "").endswith(f"extra=='{name}'")]
    package = PACKAGES.get(name, name)
    required = [text.strip() for text, _ in parts
                if re.match(rf"{re.escape(package)}\b(?![-_.])", text, re.IGNORECASE)]
    return extra or required[:1] or [package]


def installed_uv() -> str | None:
    """Return the uv that host/setup brought for the user, if it did."""
    base = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    uv = Path(base) / "dart-hal" / "bin" / "uv"
    return str(uv) if os.access(uv, os.X_OK) else None
