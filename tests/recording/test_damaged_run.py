"""Damage in the middle of a run: what is behind it is read, nothing is invented."""

from __future__ import annotations

import random
import re
from struct import Struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.errors import RecordingError
from dart_hal.recording import seals
from dart_hal.recording.mcap_records import parse_mcap
from dart_hal.recording.mcap_walk import MAGIC, MESSAGE, walk
from dart_hal.recording.run import RunReader

PREFIX = Struct("<BQ")


@pytest.fixture(scope="module")
def run_bytes(tmp_path_factory, request):
    from importlib import util
    from pathlib import Path

    spec = util.spec_from_file_location("run_writing", Path(__file__).parent / "conftest.py")
    module = util.module_from_spec(spec)
    spec.loader.exec_module(module)
    path = tmp_path_factory.mktemp("run") / "whole.mcap"
    module.write_run(path, frames=60)
    return path.read_bytes()


@pytest.fixture(scope="module")
def unsealed(run_bytes):
    """The same file as a tool that drops private records would leave it (index not redone)."""
    out, last = bytearray(MAGIC), len(MAGIC)
    for record in walk(run_bytes).records:
        last = record.end
        if record.opcode != seals.OPCODE:
            out += run_bytes[record.start - PREFIX.size:record.end]
    return bytes(out + run_bytes[last:])


def is_part(found, whole) -> bool:
    """Whether ``found`` is ``whole`` with some left out, in order."""
    rest = iter(whole)
    return all(item in rest for item in found)


def damage(data: bytes, at: int, size: int, kind: str, seed: int) -> bytes:
    rng = random.Random(seed)
    new = {"removed": b"", "zeros": bytes(size), "noise": rng.randbytes(size),
           "inserted": data[at:at + size] + rng.randbytes(size),
           "flipped": bytes([data[at] ^ (1 << seed % 8)]) + data[at + 1:at + size],
           "doubled": data[at:at + size] * 2}[kind]
    return data[:at] + new + data[at + size:]


KINDS = st.sampled_from(["removed", "zeros", "noise", "inserted", "flipped", "doubled"])


def test_the_whole_file_is_sealed_and_undamaged(run_bytes, tmp_path):
    found = parse_mcap(tmp_path, run_bytes)
    assert found.complete
    assert not found.damages
    assert len(found.messages) == 60 * 4 + 12 * 4 + 1
    blocks = seals.sealed_blocks(run_bytes)
    assert [b.number for b in blocks] == list(range(len(blocks)))
    assert len(blocks) >= 12


@given(st.lists(st.tuples(st.floats(0, 1), st.integers(1, 4000), KINDS, st.integers(0, 999)),
                min_size=1, max_size=3))
def test_no_damage_invents_a_message(run_bytes, tmp_path_factory, places):
    whole = parse_mcap(tmp_path_factory.getbasetemp(), run_bytes)
    data = run_bytes
    for where, size, kind, seed in places:
        at = len(MAGIC) + int(where * (len(data) - len(MAGIC) - 1))
        data = damage(data, at, size, kind, seed)
    found = parse_mcap(tmp_path_factory.getbasetemp(), data)
    assert is_part(found.messages, whole.messages)
    assert all(whole.metadata[name] == values for name, values in found.metadata.items())


@pytest.mark.parametrize("kind", ["removed", "zeros", "noise", "inserted", "flipped", "doubled"])
@pytest.mark.parametrize("size", [1, 40, 3000])
def test_a_hole_costs_the_blocks_that_it_hit(run_bytes, tmp_path, size, kind):
    whole = parse_mcap(tmp_path, run_bytes)
    start = seals.sealed_blocks(run_bytes)[2].end
    most = size / 6000 * 24 + 2 * 32  # messages in the hole and in two blocks of 50 ms
    for at in range(start, len(run_bytes) - 8000, 997):
        data = damage(run_bytes, at, size, kind, at)
        if data == run_bytes:  # zeros that were zeros
            continue
        found = parse_mcap(tmp_path, data)
        lost = len(whole.messages) - len(found.messages)
        assert 0 <= lost <= most
        assert is_part(found.messages, whole.messages)
        assert found.complete
        assert found.damages
        assert all(d.at <= at + size for d in found.damages)


