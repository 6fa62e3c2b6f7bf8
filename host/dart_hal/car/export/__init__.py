"""A run for other programs: tables, ROS bags, a LeRobot data set."""

from __future__ import annotations

from dart_hal.car.export.tables import write_csv as write_csv
from dart_hal.car.export.tables import write_parquet as write_parquet
