"""Diagrams of the harness: SVG beside the sources, tables in build guide and hardware page.

    python hardware/wiring/build.py            write them
    python hardware/wiring/build.py --check    exit 1 if a committed file is not up to date

A harness that fails the electrical check is not drawn: its faults are named, nothing is written.
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

from circuit import devices, part_table, pin_table, said
from drawing import diagram
from electrical import check
from harness import DIAGRAMS, HERE, WiringError, chains, load, table
from net_table import net_table
from overview import drawing as overview
from pcb import files as printed
from pcb import picture as pcb_picture
from perfboard import drawing as board
from pinout import PINOUTS
from plan import drawing as routed
from power_tree import drawing as power_tree
from routing import SHOWN as ROUTED
from schematic import drawing as schematic

GUIDE = HERE.parents[1] / "docs" / "build_guide" / "06_wiring.md"
REFERENCE = HERE.parent / "README.md"
TABLES = {"wires": table, "board": part_table, "pins": pin_table, "nets": net_table}
"""Word of a mark -> what stands between it and its end: `<!-- pins: MUX -->`."""
BLOCK = "<!-- {} -->\n{}\n<!-- end of {} -->"


def drawn(folder: Path = HERE) -> dict[str, str]:
    """File name -> SVG of every diagram and pin-out. Raises WiringError."""
    found = {}
    beside = {device: said(device, folder) for device in devices(folder)}
    for name in DIAGRAMS:
        data, cables = load(name, folder), chains(name, folder)
        found[f"{name}.svg"] = diagram(data, cables, beside)
        for step, shown in data["metadata"].get("steps", {}).items():
            found[f"{name}_{step}.svg"] = diagram(data, [c for c in cables if c[1] in shown],
                                                beside)
    found |= {f"pcb/{name}": text for name, text in printed(folder).items()}
    found |= {f"routing_{name}.svg": routed(name, folder) for name in ROUTED}
    found |= {"mux_pcb.svg": pcb_picture(folder), "mux_board.svg": board(folder),
              "mux_schematic.svg": schematic(folder), "power_tree.svg": power_tree(folder),
              "harness.svg": overview(folder)}
    return found | {f"{n}.svg": make(folder) for n, make in PINOUTS.items()}


def with_tables(text: str) -> str:
    """A page with each block between its marks replaced by the current table.

    Raises WiringError for a block without an end.
    """
    unended = r"<!-- (wires|board|pins|nets): (\w+) -->\n(?!(?:\|.*\n)*<!-- end of \1)"
    for kind, name in re.findall(unended, text):
        raise WiringError(f"<!-- {kind}: {name} --> has no <!-- end of {kind} --> below its table")
    return re.sub(r"<!-- ((wires|board|pins|nets): (\w+)) -->\n.*?<!-- end of \2 -->",
                  lambda m: BLOCK.format(m[1], TABLES[m[2]](m[3]), m[2]), text, flags=re.DOTALL)


def stale(folder: Path = HERE) -> list[str]:
    """Names of committed files in `folder` that are not what its sources draw; of the pages."""
    old = [name for name, svg in drawn(folder).items()
           if not (folder / name).is_file() or (folder / name).read_text(encoding="utf-8") != svg]
    return old + [p.name for p in (GUIDE, REFERENCE)
                  if with_tables(text := p.read_text(encoding="utf-8")) != text]


def main() -> int:
    """Write or compare."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--check", action="store_true", help="write nothing; 1 on a difference")
    options = parser.parse_args()
    try:
        if faults := check():
            sys.stderr.write("".join(f"{fault}\n" for fault in faults) + "nothing was written\n")
            return 2
        if options.check:
            for name in (old := stale()):
                sys.stderr.write(f"{name} is older than its source: hardware/wiring/build.py\n")
            return 1 if old else 0
        (HERE / "pcb").mkdir(exist_ok=True)
        for name, text in drawn().items():
            (HERE / name).write_text(text, encoding="utf-8")
        for page in (GUIDE, REFERENCE):
            page.write_text(with_tables(page.read_text(encoding="utf-8")), encoding="utf-8")
    except WiringError as error:
        sys.stderr.write(f"{error}\nnothing was written\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
