"""Bill of materials: reads bom.csv and tools.csv, checks them, writes docs/reference/bom.md.

    python hardware/bom.py            write the page, and the table of screws in the guide
    python hardware/bom.py --check    exit 1 if a committed page differs
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

import screws  # beside this file: python hardware/bom.py
from bom_page import page
from bom_table import BomError, load, load_tools

HERE = Path(__file__).resolve().parent
PAGE = HERE.parent / "docs" / "reference" / "bom.md"
DECK = HERE.parent / "docs" / "build_guide" / "05_deck.md"


def with_screws(text: str, table: str) -> str:
    """A page of the guide with its table of screws replaced."""
    block = f"<!-- screws -->\n{table}\n<!-- end of screws -->"
    return re.sub(r"<!-- screws -->\n.*?<!-- end of screws -->", lambda _: block, text,
                  flags=re.DOTALL)


def generated() -> dict[Path, str]:
    """Each page and what it should hold. Raises BomError."""
    deck = DECK.read_text(encoding="utf-8")
    return {PAGE: page(load(), load_tools()),
            DECK: with_screws(deck, screws.table(screws.load()))}


def main() -> int:
    """Write the pages, or compare them."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--check", action="store_true",
                        help="write nothing; exit 1 on a difference")
    check = parser.parse_args().check
    try:
        pages = generated()
    except BomError as error:
        sys.stderr.write(f"{error}\n")
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
