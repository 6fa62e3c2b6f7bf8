"""States and events of the host side, and the table that connects them.

Every cell of the table is written down: a state to go to, or "." for an event
that this state ignores. Missing or misspelt cells fail when it is imported.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from dart_hal.devices.actuation.plan import LIVE, RAW, Output


class ArmState(str, Enum):
    """States of the host side."""

    CLOSED = "CLOSED"
    OPENING = "OPENING"
    DISARMED = "DISARMED"
    ARMING = "ARMING"
    ARMED = "ARMED"
    TRIPPED = "TRIPPED"
    LOCKED = "LOCKED"
    RAW = "RAW"
    FAULT = "FAULT"


class Event(str, Enum):
    """What can happen to the host side."""

    OPEN = "OPEN"
    OPENED = "OPENED"
    OPEN_FAILED = "OPEN_FAILED"
    CLOSE = "CLOSE"
    ARM = "ARM"
    REFUSED = "REFUSED"
    CHECKED = "CHECKED"
    STOP = "STOP"
    REBOOT = "REBOOT"
    TRIP = "TRIP"
    THIRD_TRIP = "THIRD_TRIP"
    CLEARED = "CLEARED"
    UNLOCK = "UNLOCK"
    RAW_OPEN = "RAW_OPEN"
    RAW_CLOSE = "RAW_CLOSE"
    RAW_TIMEOUT = "RAW_TIMEOUT"
    BUS_LOST = "BUS_LOST"
    BUS_BACK = "BUS_BACK"
    OPENED_LOCKED = "OPENED_LOCKED"


GRID = """
              CLOSED   OPENING   DISARMED ARMING   ARMED    TRIPPED  LOCKED   RAW      FAULT
OPEN          OPENING  .         .        .        .        .        .        .        OPENING
OPENED        .        DISARMED  .        .        .        .        .        .        .
OPENED_LOCKED .        LOCKED    .        .        .        .        .        .        .
OPEN_FAILED   .        FAULT     .        .        .        .        .        .        .
CLOSE         .        CLOSED    CLOSED   CLOSED   CLOSED   CLOSED   CLOSED   CLOSED   CLOSED
ARM           .        .         ARMING   .        .        .        .        .        .
REFUSED       .        .         .        DISARMED .        .        .        .        .
CHECKED       .        .         .        ARMED    .        .        .        .        .
STOP          .        .         .        DISARMED DISARMED .        .        DISARMED .
REBOOT        .        .         .        DISARMED DISARMED .        .        DISARMED .
TRIP          .        .         .        DISARMED TRIPPED  .        .        DISARMED .
THIRD_TRIP    .        .         LOCKED   LOCKED   LOCKED   LOCKED   .        LOCKED   .
CLEARED       .        .         .        .        .        DISARMED .        .        .
UNLOCK        .        .         .        .        .        .        DISARMED .        .
RAW_OPEN      .        .         RAW      .        .        .        .        .        .
RAW_CLOSE     .        .         .        .        .        .        .        DISARMED .
RAW_TIMEOUT   .        .         .        .        .        .        .        DISARMED .
BUS_LOST      .        FAULT     FAULT    FAULT    FAULT    FAULT    FAULT    FAULT    .
BUS_BACK      .        .         .        .        .        .        .        .        OPENING
"""


@dataclass(frozen=True, slots=True)
class Entry:
    """What a state means: the pins, and the mode of the heartbeat to the Nano."""

    output: Output
    beat: str


ENTRY: dict[ArmState, Entry] = {
    ArmState.CLOSED: Entry(Output("untouched", "untouched"), "STOP"),
    ArmState.OPENING: Entry(Output("untouched", "untouched"), "DISARMED"),
    ArmState.DISARMED: Entry(Output("neutral", "centre"), "DISARMED"),
    ArmState.ARMING: Entry(Output("neutral", "centre"), "DISARMED"),
    ArmState.ARMED: Entry(LIVE, "ARMED"),
    ArmState.TRIPPED: Entry(Output("neutral", "held"), "DISARMED"),
    ArmState.LOCKED: Entry(Output("neutral", "held"), "STOP"),
    ArmState.RAW: Entry(RAW, "RAW"),
    ArmState.FAULT: Entry(Output("neutral", "held"), "STOP"),
}
"""OPENING is untouched by frames: ``Actuator.open`` writes its own sequence."""


def read_grid(grid: str) -> dict[ArmState, dict[Event, ArmState]]:
    """The table of a grid; an ignored event leads back to its own state.

    Raises AssertionError unless every state and every event is there, each
    once, with a cell for every pair.
    """
    head, *rows = [line.split() for line in grid.strip().splitlines()]
    columns, names = [ArmState(name) for name in head], [row[0] for row in rows]
    if sorted(columns) != sorted(ArmState) or sorted(names) != sorted(Event):
        raise AssertionError("the grid does not name every state and every event once")
    if any(len(row) != len(columns) + 1 for row in rows):
        raise AssertionError("a row of the grid has not one cell for each state")
    return {state: {Event(row[0]): state if row[k + 1] == "." else ArmState(row[k + 1])
                    for row in rows} for k, state in enumerate(columns)}


def check_table(table: dict[ArmState, dict[Event, ArmState]]) -> None:
    """The laws of the table. Raises AssertionError.

    The throttle obeys commands in ARMED alone, ARMED is entered through CHECKED
    alone, every state can be closed, and where the bus is lost the state says so:
    without it nobody knows what the pins carry.
    """
    lost = {s for s, row in table.items() if row[Event.BUS_LOST] is ArmState.FAULT}
    if lost != set(ArmState) - {ArmState.CLOSED}:
        raise AssertionError("a state hides that the bus is lost")
    live = {s for s, e in ENTRY.items() if e.output.throttle == "command"}
    into = {(s, e) for s, row in table.items() for e, to in row.items()
            if to is ArmState.ARMED and s is not ArmState.ARMED}
    if live != {ArmState.ARMED} or into != {(ArmState.ARMING, Event.CHECKED)}:
        raise AssertionError("the throttle is live elsewhere than in ARMED, after CHECKED")
    if {row[Event.CLOSE] for row in table.values()} != {ArmState.CLOSED}:
        raise AssertionError("a state cannot be closed")
    if set(ENTRY) != set(ArmState):
        raise AssertionError("a state has no entry output")


TABLE = read_grid(GRID)
check_table(TABLE)