def test_the_notice_says_damaged_and_not_that_the_end_is_missing(run_bytes, tmp_path):
    path = tmp_path / "hole.mcap"
    middle = len(run_bytes) // 2
    path.write_bytes(run_bytes[:middle] + run_bytes[middle + 3000:])
    run = RunReader(path)
    assert run.damaged
    assert run.complete
    (notice,) = run.notices
    at, skipped = map(int, re.search(r"damaged at byte (\d+), (\d+) bytes skipped",
                                     notice).groups())
    assert str(path) in notice
    assert at <= middle <= at + skipped
    whole = tmp_path / "whole.mcap"
    whole.write_bytes(run_bytes)
    assert list(run.chunks())[-1] == list(RunReader(whole).chunks())[-1]


def test_a_hole_and_a_missing_end_are_told_apart(run_bytes, tmp_path):
    path = tmp_path / "both.mcap"
    path.write_bytes(run_bytes[:20_000] + run_bytes[22_000:-9000])
    first, second = RunReader(path).notices
    assert "damaged at byte" in first
    assert "the end is missing" in second


def test_a_missing_block_is_told_though_nothing_is_skipped(run_bytes, tmp_path):
    path = tmp_path / "block.mcap"
    block = seals.sealed_blocks(run_bytes)[5]
    path.write_bytes(run_bytes[:block.start] + run_bytes[block.end:])
    assert f"damaged at byte {block.start}, 0 bytes skipped" in RunReader(path).notices[0]


def test_without_its_channels_a_run_is_refused_by_name(run_bytes, tmp_path):
    path = tmp_path / "channels.mcap"
    at = seals.sealed_blocks(run_bytes)[1].start
    path.write_bytes(damage(run_bytes, at + 20, 50, "zeros", 0))
    with pytest.raises(RecordingError, match="damaged") as error:
        RunReader(path)
    assert str(path) in error.value.what


# -- files without seals ----------------------------------------------------------


def messages_from(data: bytes) -> int:
    """Where the first message begins."""
    return next(r.start - PREFIX.size for r in walk(data).records if r.opcode == MESSAGE)


def test_without_seals_the_file_still_reads(run_bytes, unsealed, tmp_path):
    assert not seals.sealed_blocks(unsealed)
    found = parse_mcap(tmp_path, unsealed)
    assert found.messages == parse_mcap(tmp_path, run_bytes).messages
    assert not found.damages
    assert found.complete


@pytest.mark.parametrize("size", [1, 100, 3000])
def test_without_seals_reading_goes_on_behind_a_hole(unsealed, tmp_path, size):
    whole = parse_mcap(tmp_path, unsealed).messages
    first = messages_from(unsealed)
    for at in range(first, len(unsealed) - 12_000, 251):
        found = parse_mcap(tmp_path, unsealed[:at] + unsealed[at + size:])
        # Two records of one size can be stitched by a hole of their distance: no seal, no way.
        assert len(set(found.messages) - set(whole)) <= 1
        assert found.messages[-1] == whole[-1]
        assert len(whole) - len(found.messages) <= size / 6000 * 24 + 24
        assert found.complete
        assert sum(d.skipped for d in found.damages) < 3000


def test_without_seals_a_cut_is_no_damage(unsealed, tmp_path):
    whole = parse_mcap(tmp_path, unsealed).messages
    for size in range(messages_from(unsealed), len(unsealed) - 9000, 97):
        found = parse_mcap(tmp_path, unsealed[:size])
        assert found.messages == whole[:len(found.messages)]
        assert not found.damages
        assert not found.complete


@given(st.floats(0, 1), st.integers(1, 4000), KINDS, st.integers(0, 999))
def test_without_seals_no_damage_is_a_crash(unsealed, tmp_path_factory, where, size, kind, seed):
    at = len(MAGIC) + int(where * (len(unsealed) - len(MAGIC) - 1))
    found = parse_mcap(tmp_path_factory.getbasetemp(), damage(unsealed, at, size, kind, seed))
    assert found.used <= found.length + size


def test_a_tail_of_zeros_is_no_message(unsealed, run_bytes, tmp_path):
    """What a power cut leaves on some file systems."""
    for data in (unsealed, run_bytes):
        whole = parse_mcap(tmp_path, data).messages
        found = parse_mcap(tmp_path, data[:20_000] + bytes(4096))
        assert is_part(found.messages, whole)
        assert found.messages
        assert not found.complete
