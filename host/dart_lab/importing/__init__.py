"""Import of recordings of other systems: read tables, map their columns, check, write one file.

1. ``read_tables`` reads CSV files, ROS bags, MCAP files and LeRobot data sets as tables of columns.
2. ``load_map`` reads which column is which quantity, in which unit; ``guess_map`` proposes it.
3. ``convert_tables`` applies a map to tables, and gives streams in SI units.
4. ``check_data`` compares the streams with each other: signs, units, clocks.
"""

from __future__ import annotations

from .checks import ImportFinding, check_data
from .convert import convert_tables
from .guess import guess_map
from .maps import ImportMap, list_shipped_maps, load_map
from .tables import Table, read_tables, table_from_frame

__all__ = [
    "ImportFinding",
    "ImportMap",
    "Table",
    "check_data",
    "convert_tables",
    "guess_map",
    "list_shipped_maps",
    "load_map",
    "read_tables",
    "table_from_frame",
]
