"""Two runs side by side: what was driven, what came of it, what differs, and from when on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dart_hal.car.table import RunTable, read_table
from dart_hal.core.config.parse import decode
from dart_hal.core.errors import ConfigError
from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import BoolArray, FloatArray

CHANNELS = ("speed", "yaw_rate", "steering", "throttle", "command_steering", "command_throttle")
SAME_COMMAND = {"command_steering": 0.01, "command_throttle": 0.01}
"""rad and -1..1: commands closer than this are the same, whatever the phase of the two loops."""
APART = {"speed": 0.05, "yaw_rate": 0.1}
"""m/s and rad/s: the least that counts as a difference of two drives. For the speed three
common sigmas where they are more; the gyro states none."""
LASTING = 5
"""Rows, 50 ms, for which a difference must last: one row is the jitter of a loop's answer."""
FIRMWARE = ("firmware", "git", "schema", "proto", "board_id", "bootloader", "edges_per_rev", "caps")


class Differs(NamedTuple):
    """A fact that is another in the two runs; None: not in that one."""

    name: str
    a: Any
    b: Any


class Moment(NamedTuple):
    """When two runs part: s since the first command, the channel, and both values there."""

    t: float
    channel: str
    a: float
    b: float


@dataclass(frozen=True, slots=True)
class Comparison:
    """Of two runs. same_commands: s from the first command on for which both were driven alike,
    None where one was not driven; parted: the first difference within that time, None: none."""

    a: RunTable
    b: RunTable
    differs: tuple[Differs, ...]
    same_commands: float | None
    parted: Moment | None

    def to_json(self) -> dict[str, Any]:
        """The object of ``dart-hal compare --json``."""
        return {"runs": [_facts(table) for table in (self.a, self.b)],
                "statistics": {name: [statistics(t.columns[name]) for t in (self.a, self.b)]
                               for name in self.channels},
                "differs": [d._asdict() for d in self.differs],
                "same_commands_s": self.same_commands,
                "parted": self.parted and self.parted._asdict()}

    @property
    def channels(self) -> list[str]:
        """What both have: the six of ``CHANNELS``, and what both programs logged."""
        logged = [n for n in self.a.columns if n.startswith("log/") and n in self.b.columns]
        return [*CHANNELS, *logged]


def compare(a: Path, b: Path) -> Comparison:
    """Read and compare two runs. Errors: as ``read_table``."""
    one, other = read_table(a), read_table(b)
    same = parted = None
    drives = driven(one), driven(other)
    if drives[0] is not None and drives[1] is not None:
        same, parted = _parting(drives[0], drives[1])
    return Comparison(one, other, tuple(_differences(one, other)), same, parted)


def statistics(values: FloatArray) -> dict[str, float]:
    """n of the values that are there, and their mean, standard deviation, least and largest."""
    there = values[np.isfinite(values)]
    if not len(there):
        return {"n": 0}
    return {"n": len(there), "mean": float(there.mean()), "std": float(there.std()),
            "min": float(there.min()), "max": float(there.max())}


def driven(table: RunTable) -> dict[str, FloatArray] | None:
    """Channels each 10 ms from the first command on, commands held; None: there was none."""
    commands = list(table.run.commands())
    t = table.columns["t"]
    if not commands or len(t) < 2 or commands[0].t >= t[-1]:
        return None
    grid = np.arange(commands[0].t, t[-1], SAMPLE)
    newest = np.searchsorted([c.t for c in commands], grid, side="right") - 1
    out = {"t": grid - grid[0],
           "command_steering": np.array([c.steering for c in commands])[newest],
           "command_throttle": np.array([c.throttle for c in commands])[newest]}
    return out | {name: np.interp(grid, t, table.columns[name])
                  for name in ("speed", "speed_std", "yaw_rate")}


def _parting(a: Mapping[str, FloatArray], b: Mapping[str, FloatArray]
             ) -> tuple[float, Moment | None]:
    """How long the commands were the same, and what differed first within that time."""
    n = min(len(a["t"]), len(b["t"]))
    other = np.zeros(n, dtype=bool)
    for name, least in SAME_COMMAND.items():
        other |= ~(np.abs(a[name][:n] - b[name][:n]) <= least)
    alike = _lasting(other)
    end = n if alike is None else alike
    sigmas = 3.0 * np.hypot(a["speed_std"][:end], b["speed_std"][:end])
    found = []
    for name, least in APART.items():
        reach = np.maximum(least, sigmas) if name == "speed" else least
        at = _lasting(np.abs(a[name][:end] - b[name][:end]) > reach)
        if at is not None:
            found.append(Moment(float(a["t"][at]), name, float(a[name][at]), float(b[name][at])))
    return end * SAMPLE, min(found, default=None)


def _lasting(apart: BoolArray) -> int | None:
    """Where the first stretch of at least ``LASTING`` rows begins."""
    if len(apart) < LASTING:
        return None
    runs = np.lib.stride_tricks.sliding_window_view(apart, LASTING).all(axis=1)
    return int(np.argmax(runs)) if runs.any() else None


def _facts(table: RunTable) -> dict[str, Any]:
    t, speed = table.columns["t"], table.columns["speed"]
    lost, frames = int(table.columns["lost"][-1]), len(table)
    return {"path": table.run.path, "car": table.run.meta.get("car", ""),
            "url": table.run.meta.get("url", ""), "firmware": table.hello.as_json()["firmware"],
            "duration_s": float(t[-1] - t[0]), "frames": frames, "lost": lost,
            "lost_share": lost / (lost + frames), "damaged": table.damaged,
            "distance_m": float(np.sum(np.abs(speed[1:]) * np.diff(t)))}


def _differences(a: RunTable, b: RunTable) -> Iterator[Differs]:
    """Car and URL, firmware, and every key of the car's files."""
    one, other = ({**{k: t.run.meta.get(k) for k in ("car", "url")},
                   **{f"firmware.{k}": t.hello.as_json()[k] for k in FIRMWARE},
                   **dict(_keys(t))} for t in (a, b))
    for name in {**one, **other}:
        if one.get(name) != other.get(name):
            yield Differs(name, one.get(name), other.get(name))


def _keys(table: RunTable) -> Iterator[tuple[str, Any]]:
    """"calibration.pwm.oscillator_hz" and so on, with its value."""
    for file, text in table.run.files.items():
        try:
            yield from _flat(Path(file).stem, decode(text, file))
        except ConfigError:  # then the text itself is what can be compared
            yield file, text


def _flat(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping) and value:
        for key, inner in value.items():
            yield from _flat(f"{name}.{key}", inner)
    else:
        yield name, value
