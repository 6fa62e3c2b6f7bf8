"""A run that version 0.1 wrote: sealed, not chunked. It reads as it always did."""

from __future__ import annotations

import gzip
import hashlib
from pathlib import Path

import pytest

from dart_hal.car import Car
from dart_hal.car.runs import read_run
from dart_hal.recording.run import RunReader

PACKED = Path(__file__).parent / "fixtures" / "v0_1" / "run.mcap.gz"
RX = "1c932a7ed373fe4de8385cfa0913198bb1e05208479a426671f89edd9ec2864f"


@pytest.fixture
def run_of_v0_1(tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes(gzip.decompress(PACKED.read_bytes()))
    return path


def hash_received(run: RunReader) -> str:
    return hashlib.sha256(b"".join(c.data for c in run.chunks())).hexdigest()


def test_it_reads_whole(run_of_v0_1):
    run = RunReader(run_of_v0_1)
    assert (run.complete, run.damaged, run.notices) == (True, False, ())
    assert run.meta == {"url": "sim://?seed=7&nano=mock", "car": "sim-7", "start": "0.0",
                        "schema": "08c6bc5d", "proto": "1"}
    assert {"run", "files", "hello", "line", "mass"} <= set(run.metadata)
    assert run.metadata["mass"] == {"kg": "1.7", "std": "0.01"}
    assert 'name = "sim-7"' in run.files["car.toml"]
    assert run.hello["proto"] == 1
    counts = [len(list(what())) for what in
              (run.chunks, run.sent, run.i2c, run.applied, run.commands)]
    assert counts == [423, 217, 228, 146, 120]
    assert hash_received(run) == RX
    stamps = [c.t for c in run.chunks()]
    assert (stamps[0], stamps[-1]) == (0.002134435584911528, 3.7400235231540266), "to the last bit"


@pytest.mark.slow
def test_it_replays(run_of_v0_1):
    with Car.open(f"replay://{run_of_v0_1}") as car:
        states = list(car.states())
    assert len(states) == 374
    assert states[-1].applied.steering_us == 1654.2141170047562
    assert 1.0 < states[-1].speed < 1.4
    recording = read_run(run_of_v0_1)
    assert recording.mass == (1.7, 0.01)
    assert len(recording.messages) > 30


def test_its_end_may_be_missing(run_of_v0_1):
    data = run_of_v0_1.read_bytes()
    whole = list(RunReader(run_of_v0_1).chunks())
    run_of_v0_1.write_bytes(data[:len(data) // 2])
    run = RunReader(run_of_v0_1)
    assert not run.complete
    assert not run.damaged
    assert "the end is missing" in run.notices[0]
    part = list(run.chunks())
    assert len(whole) // 3 < len(part) < len(whole)
    assert part == whole[:len(part)]


@pytest.mark.parametrize("hole", [1, 3000])
def test_its_seals_still_find_a_damage(run_of_v0_1, hole):
    data = run_of_v0_1.read_bytes()
    whole = list(RunReader(run_of_v0_1).chunks())
    middle = len(data) // 2
    run_of_v0_1.write_bytes(data[:middle] + data[middle + hole:])
    run = RunReader(run_of_v0_1)
    assert run.damaged
    assert run.complete
    assert "damaged at byte" in run.notices[0]
    rest = iter(whole)
    assert all(chunk in rest for chunk in run.chunks()), "nothing is invented"
    assert list(run.chunks())[-1] == whole[-1]


def test_a_flipped_bit_is_no_message(run_of_v0_1):
    """Negative control of the above: without the check the bit would be in the data."""
    data = bytearray(run_of_v0_1.read_bytes())
    frame = next(c.data for i, c in enumerate(RunReader(run_of_v0_1).chunks()) if i == 200)
    data[bytes(data).index(frame) + 5] ^= 4
    run_of_v0_1.write_bytes(data)
    run = RunReader(run_of_v0_1)
    assert run.damaged
    assert frame not in [c.data for c in run.chunks()]
