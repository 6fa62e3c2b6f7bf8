"""``dart-hal compare``: two runs side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from dart_hal.car.compare import Comparison, compare
from dart_hal.cli.common.options import html_option, json_option
from dart_hal.cli.common.output import print_json, print_line, show_notices
from dart_lab.pages.compare_page import difference_rows, lead, statistic_rows, write_page

# Differences on the screen; --html and --json have all.
MAX_PRINTED_DIFFERENCES = 20


@click.command("compare")
@click.argument("a", type=click.Path(path_type=Path))
@click.argument("b", type=click.Path(path_type=Path))
@html_option
@json_option
def command(a: Path, b: Path, html: Path | None, as_json: bool) -> None:
    """Compare the runs A and B: lengths, losses, speeds, commands, files, firmware.

    With equal commands, also print the time at which speed or yaw rate first differs for 50 ms.
    """
    found = compare(a, b)
    show_notices((*found.a.run.notices, *found.b.run.notices))
    answer = found.to_json()
    if html is not None:
        write_page(found, html, answer)
    if as_json:
        print_json({**answer, "page": html})
        return
    _print_comparison(found, answer)
    if html is not None:
        print_line(f"report: {html}")


def _print_comparison(found: Comparison, answer: dict[str, Any]) -> None:
    """Print one line per run, the statistics, the differences and the conclusion."""
    for name, run in zip("AB", answer["runs"], strict=True):
        print_line(f"{name}  {run['path']}: {run['car']}, {run['duration_s']:.1f} s, "
                    f"{run['distance_m']:.1f} m, {run['lost']} of {run['lost'] + run['frames']} "
                    f"frames lost, firmware {run['firmware']}")
    print_line("")
    for row in statistic_rows(answer["statistics"]):
        print_line(f"{row[0]:<24}{row[1]:<3}" + "".join(f"{cell:>11}" for cell in row[2:]))
    print_line("")
    # Differences of car, firmware and files.
    rows = difference_rows(found.differs)
    for name, one, other in rows[:MAX_PRINTED_DIFFERENCES]:
        print_line(f"{name}: {one} -> {other}")
    if len(rows) > MAX_PRINTED_DIFFERENCES:
        print_line(f"and {len(rows) - MAX_PRINTED_DIFFERENCES} more differences: --html or --json")
    if not rows:
        print_line("car, firmware and files of the car are the same")
    print_line(lead(found))
