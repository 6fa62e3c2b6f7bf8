"""A run of format 3, whose commands and pulses are JSON: it reads and replays as it always did."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest

from dart_hal.car import Car
from dart_hal.core.types import Applied
from dart_hal.recording.run import RecordedCommand, RunReader

PACKED = Path(__file__).parent / "fixtures" / "v3" / "run.mcap.gz"


@pytest.fixture
def run_of_format_3(tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes(gzip.decompress(PACKED.read_bytes()))
    return path


def test_it_is_of_text(run_of_format_3):
    """Else the two below would show nothing."""
    assert b'"throttle_us":' in run_of_format_3.read_bytes()


def test_commands_and_pulses_read_to_the_last_bit(run_of_format_3):
    run = RunReader(run_of_format_3)
    assert (run.complete, run.damaged, run.notices) == (True, False, ())
    commands = list(run.commands())
    applied = list(run.applied())
    assert (len(commands), len(applied)) == (60, 134)
    assert commands[-1] == RecordedCommand(3.1403621722071096, 0.003548139349253619, 0.3, "user")
    assert applied[-1].t == 3.130367816357994
    assert applied[-1].applied == Applied(
        0.017130813203654983, 0.2997035188278591, 1504.2707321300559, 1634.8665834725366,
        ("UNCALIBRATED",))


def test_it_replays(run_of_format_3):
    with Car.open(f"replay://{run_of_format_3}") as car:
        states = list(car.states())
    assert len(states) == 314
    assert states[-1].speed == 0.5212606469401355
    assert states[-1].applied.steering_us == 1504.2707321300559
