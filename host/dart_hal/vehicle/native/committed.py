"""The kernels of the shipped parameter sets, as text; `make native` writes and compiles it."""

from __future__ import annotations

import sys
from dataclasses import replace

from dart_hal.vehicle.native.build import COMMITTED, CannotCompile, build_committed
from dart_hal.vehicle.native.emit import body, source
from dart_hal.vehicle.native.model import form_of, trace
from dart_hal.vehicle.sets import PAPER, UPSTREAM_2024

# Built with the package; every other form is compiled on its first use.
KINDS = ("car", "motion")
FORMS = (PAPER, UPSTREAM_2024, replace(PAPER, kind="kinematic"))


def text() -> str:
    """What ``kernel.c`` must hold."""
    return source(body(trace(form_of(p), kind)) for p in FORMS for kind in KINDS)


def write() -> bool:
    """Bring ``kernel.c`` up to date; whether it had to be changed."""
    new = text()
    if COMMITTED.is_file() and COMMITTED.read_text(encoding="utf-8") == new:
        return False
    COMMITTED.write_text(new, encoding="utf-8")
    return True


if __name__ == "__main__":
    write()
    try:
        build_committed()
    except CannotCompile as why:
        sys.exit(f"kernel.c is written but not compiled: {why}")
