"""States and events of the host's supervisor, and the table of its transitions.

Every cell of the table is written down: the next state, or "." for an event that this state
ignores. Missing or misspelt cells raise on import.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from dart_hal.devices.actuation.plan import LIVE_DEMAND, RAW_DEMAND, PinDemand


class ArmState(str, Enum):
    """States of the host's supervisor."""

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
    """Inputs of the host's supervisor."""

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
    """Outputs of a state: the demand on the pins, and the mode of the heartbeat to the Nano."""

    output: PinDemand
    beat: str


# OPENING leaves the pins untouched by frames: ``Actuator.open`` writes its own sequence.
ENTRY: dict[ArmState, Entry] = {
    ArmState.CLOSED: Entry(PinDemand("untouched", "untouched"), "STOP"),
    ArmState.OPENING: Entry(PinDemand("untouched", "untouched"), "DISARMED"),
    ArmState.DISARMED: Entry(PinDemand("neutral", "centre"), "DISARMED"),
    ArmState.ARMING: Entry(PinDemand("neutral", "centre"), "DISARMED"),
    ArmState.ARMED: Entry(LIVE_DEMAND, "ARMED"),
    ArmState.TRIPPED: Entry(PinDemand("neutral", "held"), "DISARMED"),
    ArmState.LOCKED: Entry(PinDemand("neutral", "held"), "STOP"),
    ArmState.RAW: Entry(RAW_DEMAND, "RAW"),
    ArmState.FAULT: Entry(PinDemand("neutral", "held"), "STOP"),
}


def read_grid(grid: str) -> dict[ArmState, dict[Event, ArmState]]:
    """Parse the table: by state and event, the next state; an ignored event keeps the state.

    Raises AssertionError unless every state and every event is there, each once, with a cell for
    every pair.
    """
    head, *rows = [line.split() for line in grid.strip().splitlines()]
    columns = [ArmState(name) for name in head]
    names = [row[0] for row in rows]
    if sorted(columns) != sorted(ArmState) or sorted(names) != sorted(Event):
        raise AssertionError("the grid does not name every state and every event once")
    if any(len(row) != len(columns) + 1 for row in rows):
        raise AssertionError("a row of the grid has not one cell for each state")
    return {state: {Event(row[0]): state if row[k + 1] == "." else ArmState(row[k + 1])
                    for row in rows} for k, state in enumerate(columns)}


def check_table(table: dict[ArmState, dict[Event, ArmState]]) -> None:
    """Check the safety rules of the table. Raises AssertionError."""
    # 1. A lost bus always leads to FAULT: without the bus the pulses at the pins are unknown.
    lost = {s for s, row in table.items() if row[Event.BUS_LOST] is ArmState.FAULT}
    if lost != set(ArmState) - {ArmState.CLOSED}:
        raise AssertionError("a state hides that the bus is lost")
    # 2. Only ARMED lets commands set the throttle, and only ARMING with CHECKED leads there.
    live = {s for s, e in ENTRY.items() if e.output.throttle == "command"}
    into = {(s, e) for s, row in table.items() for e, target in row.items()
            if target is ArmState.ARMED and s is not ArmState.ARMED}
    if live != {ArmState.ARMED} or into != {(ArmState.ARMING, Event.CHECKED)}:
        raise AssertionError("the throttle is live elsewhere than in ARMED, after CHECKED")
    # 3. Every state can be closed.
    if {row[Event.CLOSE] for row in table.values()} != {ArmState.CLOSED}:
        raise AssertionError("a state cannot be closed")
    if set(ENTRY) != set(ArmState):
        raise AssertionError("a state has no entry output")


TABLE = read_grid(GRID)
check_table(TABLE)
