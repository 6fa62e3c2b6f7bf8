"""Along a bare corridor nothing is measured but by the wheels, however it lies in the map."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dart_hal.estimation.localisation import field
from dart_hal.estimation.localisation.localiser import Localiser
from dart_lab.sim.lidar.maps import room_of
from studies.localisation.world import DT, draw_in_cells, drive_along, hidden, run

LENGTH = 40.0
WIDTH = 2.0
TRAVEL = 16.0


def drive_corridor(turn, cell, seed):
    """Return (error along [m], stated standard error [m], NEES) of a drive in the middle part."""
    c, s = np.cos(turn), np.sin(turn)
    corners = np.array(((0.0, 0.0), (LENGTH, 0.0), (LENGTH, WIDTH), (0.0, WIDTH)))
    corners = corners @ np.array(((c, s), (-s, c)))
    lines = np.hstack((corners, np.roll(corners, -1, axis=0)))
    rng = np.random.default_rng([seed, 1])
    hid = hidden(seed, speed=1.0, seconds=TRAVEL, stale=0, other=False, noise=0.015)
    travelled = np.arange(int(TRAVEL / DT)) * DT
    x, y = 12.0 + travelled, 1.0 + 0.2 * np.sin(0.7 * travelled)
    course = np.arctan2(np.gradient(y), np.gradient(x))
    bend = np.gradient(course) / np.hypot(np.gradient(x), np.gradient(y))
    way = np.column_stack((c * x - s * y, s * x + c * y, course + turn, bend))
    room = replace(room_of("room", 1), lines=lines, glass=np.empty((0, 4)))
    drive = drive_along(room, way, hid, rng, seed)
    chart = (field.map_of_lines(lines) if cell is None
             else field.map_of_grid(draw_in_cells(lines, cell, rng)))
    start = tuple(drive.true(float(drive.scans[0].t[-1]) - 0.01).tolist())
    result = run(replace(drive, chart=chart), localiser=Localiser(chart, start))
    last = [located for located in result.told if located and located.pose][-1]
    along = np.array((c, s))
    error = (np.array((last.pose.x, last.pose.y)) - drive.true(last.t)[:2]) @ along
    return error, float(np.sqrt(along @ last.pose.cov[:2, :2] @ along)), result.nees.mean()


@pytest.mark.slow
@pytest.mark.parametrize(("turn", "cell"), [(0.03, None), (0.35, None), (0.35, 0.02)])
def test_the_error_along_an_oblique_corridor_is_that_of_the_wheels(turn, cell):
    error, std, nees = drive_corridor(turn, cell, 1)
    assert abs(error) < 0.15
    assert std > 0.1
    assert nees < 2.0


@pytest.mark.slow
def test_control_ripples_of_the_map_are_taken_for_a_measurement(monkeypatch):
    monkeypatch.setattr(field, "STRAIGHT_RATIO", -1.0)
    monkeypatch.setattr(field, "CORNER_RATIO", -0.5)
    error, std, nees = drive_corridor(0.35, None, 1)
    assert std < 0.02
    assert abs(error) > 5.0 * std
    assert nees > 50.0
