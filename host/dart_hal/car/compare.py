"""Comparison of two runs: facts that differ, and when their motion diverges."""

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

# Columns of a run of which the statistics are compared.
COMPARED_CHANNELS = ("speed", "yaw_rate", "steering", "throttle", "command_steering",
                     "command_throttle")
# rad and -1..1: up to this difference two commands count as the same. The loops of two runs have
# different phases.
MAX_COMMAND_DIFFERENCE = {"command_steering": 0.01, "command_throttle": 0.01}
# m/s and rad/s: smallest difference between two runs. For the speed three common standard errors,
# where they are larger; the gyro states none.
MIN_DIFFERENCE = {"speed": 0.05, "yaw_rate": 0.1}
# Rows of 10 ms for which a difference must last: a single row is jitter of a control loop.
MIN_DIFFERENT_ROWS = 5
# Fields of HELLO that are compared.
FIRMWARE_FACTS = ("firmware", "git", "schema", "proto", "board_id", "bootloader", "edges_per_rev",
                  "caps")


class Difference(NamedTuple):
    """A fact that differs between two runs; None: that run does not have it."""

    name: str
    a: Any
    b: Any


class Divergence(NamedTuple):
    """The moment t [s] after the first command when two runs diverge, the channel, both values."""

    t: float
    channel: str
    a: float
    b: float


@dataclass(frozen=True, slots=True)
class Comparison:
    """Comparison of runs a and b.

    same_commands: time [s] from the first command on with equal commands, None where one run has
    no command. parted: first difference of the motion within that time, None: there is none.
    """

    a: RunTable
    b: RunTable
    differs: tuple[Difference, ...]
    same_commands: float | None
    parted: Divergence | None

    def to_json(self) -> dict[str, Any]:
        """Return the object of ``dart-hal compare --json``."""
        return {"runs": [_facts(table) for table in (self.a, self.b)],
                "statistics": {name: [statistics(t.columns[name]) for t in (self.a, self.b)]
                               for name in self.channels},
                "differs": [d._asdict() for d in self.differs],
                "same_commands_s": self.same_commands,
                "parted": self.parted and self.parted._asdict()}

    @property
    def channels(self) -> list[str]:
        """Return the names of ``COMPARED_CHANNELS`` and of what both programs logged."""
        logged = [n for n in self.a.columns if n.startswith("log/") and n in self.b.columns]
        return [*COMPARED_CHANNELS, *logged]


def compare(a: Path, b: Path) -> Comparison:
    """Read and compare two runs. Raises as ``read_table``."""
    one, other = read_table(a), read_table(b)
    same = parted = None
    drives = resample_from_first_command(one), resample_from_first_command(other)
    if drives[0] is not None and drives[1] is not None:
        same, parted = _find_divergence(drives[0], drives[1])
    return Comparison(one, other, tuple(_differences(one, other)), same, parted)


def statistics(values: FloatArray) -> dict[str, float]:
    """Return number, mean, standard deviation, minimum and maximum of the finite values."""
    there = values[np.isfinite(values)]
    if not len(there):
        return {"n": 0}
    return {"n": len(there), "mean": float(there.mean()), "std": float(there.std()),
            "min": float(there.min()), "max": float(there.max())}


def resample_from_first_command(table: RunTable) -> dict[str, FloatArray] | None:
    """Resample a run each 10 ms from its first command on; commands by zero-order hold.

    Returns arrays (n,) by channel; None: the run has no command.
    """
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


def _find_divergence(a: Mapping[str, FloatArray], b: Mapping[str, FloatArray]
             ) -> tuple[float, Divergence | None]:
    """Find how long the commands are the same, and the first difference of the motion until then.

    1. The commands are the same until a difference lasts for MIN_DIFFERENT_ROWS.
    2. Until then, a channel differs where the difference exceeds MIN_DIFFERENCE, for the
       speed also three standard errors of the difference, for MIN_DIFFERENT_ROWS.
    3. The channel that differs first is the divergence.
    """
    n = min(len(a["t"]), len(b["t"]))
    commands_differ = np.zeros(n, dtype=bool)
    for name, least in MAX_COMMAND_DIFFERENCE.items():
        commands_differ |= ~(np.abs(a[name][:n] - b[name][:n]) <= least)
    parting = _first_lasting(commands_differ)
    end = n if parting is None else parting
    # The speeds differ significantly beyond three standard errors of their difference.
    sigmas = 3.0 * np.hypot(a["speed_std"][:end], b["speed_std"][:end])
    found = []
    for name, least in MIN_DIFFERENCE.items():
        reach = np.maximum(least, sigmas) if name == "speed" else least
        row = _first_lasting(np.abs(a[name][:end] - b[name][:end]) > reach)
        if row is not None:
            values = float(a[name][row]), float(b[name][row])
            found.append(Divergence(float(a["t"][row]), name, *values))
    return end * SAMPLE, min(found, default=None)


def _first_lasting(differs: BoolArray) -> int | None:
    """Return where the first stretch of at least ``MIN_DIFFERENT_ROWS`` True rows begins."""
    if len(differs) < MIN_DIFFERENT_ROWS:
        return None
    runs = np.lib.stride_tricks.sliding_window_view(differs, MIN_DIFFERENT_ROWS).all(axis=1)
    return int(np.argmax(runs)) if runs.any() else None


def _facts(table: RunTable) -> dict[str, Any]:
    """Return the facts of one run for ``Comparison.to_json``."""
    t = table.columns["t"]
    speed = table.columns["speed"]
    lost = int(table.columns["lost"][-1])
    frames = len(table)
    return {"path": table.run.path, "car": table.run.meta.get("car", ""),
            "url": table.run.meta.get("url", ""), "firmware": table.hello.as_json()["firmware"],
            "duration_s": float(t[-1] - t[0]), "frames": frames, "lost": lost,
            "lost_share": lost / (lost + frames), "damaged": table.damaged,
            "distance_m": float(np.sum(np.abs(speed[1:]) * np.diff(t)))}


def _differences(a: RunTable, b: RunTable) -> Iterator[Difference]:
    """Yield what differs in car, URL, firmware, and every key of the car's files."""
    one, other = ({**{k: t.run.meta.get(k) for k in ("car", "url")},
                   **{f"firmware.{k}": t.hello.as_json()[k] for k in FIRMWARE_FACTS},
                   **dict(_keys(t))} for t in (a, b))
    for name in {**one, **other}:
        if one.get(name) != other.get(name):
            yield Difference(name, one.get(name), other.get(name))


def _keys(table: RunTable) -> Iterator[tuple[str, Any]]:
    """Yield each key of the car's files, such as "calibration.pwm.oscillator_hz", and its value."""
    for file, text in table.run.files.items():
        try:
            yield from _flat(Path(file).stem, decode(text, file))
        except ConfigError:  # then the text itself is what can be compared
            yield file, text


def _flat(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield nested keys, joined by dots, with their values."""
    if isinstance(value, Mapping) and value:
        for key, inner in value.items():
            yield from _flat(f"{name}.{key}", inner)
    else:
        yield name, value
