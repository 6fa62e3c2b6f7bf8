"""Bill of materials: reads bom.csv and tools.csv, checks them, writes docs/reference/bom.md.

    python hardware/bom.py            write the page; tables of the guide
    python hardware/bom.py --check    exit 1 if a committed page differs
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

import guide  # beside this file: python hardware/bom.py
import printed
import screws
from bom_page import page
from bom_table import BomError, Row, Tool, load, load_tools

HERE = Path(__file__).resolve().parent
PAGE = HERE.parent / "docs" / "reference" / "bom.md"
GUIDE = HERE.parent / "docs" / "build_guide"
DECK, PRINT = GUIDE / "05_deck.md", GUIDE / "02_print_and_cut.md"


def with_block(name: str, text: str, table: str) -> str:
    """A page of the guide with the table between its marks replaced."""
    return re.sub(rf"<!-- {name} -->\n.*?<!-- end of {name} -->",
                  lambda _: f"<!-- {name} -->\n{table}\n<!-- end of {name} -->", text,
                  flags=re.DOTALL)


def unused(rows: list[Row], tools: list[Tool], steps: list[guide.Step]) -> list[str]:
    """Rows that no step of the guide uses, steps that a row names without being named there, and
    tools that nobody picks up."""
    named = {part: {s.id for s in steps if part in s.parts} for s in steps for part in s.parts}
    wrong = [f"{r.id} (bom.csv): no step of the build guide uses it" for r in rows
             if r.id not in named]
    wrong += [f"{r.id} (bom.csv): used_in says {step}, which does not name it" for r in rows
              for step in r.used_in if step not in named.get(r.id, {step})]
    wrong += [f"{part}: step {', '.join(sorted(where))} uses it, and bom.csv has no such row"
              for part, where in named.items() if part not in {r.id for r in rows}]
    held = {tool for s in steps for tool in s.tools}
    return wrong + [f"{t.id} (tools.csv): no step of the build guide uses it" for t in tools
                    if t.id not in held]


def generated() -> dict[Path, str]:
    """Each page and what it should hold. Raises BomError."""
    rows, tools = load(), load_tools()
    if wrong := unused(rows, tools, guide.steps()):
        raise BomError("\n".join(wrong))
    pages = {p: p.read_text(encoding="utf-8") for p in (DECK, PRINT)}
    pages[DECK] = with_block("screws", pages[DECK], screws.table(screws.load()))
    pages[PRINT] = with_block("printed", pages[PRINT], printed.table())
    return {PAGE: page(rows, tools), **pages}


def main() -> int:
    """Write the pages, or compare them."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--check", action="store_true",
                        help="write nothing; exit 1 on a difference")
    check = parser.parse_args().check
    try:
        pages = generated()
    except (BomError, guide.GuideError) as error:
        sys.stderr.write(f"{error}\nnothing was written\n")
        return 2
    old = [p for p, text in pages.items()
           if not p.is_file() or p.read_text(encoding="utf-8") != text]
    for path in old:
        if check:
            sys.stderr.write(f"{path.name} is not what the tables say: python hardware/bom.py\n")
        else:
            path.write_text(pages[path], encoding="utf-8")
    return 1 if check and old else 0


if __name__ == "__main__":
    sys.exit(main())
