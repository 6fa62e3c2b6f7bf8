"""``make faults``: every row of the fault table, measured, with its negative control.

    make faults                                 all rows
    make faults ARGS="--rows 8,21 --world mock" some of them
    make faults ARGS="--without guard"          without one safety layer: it goes red
    make faults ARGS="--layers"                 the layers and what removes them
    make faults ARGS="--hil serial:///dev/ttyUSB0?i2c=1"   a real car, wheels lifted
    make faults ARGS="--write"                  keep the figures for docs/results/fault_table.md
    make faults ARGS="--page"                   write that page again, measuring nothing
"""

from __future__ import annotations

import argparse
import sys
import time

from fault_table import page
from fault_table.judge import How, Verdict, judge
from fault_table.row import Case, Row
from fault_table.show import header, layers, line, summary
from fault_table.table import LAYERS, ROWS


def chosen(options: argparse.Namespace) -> list[tuple[Row, Case]]:
    """Requested cases."""
    rows = [row for row in ROWS if row.number in options.rows or not options.rows]
    return [(row, case) for row in rows for case in row.cases
            if (not options.world or case.world == options.world)
            and (not options.fast or case.fast)
            and (not options.hil or case.hil)]


def numbers(text: str) -> set[int]:
    """1,2,8-12."""
    found: set[int] = set()
    for part in text.split(","):
        first, _, last = part.partition("-")
        found |= set(range(int(first), int(last or first) + 1))
    return found


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="make faults", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=numbers, default=set(), metavar="1,8-12")
    parser.add_argument("--world", choices=["wire", "mock", "elf", "pty"])
    parser.add_argument("--without", default="", metavar="LAYER", help="remove safety layers")
    parser.add_argument("--layers", action="store_true", help="list them")
    parser.add_argument("--hil", metavar="URL", help="a real car with lifted wheels")
    parser.add_argument("--fast", action="store_true", help="what the default tests run")
    parser.add_argument("--no-controls", action="store_true")
    parser.add_argument("--write", action="store_true", help="keep the figures for the page")
    parser.add_argument("--page", action="store_true", help="write the page from what is kept")
    options = parser.parse_args()
    options.without = tuple(name for name in options.without.split(",") if name)
    unknown = [name for name in options.without if name not in LAYERS]
    if unknown:
        parser.error(f"no layer {', '.join(unknown)}; there are {', '.join(sorted(LAYERS))}")
    return options


def main() -> int:
    options = arguments()
    if options.layers:
        layers()
        return 0
    if options.page:
        page.write()
        return 0
    if options.hil and not confirm_lifted(options.hil):
        return 2
    how = How(removed=options.without, hil=options.hil, controls=not options.no_controls,
              full=not options.fast)
    header(how)
    begin = time.monotonic()
    verdicts = list[tuple[Row, Verdict]]()
    for row, case in chosen(options):
        verdict = judge(case, how)
        verdicts.append((row, verdict))
        line(row, verdict)
    summary(verdicts, time.monotonic() - begin)
    if options.write:
        page.keep(verdicts)
        page.write()
    return 0 if verdicts and all(verdict.is_green for _, verdict in verdicts) else 1


def confirm_lifted(url: str) -> bool:
    """A person confirms that the wheels are up."""
    print(f"{url}: the wheels will turn at throttle 0.3, and programs will be killed while they do."
          "\nBattery in, car on a stand, all four wheels free, nobody's hand near them.")
    return input("Type LIFTED to go on: ").strip() == "LIFTED"


if __name__ == "__main__":
    sys.exit(main())
