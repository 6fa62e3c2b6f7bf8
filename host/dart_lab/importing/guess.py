"""Propose a map: columns by their names, then signs, units and axes by the data.

1. Of each quantity, the candidates are the columns whose name fits. The first rule that fits wins,
   then the table with most rows.
2. What the names do not show is searched in the data: yaw is the angle that follows the direction
   of travel of two columns, the speed follows their speed, the yaw rate is the derivative of yaw.
3. The map is applied and checked as an import is. Each contradiction changes the map.
4. What no data can show is a question to the user.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import permutations

import msgspec
import numpy as np

from dart_hal.core.config.model import MOTOR_VOLTAGE_RANGE
from dart_hal.core.errors import RecordingError
from dart_hal.core.types import FloatArray

from .checks import GRID_STEP, Change, check_data
from .convert import COMMAND_TOLERANCE, convert_tables
from .maps import MAP_SCHEMA, MAP_STREAMS, UNITS, UNITS_BY_KEY, Column, ImportMap, column_of
from .tables import Table, quote_names

# Changes of the map by the checks; each stream has a few.
MAX_CHANGES = 12
# Rows of a table that the search in the data uses.
MAX_SEARCHED_ROWS = 2000
# Columns without a name that fits, among which the data are searched.
MAX_SEARCHED_COLUMNS = 24
# Agreement of direction of travel and yaw (1: complete), and correlation of other columns, from
# which a search in the data is a hit.
MIN_AGREEMENT = 0.9
# Share of rows that repeat a message from which on a log is taken to repeat its messages.
MIN_REPEATED_SHARE = 0.1
# Share of numbers from which on a column with text is one of numbers with a damaged line.
MIN_NUMERIC_SHARE = 0.5
# Names, best rule first. The text is lower case.
END = r"(?:$|[^a-z0-9])"
NAME_RULES: dict[str, tuple[str, ...]] = {
    "time": (r"(vicon|mocap|optitrack).*time", r"^stamp$",
             r"^(t|time|timestamp|_timestamp_ms)" + END, r"time|stamp", r"^arrival$"),
    "x": (r"(vicon|mocap|optitrack|vrpn|natnet).*[ _./]x" + END, r"pose\.pose\.position\.x|"
          r"position\.x|pos(ition)?[ _]?x", r"^x" + END),
    "yaw": (r"(vicon|mocap|optitrack|vrpn|natnet).*(yaw|theta|heading)", r"orientation\.yaw",
            r"^(yaw|heading|psi|phi|theta)" + END),
    "steering": (r"steering_angle$|steer", r"delta", r"user/angle|servo"),
    "throttle": (r"throttle", r"duty",
                 r"drive\.speed|(cmd|command|ref|target)[^a-z]*.*(speed|vel)"),
    "speed": (r"enc(oder)?" + END + r"|vel encoder|wheel.*(speed|vel)", r"twist\.linear\.x",
              r"odom.*(speed|vel|vx)|state\.speed|erpm", r"^(v|vx|speed|velocity)" + END,
              r"wheel.*(m[/_]s|km[/_]?h)"),
    "yaw_rate": (r"angular_velocity\.z|^w \(imu\)|gyr(o)?[ _]?z|yaw[ _]?rate",
                 r"^(omega|r|w[ _]?z)" + END),
    "accel_x": (r"linear_acceleration\.x|ac(c|l|cel)[a-z]*[ _]?x", r"^a[ _]?x" + END),
    "accel_y": (r"linear_acceleration\.y|ac(c|l|cel)[a-z]*[ _]?y", r"^a[ _]?y" + END),
    "gate": (r"safety|enable|deadman|gate",),
    "voltage": (r"voltage_input$|(^|[^a-z])v_?in$",
                r"(batt|bat|pack|lipo)[a-z]*.*(volt|[ _.]v" + END + r")|vbat", r"volt"),
}
# A position is none of these, and a measured quantity is no command.
NOT_A_POSITION = re.compile(r"acc|acl|vel|speed|gyr|omega|vx|covariance|angular|imu")
# Voltages of something else than the whole battery.
NOT_OF_THE_PACK = re.compile(r"cell|motor|servo|logic|percent|5v|3v3|charge")
COMMAND = re.compile(r"cmd|command|drive\.|ref|target|user/|pilot/")
# How names spell units, in lower case. A voltage is recognised by its size.
UNIT_SPELLINGS = {
    spelling: unit for unit in UNITS if unit not in ("1", "V", "mV")
    for spelling in (unit, unit.replace("/", "_"))} | {
    "kmh": "km/h", "kph": "km/h", "mps": "m/s", "dps": "deg/s", "pct": "%", "percent": "%",
    "°": "deg", "°/s": "deg/s", "\u00b5s": "us", "\u03bcs": "us", "m/s²": "m/s2",
    "m/s^2": "m/s2"}
UNIT_IN_NAME = re.compile(rf"[\[(_ ]({'|'.join(map(re.escape, UNIT_SPELLINGS))})[\])]?$")
# A steering command above this [rad] is none in degrees; above 100 it is a pulse [us].
MAX_STEERING_ANGLE = 1.0
MIN_PULSE = 500.0
# us; usual neutral and reach of a servo, and steps of a larger reach.
NEUTRAL = 1500.0
USUAL_REACH = 400.0
PULSE_STEP = 50.0


@dataclass
class Proposal:
    """A map under construction: columns, tables and kinds by stream, evidence and questions."""

    columns: dict[str, dict[str, Column]] = field(default_factory=dict)
    tables: dict[str, Table] = field(default_factory=dict)
    settings: dict[str, dict[str, object]] = field(default_factory=dict)
    evidence: list[str] = field(default_factory=list)
    questions: list[str] = field(default_factory=list)

    def add(self, stream: str, table: Table, columns: Mapping[str, Column], why: str) -> None:
        """Add a stream with its columns."""
        self.columns[stream] = dict(columns)
        self.tables[stream] = table
        self.settings.setdefault(stream, {})
        names = ", ".join(f"{key} = {c.column!r}" for key, c in columns.items())
        self.evidence.append(f"{stream}: {names}: {why}")

    def build(self) -> ImportMap:
        """Return the map. Raises msgspec.ValidationError if a needed stream is missing."""
        several = len({id(t) for t in self.tables.values()}) > 1
        streams = {name: {**columns, **self.settings[name],
                          **({"table": self.tables[name].name} if several else {})}
                   for name, columns in self.columns.items()}
        times = [stream.pop("time") for stream in streams.values()]
        shared = {"time": times[0]} if times.count(times[0]) == len(times) else {}
        if not shared:
            for stream, time in zip(streams.values(), times, strict=True):
                stream["time"] = time
        return msgspec.convert({"schema": MAP_SCHEMA, "name": "guessed", **shared,
                                **msgspec.to_builtins(streams)}, ImportMap)


@dataclass(frozen=True, slots=True)
class GuessedMap:
    """A proposed map as TOML text, with the evidence for it and the questions that remain."""

    map: ImportMap
    text: str
    evidence: tuple[str, ...]
    questions: tuple[str, ...]


def guess_map(tables: Sequence[Table]) -> GuessedMap:
    """Propose a map for tables. Raises RecordingError if steering or throttle cannot be found."""
    proposal = Proposal()
    # A column of numbers with a single word is left out, which only its line can explain.
    proposal.questions += [
        f"{table.name}: column {name!r} is not used, because line {line} has {cell!r}; can that "
        "line be repaired?" for table in tables for name, (line, cell) in table.text_columns.items()
        if np.isfinite(table.columns[name]).mean() > MIN_NUMERIC_SHARE]
    _add_poses(proposal, tables)
    _add_commands(proposal, tables)
    _add_sensors(proposal, tables)
    missing = [name for name in ("steering", "throttle") if name not in proposal.columns]
    if missing or len(proposal.columns) < 3:
        found = "; ".join(_describe_columns(t) for t in tables[:6])
        raise RecordingError(
            f"no column looks like {' or '.join(missing) or 'a measurement'}", found=found,
            expected="commands of steering and throttle, and poses or an encoder",
            remedy="write the map by hand; docs/how_to/own_recordings.md has every key")
    _add_battery(proposal, tables)
    _apply_checks(proposal, tables)
    made = proposal.build()
    return GuessedMap(made, format_map(made, proposal.evidence, proposal.questions),
                      tuple(proposal.evidence), tuple(proposal.questions))


def _describe_columns(table: Table) -> str:
    """Describe the columns of a table, and which of them hold no number."""
    empty = [name for name, values in table.columns.items() if not np.isfinite(values).any()]
    return f"{table.name}: {quote_names(table.columns)}" + (
        f"; without a number: {quote_names(empty)}" if empty else "")


def _varies(values: FloatArray) -> bool:
    """Return whether a column has two different numbers."""
    numbers = values[np.isfinite(values)]
    return len(numbers) > 0 and float(np.ptp(numbers)) > 0.0


def _candidates(tables: Sequence[Table], role: str,
                accept: Callable[[str], bool] = lambda name: True, last: Table | None = None
                ) -> Iterator[tuple[Table, str]]:
    """Yield (table, column) by the rules for a role, best first; a rule tries ``last`` at the end.
    """
    for rule in NAME_RULES[role]:
        hits = [(table, name) for table in tables for name in table.columns
                if re.search(rule, name.lower()) and accept(f"{table.name} {name}".lower())
                and name not in table.text_columns and np.isfinite(table.columns[name]).any()]
        yield from sorted(hits, key=lambda hit: (hit[0] is last, -len(hit[0])))


def _column(name: str, stream: str = "", key: str = "") -> Column:
    """Return a column with the unit that its name states, if it is one of the key of a stream."""
    found = UNIT_IN_NAME.search(name.lower())
    unit = UNIT_SPELLINGS[found[1]] if found else "1"
    if unit not in UNITS_BY_KEY.get((stream, key), (unit,)):
        # speed_ms is in m/s, and the letters of x_g (of a frame) are no unit.
        unit = "m/s" if (key, unit) == ("speed", "ms") else "1"
    return Column(column=name, unit=unit)


def _find_y(x: str, names: Collection[str]) -> str | None:
    """Return the name that differs from that of x by one letter alone, y for x; else None."""
    found = [y for i, letter in enumerate(x) if letter in "xX"
             if (y := x[:i] + chr(ord(letter) + 1) + x[i + 1:]) in names]
    return found[-1] if found else None


def _find_time(table: Table) -> Column | None:
    """Return the column of a table that is a time: a name that fits, and values that increase."""
    for _, name in _candidates([table], "time"):
        values = table.columns[name]
        steps = np.diff(values[np.isfinite(values)])
        if len(steps) and (steps >= 0.0).mean() > 0.99 and (steps > 0.0).mean() > 0.5:
            size = float(np.median(np.abs(values[np.isfinite(values)])))
            unit = _column(name).unit
            if unit == "1":  # seconds since 1970 are 1.7e9
                unit = next((u for u, limit in (("s", 1e11), ("ms", 1e14), ("us", 1e17),
                                                ("ns", np.inf)) if size < limit), "s")
            return Column(column=name, unit=unit)
    for name, values in table.columns.items():
        steps = np.diff(values)
        if len(steps) > 10 and np.all(steps > 0.0) and float(steps.max()) < 20.0 * float(
                np.median(steps)):
            units = [u for u in (name.lower(), _column(name).unit) if u in ("ms", "us", "ns")]
            return Column(column=name, unit=units[0] if units else "s")
    return None


def _with_time(proposal: Proposal, stream: str, table: Table, columns: Mapping[str, Column],
               why: str) -> bool:
    """Add a stream if its table has a time; a counter of repeated rows is recognised, too."""
    time = _find_time(table)
    if time is None:
        return False
    proposal.add(stream, table, columns, why)
    proposal.settings[stream]["time"] = time
    return True


def _add_poses(proposal: Proposal, tables: Sequence[Table]) -> None:
    """Find x, y and yaw by name, or by the direction of travel."""
    def is_position(name: str) -> bool:
        return not NOT_A_POSITION.search(name)

    for table, x in _candidates(tables, "x", is_position):
        y = _find_y(x, table.columns)
        stem = re.sub(r"position\.x$|[ _./]?x$", "", x)
        yaws = [name for _, name in _candidates([table], "yaw")]
        yaws.sort(key=lambda name: not name.startswith(stem))
        if y is not None and yaws:
            columns = {"x": _column(x, "poses", "x"), "y": _column(y, "poses", "y"),
                       "yaw": _column(yaws[0], "poses", "yaw")}
            if _with_time(proposal, "poses", table, columns, "by their names"):
                return
    for table in tables:
        found = _search_poses(table)
        if found is not None:
            (x, y, yaw), agreement = found
            columns = {"x": _column(x, "poses", "x"), "y": _column(y, "poses", "y"),
                       "yaw": _column(yaw, "poses", "yaw")}
            if _with_time(proposal, "poses", table, columns, "the direction of travel follows yaw "
                          f"({agreement:.0%})"):
                return


def _search_poses(table: Table) -> tuple[tuple[str, str, str], float] | None:
    """Return the columns whose direction of travel agrees best with a third one, if it does."""
    time = _find_time(table)
    names = [n for n in table.columns if time is not None and n != time.column
             and _varies(table.columns[n])][:MAX_SEARCHED_COLUMNS]
    step = max(len(table) // MAX_SEARCHED_ROWS, 1)
    values = {n: np.nan_to_num(table.columns[n])[::step] for n in names}
    # Unit vectors of an angle; degrees are recognised by their range.
    turns = {n: np.exp(1j * (v if np.ptp(v) < 4.0 * np.pi else np.deg2rad(v)))
             for n, v in values.items()}
    best: tuple[tuple[str, str, str], float] | None = None
    for x, y in permutations(names, 2):
        velocity = np.gradient(values[x]) + 1j * np.gradient(values[y])
        for yaw in names:
            if yaw in (x, y):
                continue
            weight = float(np.abs(velocity).sum())
            agreement = float((velocity * np.conj(turns[yaw])).sum().real) / weight
            spread = 1.0 - abs(turns[yaw].mean())
            if agreement > MIN_AGREEMENT and spread > 0.1 and (best is None
                                                               or agreement > best[1]):
                best = (x, y, yaw), agreement
    return best


def _add_commands(proposal: Proposal, tables: Sequence[Table]) -> None:
    """Find steering and throttle by name, and what kind of command they are by their range."""
    for stream in ("steering", "throttle"):
        candidates = list(_candidates(tables, stream))
        candidates.sort(key=lambda hit: not COMMAND.search(f"{hit[0].name} {hit[1]}".lower()))
        for table, name in candidates:
            if not _with_time(proposal, stream, table, {"value": _column(name)}, "by its name"):
                continue
            _set_kind(proposal, stream, name, table.columns[name])
            break
    if "throttle" in proposal.tables:
        table = proposal.tables["throttle"]
        for _, gate in _candidates([table], "gate"):
            if np.isin(table.columns[gate], (0.0, 1.0)).all():
                proposal.settings["throttle"]["gate"] = gate
                proposal.evidence.append(f"throttle: gate = {gate!r}: it is 0 or 1")
                break


def _set_kind(proposal: Proposal, stream: str, name: str, values: FloatArray) -> None:
    """Set the kind of a command from its name and its values."""
    largest = float(np.nanmax(np.abs(values)))
    settings = proposal.settings[stream]
    column = proposal.columns[stream]["value"]
    low = name.lower()

    def replace(**changes: object) -> None:
        proposal.columns[stream]["value"] = msgspec.structs.replace(column, **changes)

    if largest > MIN_PULSE:
        # The usual range, or the next larger one that has all pulses.
        reach = PULSE_STEP * math.ceil(float(np.nanmax(np.abs(values - NEUTRAL))) / PULSE_STEP)
        settings |= {"kind": "pulse", "full_scale": max(reach, USUAL_REACH) / 1e6}
        replace(unit="us", zero=NEUTRAL)
        proposal.questions.append(f"{stream}: pulses up to {largest:.0f} us; which one is neutral "
                                  "(zero), and what is half their range (full_scale)?")
    elif column.unit == "%" and largest <= 100.0 * COMMAND_TOLERANCE:
        proposal.evidence.append(f"{stream}: up to {largest:g} %")
    elif stream == "steering" and (largest > COMMAND_TOLERANCE or (
            re.search(r"angle|delta|rad|deg", low) and "user/" not in low)):
        degrees = column.unit == "deg" or largest > MAX_STEERING_ANGLE
        replace(unit="deg" if degrees else "rad")
        full = largest * UNITS["deg" if degrees else "rad"]
        settings |= {"kind": "angle", "full_scale": math.ceil(1e4 * full) / 1e4}
        proposal.questions.append(f"steering: angles up to {full:.3f} rad; what is the largest "
                                  "steering angle of the car (full_scale)?")
    elif stream == "throttle" and re.search(r"speed|vel", low):
        settings["kind"] = "speed"
        replace(unit="m/s" if column.unit == "1" else column.unit)
    elif largest > COMMAND_TOLERANCE:
        replace(unit="%")
        proposal.questions.append(f"{stream}: values up to {largest:g}; are they per cent?")
    if stream == "throttle" and settings.get("kind", "duty") == "duty":
        proposal.questions.append("throttle: is it the voltage share of the motor (kind duty), or "
                                  "the speed that a controller holds (kind speed)?")


def _add_sensors(proposal: Proposal, tables: Sequence[Table]) -> None:
    """Find encoder, gyro and accelerometer by name; then by the motion of the poses."""
    used = {c.column for columns in proposal.columns.values() for c in columns.values()}

    def is_measured(name: str) -> bool:
        return not COMMAND.search(name) and "duty" not in name

    for stream, roles in (("encoder", {"speed": "speed"}), ("gyro", {"yaw_rate": "yaw_rate"}),
                          ("accelerometer", {"x": "accel_x", "y": "accel_y"})):
        first, *others = roles.items()
        # The twist of a particle filter is no sensor: another topic has the odometry.
        for table, name in _candidates(tables, first[1], is_measured,
                                       proposal.tables.get("poses")):
            columns = {first[0]: _column(name, stream, first[0])}
            for key, role in others:
                match = next((n for _, n in _candidates([table], role, is_measured)), None)
                if match is not None:
                    columns[key] = _column(match, stream, key)
            if name in used or len(columns) < len(roles):
                continue
            if _with_time(proposal, stream, table, columns, "by their names" if others
                          else "by its name"):
                _set_changes(proposal, stream, table, name)
                break
        else:
            if stream != "accelerometer":
                _search_sensor(proposal, stream, first[0], used)


def _add_battery(proposal: Proposal, tables: Sequence[Table]) -> None:
    """Find the voltage of the battery by name, and its unit by its size."""
    low, high = MOTOR_VOLTAGE_RANGE
    for table, name in _candidates(tables, "voltage"):
        if NOT_OF_THE_PACK.search(name.lower()):
            continue
        middle = float(np.nanmedian(table.columns[name]))
        unit = next((u for u in ("V", "mV") if low <= UNITS[u] * middle <= high), None)
        if unit is not None and _with_time(proposal, "battery", table,
                                           {"voltage": Column(column=name, unit=unit)},
                                           f"by its name; its median is {middle:.4g} {unit}"):
            return


def _set_changes(proposal: Proposal, stream: str, table: Table, name: str) -> None:
    """Recognise values that a log repeats until the next message, by a second time column."""
    time = proposal.settings[stream]["time"]
    values = table.columns[name]
    repeats = float((np.diff(values) == 0.0).mean())
    for _, other in _candidates([table], "time"):
        marks = table.columns[other]
        held = np.diff(marks) == 0.0
        if not isinstance(time, Column) or other == time.column:
            continue
        if MIN_REPEATED_SHARE < held.mean() < repeats + 0.05:
            proposal.settings[stream]["changes"] = other
            proposal.evidence.append(f"{stream}: changes = {other!r}: {held.mean():.0%} of the "
                                     "rows repeat it")
            return


def _search_sensor(proposal: Proposal, stream: str, key: str, used: set[str]) -> None:
    """Find a sensor by the motion of the poses, in their table."""
    if "poses" not in proposal.columns:
        return
    table = proposal.tables["poses"]
    time = proposal.settings["poses"]["time"]
    if not isinstance(time, Column):
        return
    t = table.columns[time.column] * UNITS[time.unit]
    at = np.arange(float(np.nanmin(t)), float(np.nanmax(t)), GRID_STEP)
    x, y, yaw = (np.interp(at, t, table.columns[proposal.columns["poses"][k].column])
                 for k in ("x", "y", "yaw"))
    motion = (np.hypot(np.gradient(x), np.gradient(y)) if stream == "encoder"
              else np.gradient(np.unwrap(yaw)))
    best = ("", 0.0)
    for name, values in table.columns.items():
        if name in used | {time.column} or not _varies(values):
            continue
        found = _correlate(np.interp(at, t, np.nan_to_num(values)), motion)
        best = (name, found) if abs(found) > abs(best[1]) else best
    if abs(best[1]) > MIN_AGREEMENT:
        what = "speed" if stream == "encoder" else "yaw rate"
        _with_time(proposal, stream, table, {key: Column(column=best[0])},
                   f"it follows the {what} of the poses (correlation {best[1]:.2f})")


def _correlate(x: FloatArray, y: FloatArray) -> float:
    found = float(np.corrcoef(x, y)[0, 1])
    return found if np.isfinite(found) else 0.0


def _apply_checks(proposal: Proposal, tables: Sequence[Table]) -> None:
    """Change the map until the streams agree with each other."""
    for _ in range(MAX_CHANGES):
        try:
            findings = check_data(convert_tables(tables, proposal.build()))
        except RecordingError as why:
            proposal.questions.append(f"{why.what}: {why.remedy}")
            return
        change = next((f for f in findings if f.change is not None), None)
        if change is None or change.change is None:
            proposal.evidence += [f"{f.what}: {f.text}" for f in findings if not f.remedy]
            proposal.questions += [str(f) for f in findings if f.remedy]
            return
        _change(proposal, change.change)
        proposal.evidence.append(f"{change.what}: {change.text}, so {change.remedy}")


def _change(proposal: Proposal, change: Change) -> None:
    """Apply the change of a finding."""
    stream, key, attribute, value = change
    columns = proposal.columns[stream]
    if attribute == "exchange":
        columns[key], columns[str(value)] = columns[str(value)], columns[key]
        return
    if attribute == "turn":
        columns |= {"x": columns["y"], "y": columns["x"]}
        attribute = "sign"
    column = columns[key]
    if attribute == "sign":
        value = -column.sign
    elif attribute == "zero":  # the finding states it in rad
        value = column.zero + float(value) / UNITS[column.unit] / column.sign
    columns[key] = msgspec.structs.replace(column, **{attribute: value})


def format_map(mapping: ImportMap, evidence: Sequence[str] = (), questions: Sequence[str] = ()
               ) -> str:
    """Return a map as TOML text, with evidence and questions as comments."""
    lines = [f"# {line}" for line in evidence]
    lines += [f"# TO ANSWER: {line}" for line in questions]
    lines += [f'schema = "{mapping.schema}"', f'name = "{mapping.name}"']
    lines += [] if mapping.time is None else [f"time = {_format_value(mapping.time)}"]
    for name in MAP_STREAMS:
        stream = getattr(mapping, name)
        if stream is None:
            continue
        lines += ["", f"[{name}]"]
        for key in stream.__struct_fields__:
            value = getattr(stream, key)
            if value is None or (key == "delay" and value == 0.0):
                continue
            lines.append(f"{key} = {_format_value(value)}")
    return "\n".join(lines) + "\n"


def _format_value(value: object) -> str:
    if isinstance(value, str):
        return _quote(value)
    if isinstance(value, Column):
        column = column_of(value)
        defaults = Column(column=column.column)
        parts = [f"{key} = {_format_value(getattr(column, key))}"
                 for key in column.__struct_fields__
                 if key == "column" or getattr(column, key) != getattr(defaults, key)]
        return _quote(column.column) if len(parts) == 1 else "{" + ", ".join(parts) + "}"
    return repr(value)


def _quote(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
