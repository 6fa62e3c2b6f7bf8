"""``dart-hal localize`` on a simulated car, on its recording in a ROS map, and in a bare room."""

from __future__ import annotations

import json

import numpy as np
import pytest

from dart_hal.cli.main import main
from dart_hal.estimation.localisation.field import NODE_SPACING
from dart_lab.sim.lidar.maps import box, room_of

WAIVED = ("--waive", "CALIBRATION_MISSING", "--waive", "PWM_CLOCK_UNCALIBRATED", "--json")


def run_verb(capsys, *args):
    """(exit code, JSON) of the verb."""
    with pytest.raises(SystemExit) as done:
        main(["localize", *map(str, args)])
    return done.value.code, json.loads(capsys.readouterr().out)


def ros_map(folder, lines, cell=NODE_SPACING):
    """A map_server map of lines [m], drawn at half the cell's spacing."""
    low = lines.reshape(-1, 2).min(axis=0) - 0.2
    size = np.ceil((lines.reshape(-1, 2).max(axis=0) + 0.2 - low) / cell).astype(int)
    shades = np.full(size[::-1], 254, np.uint8)
    for x1, y1, x2, y2 in lines:
        n = int(np.hypot(x2 - x1, y2 - y1) / (0.5 * cell)) + 2
        i, j = ((np.linspace((x1, y1), (x2, y2), n) - low) / cell).astype(int).T
        shades[j, i] = 0
    (folder / "room.pgm").write_bytes(b"P5 %d %d 255\n" % tuple(size) + shades[::-1].tobytes())
    path = folder / "room.yaml"
    path.write_text(f"image: room.pgm\nresolution: {cell}\norigin: [{low[0]}, {low[1]}, 0.0]\n"
                    "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n")
    return path


@pytest.mark.slow
def test_a_simulated_car_is_found_and_its_error_reported(capsys):
    code, found = run_verb(capsys, "--url", "sim://?seed=0&nano=mock&lidar=1&map=room",
                           "--duration", 2.0, "--speed", 1, "--steering", 0.3, *WAIVED)
    assert code == 0
    assert found["status"] == "TRACKING"
    assert found["error"]["rms_m"] < 0.01
    assert found["error"]["max_m"] < 0.03
    assert np.sqrt(found["pose"]["cov"][0][0]) < 0.01


@pytest.mark.slow
def test_a_car_in_a_ros_map_and_its_recording(capsys, tmp_path):
    """The simulated room is the grid itself."""
    chart = ros_map(tmp_path, room_of("room", 0).lines)
    run = tmp_path / "run.mcap"
    url = f"sim://?seed=0&nano=mock&lidar=1&map={chart}"
    code, found = run_verb(capsys, "--url", url, "--map", chart, "--duration", 3.0, "--speed", 1,
                           "--steering", 0.3, "--record", run, *WAIVED)
    assert (code, found["status"]) == (0, "TRACKING")
    code, again = run_verb(capsys, "--url", f"replay://{run}", "--map", chart, "--json")
    assert code == 0
    assert again["pose"]["x"] == pytest.approx(found["pose"]["x"], abs=0.01)


@pytest.mark.slow
def test_a_bare_rectangle_is_reported_and_exits_1(capsys, tmp_path):
    chart = ros_map(tmp_path, box(3.0, 2.5, 0.0, 6.0, 5.0), 0.05)
    code, found = run_verb(capsys, "--url", f"sim://?seed=0&nano=mock&lidar=1&map={chart}", "--map",
                           chart, "--duration", 0.6, "--json")
    assert code == 1
    assert found["status"] == "AMBIGUOUS"
    assert found["pose"] is None
    assert "--start" in found["why"]


@pytest.mark.slow
def test_a_map_of_another_room_is_doubted(capsys, tmp_path):
    chart = ros_map(tmp_path, box(1.5, 1.25, 0.0, 3.0, 2.5), 0.05)
    code, found = run_verb(capsys, "--url", "sim://?seed=0&nano=mock&lidar=1&map=room", "--map",
                           chart, "--duration", 0.6, "--json")
    assert (code, found["status"]) == (1, "LOST")
    assert "of the last scan" in found["why"]
