"""Rebuilds every part, drawing and picture, and compares them with the committed files.

    python hardware/cad/build.py            build into a temporary folder and compare
    python hardware/cad/build.py --write    replace the committed files
    python hardware/cad/build.py --no-pictures   skip the slow half

Exit code 0: no difference, 1: differences (listed), 2: impossible parameters.
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
FOLDERS = (("stl", ".stl"), ("dxf", ".dxf"), ("pictures", ".png"))


def build(p: Parameters, out: Path, pictures: bool) -> dict[str, object]:
    """Writes stl/, dxf/, cad/built.json and pictures/ below `out`; returns the table."""
    import build123d as bd  # slow to import: after the parameters were found possible
    import drawings
    import families

    import report

    for folder in ("stl", "dxf", "pictures", "cad"):
        (out / folder).mkdir(parents=True, exist_ok=True)
    made = families.all_parts(p)
    for part in made:
        bd.export_stl(part.solid, out / "stl" / f"{part.name}.stl", tolerance=0.01,
                      angular_tolerance=0.1 if part.process == "printed" else 0.2)
        if part.sheet is not None:
            drawings.write(part.sheet, out / "dxf" / f"{part.name}.dxf")
        print(f"  {part.name:20} {part.process:8} {part.solid.volume:9.1f} mm3")
    table = report.table(p, made, out / "stl")
    (out / TABLE).write_text(report.dump(table), encoding="utf-8")
    if pictures:
        import pictures as painter
        painter.paint(table, out / "stl", out / "pictures")
        print(f"  {len(list((out / 'pictures').glob('*.png')))} pictures")
    return table


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
    if pictures:
        rows += comparison.picture_differences(HARDWARE / "pictures", out / "pictures")
    return rows


def collide(table: dict[str, object]) -> list[str]:
    """Pairs of the assembly that fill the same space, in words."""
    from collisions import TOUCH

    return [f"{pair}: {volume} mm3" for pair, volume in table["overlaps_mm3"].items()
            if volume > TOUCH]


def write(out: Path, pictures: bool) -> None:
    """Replaces the committed files by those below `out`; files of others stay."""
    for folder, suffix in FOLDERS if pictures else FOLDERS[:2]:
        (HARDWARE / folder).mkdir(exist_ok=True)
        for old in (HARDWARE / folder).glob(f"*{suffix}"):
            old.unlink()
        for new in (out / folder).glob(f"*{suffix}"):
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
        table = build(p, out, pictures)
        clashes = collide(table)
        if clashes:
            print("parts of the assembly overlap, nothing was written:", *clashes, sep="\n  ")
            return 1
        if options.write:
            write(out, pictures)
            print("wrote stl, dxf, cad/built.json" + (", pictures" if pictures else ""))
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
