"""The published figures, reproduced on the full set."""

from __future__ import annotations

import numpy as np
import pytest

from dart_hal.recording.dart import fit_reference, grid, read, read_all

pytestmark = pytest.mark.recordings

# folder: windows of 2 s, then the errors at 1 s of holding v_x, v_y and yaw rate:
# v_x, v_y [m/s], yaw rate [rad/s], position [m], yaw [deg]
HELD = {
    "50_tire_model_data": (270, .159, .028, .295, .123, 10.1),
    "60_racetrack_lap_v_060": (171, .096, .027, .282, .066, 8.7),
    "80_circles_rubbery_floor": (904, .121, .015, .286, .094, 9.5),
    "81_throttle_ramps": (1206, .109, .016, .125, .067, 4.0),
    "81_circles_tape_and_tiles": (202, .086, .017, .162, .061, 5.1),
    "81_drifting_tapes_and_tiles": (43, .364, .363, 1.322, .315, 45.0),
    "steering_identification_25_sept_2024": (1006, .055, .007, .061, .033, 2.7),
    "circles_27_sept_2024_fast_ramp": (237, .098, .018, .165, .061, 5.0),
    "circles_27_sept_2024": (8, .253, .050, .503, .131, 14.2),
    "83_4_april_2025_MPCC_rosbag": (63, .895, .119, 3.679, 1.687, 124.6),
    "83_24_april_2025_slippery_floor_no_tape": (220, .703, .122, 2.283, 1.138, 79.6),
}


def held_errors(g) -> list[tuple[float, ...]]:
    errors = []
    for s in range(20, len(g) - 220, 25):
        if g.v_x[s] <= 0.3 or g.bad[s - 8:s + 208].any():
            continue
        e = s + 100
        turn = g.omega[s]
        a = g.yaw[s]
        b = g.yaw[s] + turn
        dx = (g.v_x[s] * (np.sin(b) - np.sin(a)) + g.v_y[s] * (np.cos(b) - np.cos(a))) / turn
        dy = (g.v_y[s] * (np.sin(b) - np.sin(a)) - g.v_x[s] * (np.cos(b) - np.cos(a))) / turn
        errors.append((g.v_x[s] - g.v_x[e], g.v_y[s] - g.v_y[e], turn - g.omega[e],
                       np.hypot(g.x[s] + dx - g.x[e], g.y[s] + dy - g.y[e]),
                       np.degrees(b - g.yaw[e])))
    return errors


@pytest.mark.slow
def test_all_83_files_read(recordings):
    found, skipped = read_all([recordings])
    assert not skipped
    assert len(found) == 83
    assert sum(r.schema == "A" for r in found) == 63
    assert [r.name for r in found if r.encoder == "dead"] == [
        "circles_27_sept_2024/car_1_Datarecording_09_27_2024_12_06_55.csv"]
    assert all(np.isfinite(r.messages.t).all() for r in found)


@pytest.mark.slow_except("circles_27_sept_2024")
@pytest.mark.parametrize("folder", list(HELD))
def test_windows_and_held_motion(recordings, folder):
    found, _ = read_all([recordings / folder])
    errors = [e for r in found for e in held_errors(grid(r))]
    n, *expected = HELD[folder]
    assert len(errors) == n
    rmse = np.sqrt(np.mean(np.square(errors), axis=0))
    assert rmse[4] == pytest.approx(expected.pop(), abs=0.051)  # printed with one decimal
    assert rmse[:4] == pytest.approx(expected, rel=0.01, abs=6e-4)


def test_held_sensor_columns_of_the_tyre_recording(recordings):
    recording = read(next((recordings / "50_tire_model_data").glob("*.csv")))
    assert len(recording.messages) == 731
    assert sum(n.rows for n in recording.notes if "held copies" in n.why) == 7339 - 731


SEPTEMBER = ("80_circles_rubbery_floor", "81_throttle_ramps", "91_free_driving_16_sept_2024",
             "steering_identification_25_sept_2024", "circles_27_sept_2024_fast_ramp")


@pytest.mark.slow
def test_reference_point_from_driving_to_both_sides(recordings):
    found, _ = read_all([recordings / folder for folder in SEPTEMBER])
    fitted = fit_reference(found)
    assert fitted.lx == pytest.approx(0.115, abs=0.004)
    assert np.degrees(fitted.theta) == pytest.approx(0.56, abs=0.15)


def test_one_circle_gives_no_reference_point(recordings):
    found, _ = read_all([recordings / "circles_27_sept_2024_fast_ramp"])
    assert fit_reference(found) is None
