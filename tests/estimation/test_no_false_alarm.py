"""Sound cars are not doubted: simulated driving in every style, the recordings of the real one."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

from bench_doubts import STYLES, drive, recorded

SLIDES = {"81_drifting_tapes_and_tiles/"
          "car_1_Datarecording_09_09_2024_18_13_59drifting_clockwise.csv"}
"""The car is at full throttle across its direction: the wheels do not measure its motion."""
DEAD = {"circles_27_sept_2024/car_1_Datarecording_09_27_2024_12_06_55.csv"}
"""Motion capture shows up to 0.43 m/s, the encoder stays at zero."""
JUMPS = {"60_racetrack_lap_v_060/racetrack_lap_v060.csv"}
"""Two samples of its motion capture within 0.15 s have another yaw than their neighbours."""


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.slow
def test_no_style_of_driving_is_doubted(style):
    assert drive((17, style), 9.0).doubts == ()


@pytest.mark.long
@pytest.mark.parametrize("style", STYLES)
def test_no_style_of_driving_is_doubted_on_ten_cars(style):
    assert [d for seed in range(30, 40) for d in drive((seed, style), 36.0).doubts] == []


def collect_doubts(path: Path) -> dict[str, set[str]]:
    names: dict[str, set[str]] = {}
    for who, name, _, _ in recorded(path).doubts:
        names.setdefault(who, set()).add(name)
    return names


@pytest.mark.slow
def test_a_recorded_dead_encoder_is_found(recordings):
    (path,) = recordings.glob("circles_27_sept_2024/*.csv")
    assert collect_doubts(path) == {next(iter(DEAD)): {"ENCODER_DEAD", "ENCODER_LOW"}}


@pytest.mark.long
def test_only_recordings_of_a_dead_encoder_of_drifting_and_of_jumps_are_doubted(recordings):
    found: dict[str, set[str]] = {}
    for path in sorted(recordings.rglob("*.csv")):
        found |= collect_doubts(path)
    assert set(found) == SLIDES | DEAD | JUMPS
    assert found[next(iter(JUMPS))] == {"SAMPLES_JUMPED"}
    assert "ENCODER_LOW" in found[next(iter(SLIDES))], "the wheels are across the direction"
