"""Diagrams of the harness: SVG beside the sources, wire tables in the build guide.

    python hardware/wiring/build.py            write them
    python hardware/wiring/build.py --check    exit 1 if a committed file is not up to date
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

from drawing import diagram
from harness import DIAGRAMS, HERE, WiringError, chains, load, table
from pinout import PINOUTS

GUIDE = HERE.parents[1] / "docs" / "build_guide" / "06_wiring.md"
BLOCK = "<!-- wires: {} -->\n{}\n<!-- end of wires -->"


def drawn(folder: Path = HERE) -> dict[str, str]:
    """File name -> SVG of every diagram and pin-out. Raises WiringError."""
    found = {}
    for name in DIAGRAMS:
        data, cables = load(name, folder), chains(name, folder)
        found[f"{name}.svg"] = diagram(data, cables)
        for step, shown in data["metadata"].get("steps", {}).items():
            found[f"{name}_{step}.svg"] = diagram(data, [c for c in cables if c[1] in shown])
    return found | {f"{n}.svg": make(folder) for n, make in PINOUTS.items()}


def with_tables(text: str) -> str:
    """The guide page with each block between its marks replaced by the current wires."""
    return re.sub(r"<!-- wires: (\w+) -->\n.*?\n<!-- end of wires -->",
                  lambda m: BLOCK.format(m[1], table(m[1])), text, flags=re.DOTALL)


def stale(folder: Path = HERE) -> list[str]:
    """Names of committed files in `folder` that are not what its sources draw; of the guide."""
    old = [name for name, svg in drawn(folder).items()
           if not (folder / name).is_file() or (folder / name).read_text(encoding="utf-8") != svg]
    text = GUIDE.read_text(encoding="utf-8")
    return old + ([GUIDE.name] if with_tables(text) != text else [])


def main() -> int:
    """Write or compare."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--check", action="store_true", help="write nothing; 1 on a difference")
    try:
        if parser.parse_args().check:
            for name in (old := stale()):
                sys.stderr.write(f"{name} is older than its source: hardware/wiring/build.py\n")
            return 1 if old else 0
        for name, svg in drawn().items():
            (HERE / name).write_text(svg, encoding="utf-8")
        if GUIDE.is_file():
            GUIDE.write_text(with_tables(GUIDE.read_text(encoding="utf-8")), encoding="utf-8")
    except WiringError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
