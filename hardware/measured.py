"""Enter what a builder measured into the parameter file: value, and source = "measured".

    python hardware/measured.py gear.hub=8.35 lidar.ear=3.8
    python hardware/measured.py my_log.txt      lines like "gear.hub = 8.35"; # begins a remark
    python hardware/measured.py --page          write the table of the builder's log

Either all values are entered or none: a value that cannot be built is refused with its bounds. Exit
code 0: entered, 2: refused. Then `make hardware ARGS=--write` builds the parts that change.
"""

from __future__ import annotations

import re
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.append(str(HERE / "cad"))
import checks  # noqa: E402 - found through the line above
import parameters  # noqa: E402
from bom import with_block  # noqa: E402

PAGE = HERE.parent / "docs" / "build_guide" / "log.md"
MEASURE = (
    "sheet.thickness", "printer.hole_extra", "stack.jetson_pcb", "stack.standoff_upper",
    "gear.outer", "gear.recess", "gear.hub", "hall.boss", "hall.boss_length", "hall.face_to_ring",
    "lidar.front_x", "lidar.front_half", "lidar.rear_x", "lidar.rear_half", "lidar.ear",
    "lidar.rotor", "lidar.axis_x", "lidar.scan_z", "lidar.top_z", "base_holes.adapter_x",
    "base_holes.adapter_y", "base_holes.imu_pitch_x", "base_holes.imu_pitch_y", "back.window",
    "shock.bore", "shock.outer", "shock.length", "steering.servo_x", "steering.servo_top_y",
    "steering.horn", "steering.throw", "battery.length", "battery.width", "battery.height",
    "car.rear_axle_x", "car.wheelbase", "car.track", "car.wheel_radius", "car.floor_z",
    "car.gear_x", "car.gear_width", "car.gear_web", "car.board_z", "car.ground_z", "mass.chassis",
    "mass.expansion_board", "mass.jetson", "mass.lidar", "mass.cell", "mass.lipo", "mass.servo",
    "mass.nano", "mass.imu", "mass.camera", "mass.ir_module",
    "mass.standoffs", "mass.bumper", "mass.cables",
)
"""What a builder can measure, in the order of the guide; all else is this project's own choice."""
LINE = re.compile(r"^\s*([a-z_]+\.[a-z_]+)\s*=\s*(.+?)\s*(?:#.*)?$")


class LogError(ValueError):
    """Something that cannot be entered: where, what was found, what was expected."""


def parse(text: str, where: str) -> dict[str, list[float]]:
    """Names and numbers of a log; a line without a value after "=" is still to be measured."""
    found: dict[str, list[float]] = {}
    for number, line in enumerate(text.splitlines(), 1):
        bare = line.split("#")[0].strip()
        if not bare or bare.endswith("="):
            continue
        match = LINE.match(line)
        if match is None:
            raise LogError(f"{where}, line {number}: {bare!r}; expected for example "
                           "gear.hub = 8.35")
        try:
            values = [float(v) for v in match[2].strip("[]").split(",")]
        except ValueError:
            raise LogError(f"{where}, line {number}: {match[1]} = {match[2]!r} is no number; "
                           "a point for the decimals, commas between several") from None
        if match[1] in found:
            raise LogError(f"{where}, line {number}: {match[1]} for the second time")
        found[match[1]] = values
    return found


def entered(text: str, values: dict[str, list[float]]) -> str:
    """The parameter file with these values. Raises LogError for a name that it does not have."""
    lines, group, left = text.splitlines(), "", dict(values)
    for n, line in enumerate(lines):
        if head := re.match(r"\[(\w+)\]", line):
            group = head[1]
        name = f"{group}.{line.split(' = ')[0]}"
        if name in left:
            numbers = [f"{v:g}" if v != int(v) else f"{v:.1f}" for v in left.pop(name)]
            value = numbers[0] if len(numbers) == 1 else f"[{', '.join(numbers)}]"
            line = re.sub(r"value = (\[.*?\]|[^,]+),", f"value = {value},", line, count=1)
            lines[n] = re.sub(r'source = "[^"]*"', 'source = "measured"', line, count=1)
    if left:
        raise LogError(f"no such dimension: {', '.join(left)}; expected one of "
                       f"{', '.join(MEASURE)}")
    return "\n".join(lines) + "\n"


def enter(values: dict[str, list[float]], path: Path = parameters.FILE) -> None:
    """Replace the file if all values can be built. Raises LogError, ParameterError."""
    new = entered(path.read_text(encoding="utf-8"), values)
    with tempfile.TemporaryDirectory() as folder:
        trial = Path(folder) / path.name
        trial.write_text(new, encoding="utf-8")
        checks.load(trial)
    path.write_text(new, encoding="utf-8")


def table() -> str:
    """Markdown: what is drawn, within which bounds, and room for what was measured."""
    raw = parameters.read().raw
    lines = ["| dimension | what | drawn | from | bounds | measured |",
             "|---|---|---:|---|---|---|"]
    for name in MEASURE:
        group, key = name.split(".")
        e = raw[group][key]
        unit = "" if e["unit"] == "1" else f" {e['unit']}"
        value = e["value"]
        shown = ", ".join(f"{v:g}" for v in value) if isinstance(value, list) else f"{value:g}"
        what = "" if e["comment"] == "-" else e["comment"]
        lines.append(f"| `{name}` | {what} | {shown}{unit} | {e['source']} | {e['min']:g} to "
                     f"{e['max']:g} | |")
    return "\n".join(lines)


def page(text: str) -> str:
    """The builder's log with its table as the parameter file has it."""
    return with_block("log", text, table())


def main() -> int:
    """Enter the arguments or a log."""
    args = sys.argv[1:]
    if not args or args[0] in ("-h", "--help"):
        sys.stdout.write(__doc__ or "")
        return 0 if args else 2
    try:
        if args == ["--page"]:
            PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
            return 0
        if "=" in args[0]:
            values = parse("\n".join(args), "arguments")
        else:
            values = parse(Path(args[0]).read_text(encoding="utf-8"), args[0])
        enter(values)
    except (LogError, parameters.ParameterError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        if isinstance(error, LogError):
            sys.stderr.write("nothing was written\n")
        return 2
    sys.stdout.write(f"{len(values)} measured; make hardware ARGS=--write builds what changes\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
