"""All rows, in the order of their numbers."""

from __future__ import annotations

from dataclasses import replace

from fault_table import (
    rows_fleet,
    rows_inputs,
    rows_nano,
    rows_neutral,
    rows_owner,
    rows_pins,
    rows_processes,
    rows_sensors,
    rows_soak,
    rows_suspend,
    rows_virtual,
    rows_wire,
    switches,
    switches_nano,
)
from fault_table.layers import LAYERS
from fault_table.row import Row

__all__ = ["LAYERS", "ROWS", "switches", "switches_nano"]

ROOMS = (rows_wire, rows_sensors, rows_nano, rows_owner, rows_pins, rows_processes,
         rows_soak, rows_fleet, rows_inputs, rows_neutral, rows_suspend, rows_virtual)


def join_rows() -> tuple[Row, ...]:
    """Cases of one number from several rooms become one row."""
    rows: dict[int, Row] = {}
    for room in ROOMS:
        for row in room.ROWS:
            known = rows.get(row.number)
            rows[row.number] = row if known is None else replace(
                known, cases=(*known.cases, *row.cases))
    return tuple(rows[number] for number in sorted(rows))


ROWS = join_rows()
