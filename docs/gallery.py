"""The gallery of the handbook: each program of ``examples/`` with its sentence and a picture.

    python docs/gallery.py                 # writes docs/gallery.md from the programs' docstrings
    python docs/gallery.py drive_circle    # runs this one and draws its picture anew first

A program that draws is asked for its picture. Of one that drives the way of its cars is drawn, of
any other what it prints.
"""

from __future__ import annotations

import ast
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
EXAMPLES = DOCS.parent / "examples"
MOCK = {"DART_HAL_URL": "sim://?nano=mock", "DART_NANO": "mock"}
OTHERS = {"tune_on_what_was_found": {"DART_HAL_URL": "sim://?nano=mock&effect=steering_lag:0.12"}}
"""The emulated car that a program drives, where it is not the plain one."""
COMMAND = re.compile(r"((?:python|dart-hal drive) examples/\S+)(.*)")
HEAD = """# Gallery

Programs of `examples/` with their commands and pictures, all of emulated cars. This page is
generated: `python docs/gallery.py`.
"""


def programs() -> list[Path]:
    """In the order of the page."""
    return [*sorted(EXAMPLES.glob("*.py")), *sorted((EXAMPLES / "use_cases").glob("*.py"))]


def words(program: Path) -> tuple[str, str]:
    """(first sentence of its docstring, the first command there without its options)."""
    text = ast.get_docstring(ast.parse(program.read_text(encoding="utf-8"))) or ""
    command = COMMAND.search(text)
    if command is None:
        raise ValueError(f"{program} does not say how it is run")
    drawn = " picture.png" if ".png" in command[2] else ""
    return text.splitlines()[0], command[1] + drawn


def picture(program: Path) -> Path:
    """Where its picture lies; a use case has its own on its page."""
    folder = "" if program.parent.name == "use_cases" else "gallery/"
    return DOCS / "pictures" / f"{folder}{program.stem}.png"


def page() -> str:
    """The page as it should be."""
    parts = [HEAD]
    for program in programs():
        sentence, command = words(program)
        title = program.stem.replace("_", " ").capitalize()
        story = DOCS / "use_cases" / f"{program.stem}.md"
        more = f" [More](use_cases/{story.name})." if story.exists() else ""
        source = f"../{program.relative_to(DOCS.parent)}"
        parts.append(f"## {title}\n[{sentence}]({source}){more}\n\n```sh\n{command}\n```\n")
        if picture(program).exists():
            parts.append(f"![{title}]({picture(program).relative_to(DOCS)})\n")
    return "\n".join(parts)


def draw(program: Path) -> None:
    """Run it, and draw what it did."""
    out, source = picture(program), program.read_text(encoding="utf-8")
    out.parent.mkdir(exist_ok=True)
    os.environ |= MOCK | OTHERS.get(program.stem, {})
    if ".png" in words(program)[1]:
        subprocess.run([sys.executable, program, out], check=True)
    elif "Car.open(" in source or "def control(" in source:
        draw_ways(ways_of(program, script="def control(" in source), out)
    if not out.exists():
        done = subprocess.run([sys.executable, program], check=True, capture_output=True, text=True)
        draw_text(done.stdout, out)


def ways_of(program: Path, *, script: bool) -> list[list[tuple[float, ...]]]:
    """Rows (t, x, y, speed) of each car that the program drives."""
    from dart_hal import Car
    from dart_hal.cli.main import cli

    ways: list[list[tuple[float, ...]]] = []
    opens = Car.open

    def watched(*args: Any, **options: Any) -> Car:
        car, rows = opens(*args, **options), []
        if not car.url.startswith("replay:"):  # a drive that was drawn already
            ways.append(rows)
        car.on_state(lambda s: rows.append((s.t, s.pose.x, s.pose.y, s.speed)))
        return car

    Car.open, sys.argv = watched, [str(program)]  # type: ignore[method-assign,assignment]
    try:
        if script:
            cli.main(["drive", str(program)], "dart-hal", standalone_mode=False)
        else:
            runpy.run_path(str(program), run_name="__main__")
    except SystemExit as ended:
        if ended.code:
            raise
    finally:
        Car.open = opens  # type: ignore[method-assign]
    return ways


def draw_ways(ways: list[list[tuple[float, ...]]], out: Path) -> None:
    """Seen from above, and speed over time; nothing where no car was opened here."""
    from matplotlib.figure import Figure

    if not ways:
        return
    figure = Figure(figsize=(9.0, 3.4), layout="constrained")
    floor, speed = figure.subplots(1, 2)
    for n, rows in enumerate(ways, start=1):
        t, x, y, v = zip(*rows, strict=True)
        floor.plot(x, y, lw=1.2)
        speed.plot([at - t[0] for at in t], v, lw=1.0, label=f"drive {n}")
    floor.set(xlabel="x [m]", ylabel="y [m]", title="odometry")
    floor.axis("equal")
    speed.set(xlabel="t [s]", ylabel="speed [m/s]")
    if len(ways) > 1:
        speed.legend(fontsize=8)
    for panel in (floor, speed):
        panel.grid(alpha=0.3)
    figure.savefig(out, dpi=72)


def draw_text(text: str, out: Path) -> None:
    """As a terminal shows it."""
    from matplotlib.figure import Figure

    lines = text.rstrip().splitlines()
    wide, high = max(map(len, lines)), len(lines)
    figure = Figure(figsize=(0.086 * wide + 0.3, 0.19 * high + 0.3), facecolor="#22313f")
    figure.text(0.15 / figure.get_figwidth(), 0.5, "\n".join(lines), color="white", va="center",
                family="monospace", fontsize=10, linespacing=1.25)
    figure.savefig(out, dpi=72, facecolor=figure.get_facecolor())


def main(*names: str) -> None:
    """Draw the named ones, write the page."""
    for program in programs():
        if program.stem in names:
            draw(program)
    (DOCS / "gallery.md").write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
