"""Rebuilds every part, drawing and picture, and compares them with the committed files.

    python hardware/cad/build.py            build into a temporary folder and compare
    python hardware/cad/build.py --write    replace the committed files
    python hardware/cad/build.py --no-pictures   skip the slow half

Exit code 0: no difference, 1: differences, or a car that cannot be put together (listed, nothing
written), 2: impossible parameters.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import checks
from parameters import FILE, ParameterError, Parameters

HARDWARE = Path(__file__).parents[1]
TABLE = Path("cad") / "built.json"
FOLDERS = (("stl", ".stl"), ("step", ".step"), ("dxf", ".dxf"), ("drill", ".svg"),
           ("pictures", ".png"))
DATE = "2026-01-01T00:00:00"
"""Fixed time stamp of the STEP files: the same part gives the same file."""


def build(p: Parameters, out: Path) -> dict[str, object]:
    """Writes stl/, step/, dxf/, drill/ and cad/built.json below `out`; returns the table."""
    import build123d as bd  # slow to import: after the parameters were found possible
    import drawings
    import drill_sheets
    import families
    import report

    for folder in ("stl", "step", "dxf", "drill", "pictures", "cad"):
        (out / folder).mkdir(parents=True, exist_ok=True)
    made = families.all_parts(p)
    for part in made:
        bd.export_stl(part.solid, out / "stl" / f"{part.name}.stl", tolerance=0.01,
                      angular_tolerance=0.1 if part.process == "printed" else 0.2)
        bd.export_step(part.solid, out / "step" / f"{part.name}.step", timestamp=DATE)
        if part.sheet is not None:
            drawings.write(part.sheet, out / "dxf" / f"{part.name}.dxf")
            drill_sheets.write(part.sheet, out / "drill" / f"{part.name}.svg")
        print(f"  {part.name:20} {part.process:8} {part.solid.volume:9.1f} mm3")
    table = report.table(p, made, out / "stl")
    (out / TABLE).write_text(report.dump(table), encoding="utf-8")
    return table


def paint(table: dict[str, object], out: Path) -> list[str]:
    """Pictures, the slow half, of a car that can be built; returns what their labels miss."""
    import pictures as painter

    missed = painter.paint(table, out / "stl", out / "pictures")
    print(f"  {len(list((out / 'pictures').glob('*.png')))} pictures")
    return missed


def compare(out: Path, pictures: bool) -> list[tuple[str, str, str, str]]:
    """Rows (file, what, committed, rebuilt) where the committed files are not what was built."""
    import compare as comparison

    old = HARDWARE / TABLE
    if not old.is_file():
        return [(str(TABLE), "file", "missing", "there")]
    rows = comparison.differences(json.loads(old.read_text(encoding="utf-8")),
                                  json.loads((out / TABLE).read_text(encoding="utf-8")))
    rows += comparison.stl_differences(HARDWARE / "stl", out / "stl")
    rows += comparison.dxf_differences(HARDWARE / "dxf", out / "dxf")
    rows += comparison.step_differences(HARDWARE / "step", out / "step")
    rows += comparison.text_differences(HARDWARE / "drill", out / "drill")
    if pictures:
        rows += comparison.picture_differences(HARDWARE / "pictures", out / "pictures")
    return rows


def collide(p: Parameters, table: dict[str, object], stl: Path) -> list[str]:
    """Everything by which the car cannot be put together, in words: part and rule."""
    import battery
    import fit
    import screws
    import steering
    from collisions import TOUCH

    rows, bodies = screws.load(p=p), fit.car(table, stl)
    return [*(f"{pair}: both fill the same {volume} mm3"
              for pair, volume in table["overlaps_mm3"].items() if volume > TOUCH),
            *screws.wrong(rows, table["parts"]), *fit.problems(table, rows, bodies),
            *fit.near_rotor(p, bodies), *steering.sweep(p, bodies), *battery.loose(bodies)]


def same_drawings(out: Path) -> set[str]:
    """Drawings that did not change: the library writes the head of a DXF in any order."""
    import compare as comparison

    new = {f.name for f in (out / "dxf").glob("*.dxf")}
    return new - {row[0] for row in comparison.dxf_differences(HARDWARE / "dxf", out / "dxf")}


def write(out: Path, pictures: bool) -> None:
    """Replaces the committed files by those below `out`; files of others stay."""
    for folder, suffix in FOLDERS if pictures else FOLDERS[:-1]:
        (HARDWARE / folder).mkdir(exist_ok=True)
        same = same_drawings(out) if folder == "dxf" else set()
        for old in (HARDWARE / folder).glob(f"*{suffix}"):
            if old.name not in same:
                old.unlink()
        for new in (out / folder).glob(f"*{suffix}"):
            if new.name not in same:
                shutil.copy(new, HARDWARE / folder / new.name)
    shutil.copy(out / TABLE, HARDWARE / TABLE)


def wiring(arguments: list[str]) -> int:
    """The diagrams of the wiring have a builder of their own."""
    script = HARDWARE / "wiring" / "build.py"
    if not script.is_file():
        return 0
    return subprocess.run([sys.executable, str(script), *arguments], check=False).returncode


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="replace the committed files")
    parser.add_argument("--no-pictures", action="store_true", help="parts and drawings only")
    parser.add_argument("--no-wiring", action="store_true", help="leave the diagrams alone")
    parser.add_argument("--parameters", type=Path, default=FILE, help="another parameter file")
    options = parser.parse_args()
    pictures = not options.no_pictures
    try:
        p = checks.load(options.parameters)
    except ParameterError as error:
        print(error, file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        table, stl = build(p, out), out / "stl"
        for why, faults in (("the car cannot be put together", lambda: collide(p, table, stl)),
                            ("pictures mislead", lambda: paint(table, out) if pictures else [])):
            if found := faults():
                print(f"{why}, nothing was written:", *found, sep="\n  ", file=sys.stderr)
                return 1
        if options.write:
            write(out, pictures)
            print("wrote stl, step, dxf, drill, cad/built.json"
                  + (", pictures" if pictures else ""))
            rows = []
        else:
            rows = compare(out, pictures)
    if rows:
        print(f"\n{len(rows)} differences: committed files are not what the sources build")
        for row in rows:
            print("  {:22} {:16} committed {}\n{:41}rebuilt   {}".format(*row[:3], "", row[3]))
        print("if the change is wanted: make hardware ARGS=--write")
    diagrams = 0 if options.no_wiring else wiring([] if options.write else ["--check"])
    if not rows and not diagrams and not options.write:
        print("no difference: parts, drawings and pictures are what the sources build")
    return 1 if rows or diagrams else 0


if __name__ == "__main__":
    sys.exit(main())
