"""Drives that are no map are refused in words; the control is the drive as it was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.core.errors import UsageError
from dart_hal.estimation.mapping.checks import MapChecks
from studies.localisation.world import drive, hidden


@pytest.fixture(scope="module")
def right():
    return drive(2003, hidden(2003, seconds=8.0, speed=2.0))


def check_scans(found, change=lambda scan: scan, way=10.0):
    checks = MapChecks()
    for scan in found.scans:
        checks.add(change(scan), float(np.interp(scan.arrival, found.t, found.told[:, 2])))
    checks.judge(way)
    return checks


def upside_down(scan):
    return replace(scan, angle=(-scan.angle.astype(float)) % (2.0 * np.pi))


def drop_sector(degrees):
    def change(scan):
        return replace(scan, distance=np.where(np.abs(scan.bearing - 1.0) < np.radians(
            0.5 * degrees), np.nan, scan.distance))
    return change


def test_a_drive_as_it_should_be_is_not_refused(right):
    assert not check_scans(right).is_sense_unknown
    check_scans(right, drop_sector(20.0))


@pytest.mark.parametrize(("change", "way", "message"), [
    (upside_down, 10.0, "turn against the gyro"),
    (drop_sector(45.0), 10.0, "a sector of the lidar is blind"),
    (lambda scan: scan, 0.4, "did not move")], ids=["mirrored", "sector", "still"])
def test_what_is_no_map_is_refused(right, change, way, message):
    with pytest.raises(UsageError, match=message):
        check_scans(right, change, way)


def test_no_scan_is_no_map():
    with pytest.raises(UsageError, match="nothing to map"):
        MapChecks().judge(10.0)
