"""Damage in the middle of a run: what is behind it is read, nothing is invented."""

from __future__ import annotations

import random
import re
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader

from dart_hal.recording import mcap_records
from dart_hal.recording.mcap_records import (
    MCAP_MAGIC,
    PREFIX,
    McapFile,
    iterate_records,
    parse_mcap,
)
from dart_hal.recording.run import RunReader


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
def write_without_chunks(run_bytes):
    """The same as a tool that knows no chunks would write it: nothing has a checksum."""
    out = bytearray(MCAP_MAGIC)
    for block in parse_mcap("run", run_bytes).blocks[1:]:  # the first repeats the channels
        for opcode, start, end in iterate_records(block):
            if opcode != Opcode.ATTACHMENT:
                out += block[start - PREFIX.size:end]
    return bytes(out)


def messages(found: McapFile) -> list[mcap_records.McapMessage]:
    return list(found.messages())


def chunks(data: bytes) -> list[tuple[int, int]]:
    """(start, end) of every chunk record of a whole file."""
    return [(s - PREFIX.size, e) for opcode, s, e in
            ((o, s + len(MCAP_MAGIC), e + len(MCAP_MAGIC)) for o, s, e in iterate_records(
                data[len(MCAP_MAGIC):-len(MCAP_MAGIC)])) if opcode == Opcode.CHUNK]


def is_part(found, whole) -> bool:
    """Whether ``found`` is ``whole`` with some left out, in order."""
    rest = iter(whole)
    return all(item in rest for item in found)


def damage(data: bytes, offset: int, size: int, kind: str, seed: int) -> bytes:
    rng = random.Random(seed)
    new = {"removed": b"", "zeros": bytes(size), "noise": rng.randbytes(size),
           "inserted": data[offset:offset + size] + rng.randbytes(size),
           "flipped": bytes([data[offset] ^ (1 << seed % 8)]) + data[offset + 1:offset + size],
           "doubled": data[offset:offset + size] * 2}[kind]
    return data[:offset] + new + data[offset + size:]


DAMAGE_KINDS = st.sampled_from(["removed", "zeros", "noise", "inserted", "flipped", "doubled"])


def test_the_whole_file_is_chunked_and_undamaged(run_bytes, tmp_path):
    found = parse_mcap(tmp_path, run_bytes)
    assert found.complete
    assert not found.damages
    assert len(messages(found)) == found.count == 60 * 4 + 12 * 4 + 1
    (tmp_path / "run.mcap").write_bytes(run_bytes)
    with (tmp_path / "run.mcap").open("rb") as file:
        summary = make_reader(file, validate_crcs=True).get_summary()
    assert len(summary.chunk_indexes) == len(chunks(run_bytes)) >= 12
    assert all(b.message_end_time - a.message_end_time <= 60_000_000
               for a, b in pairwise(summary.chunk_indexes)), "one each 50 ms"
    assert summary.statistics.message_count == found.count


def test_the_strict_reader_of_the_library_refuses_what_ours_reads_around(run_bytes, tmp_path):
    """Its checks are on: a flipped bit in a chunk, an attachment or between is an error there."""
    path = tmp_path / "bit.mcap"
    for offset in (chunks(run_bytes)[4][0] + 200, 200, chunks(run_bytes)[4][1] + 16):
        path.write_bytes(damage(run_bytes, offset, 1, "flipped", 3))
        with path.open("rb") as file, pytest.raises(ValueError, match="crc"):
            list(StreamReader(file, validate_crcs=True).records)
        assert RunReader(path).damaged
    path.write_bytes(run_bytes)
    with path.open("rb") as file:
        assert list(StreamReader(file, validate_crcs=True).records)


@given(st.lists(st.tuples(st.floats(0, 1), st.integers(1, 4000), DAMAGE_KINDS, st.integers(0, 999)),
                min_size=1, max_size=3))
@pytest.mark.slow
def test_no_damage_invents_a_message(run_bytes, tmp_path_factory, places):
    whole = parse_mcap(tmp_path_factory.getbasetemp(), run_bytes)
    data = run_bytes
    for where, size, kind, seed in places:
        offset = len(MCAP_MAGIC) + int(where * (len(data) - len(MCAP_MAGIC) - 1))
        data = damage(data, offset, size, kind, seed)
    found = parse_mcap(tmp_path_factory.getbasetemp(), data)
    assert is_part(messages(found), messages(whole))
    assert all(whole.metadata[name] == values for name, values in found.metadata.items())


@pytest.mark.parametrize("kind", ["removed", "zeros", "noise", "inserted", "flipped", "doubled"])
@pytest.mark.parametrize("size", [1, 40, 3000])
@pytest.mark.slow
def test_a_hole_costs_the_blocks_that_it_hit(run_bytes, tmp_path, size, kind):
    whole = parse_mcap(tmp_path, run_bytes)
    start = chunks(run_bytes)[2][1]
    most = size / 6000 * 24 + 2 * 32  # messages in the hole and in two blocks of 50 ms
    for offset in range(start, chunks(run_bytes)[-1][1] - size - 1000, 997):
        data = damage(run_bytes, offset, size, kind, offset)
        if data == run_bytes:  # zeros that were zeros
            continue
        found = parse_mcap(tmp_path, data)
        lost = whole.count - found.count
        assert 0 <= lost <= most
        assert is_part(messages(found), messages(whole))
        assert found.complete
        assert found.damages
        assert all(d.offset <= offset + size or not d.skipped for d in found.damages)


def test_the_notice_states_damage_and_not_that_the_end_is_missing(run_bytes, tmp_path):
    path = tmp_path / "hole.mcap"
    middle = len(run_bytes) // 2
    path.write_bytes(run_bytes[:middle] + run_bytes[middle + 3000:])
    run = RunReader(path)
    assert run.damaged
    assert run.complete
    (notice,) = run.notices
    offset, skipped = map(int, re.search(r"damaged at byte (\d+), (\d+) bytes skipped",
                                         notice).groups())
    assert str(path) in notice
    assert offset <= middle <= offset + skipped
    whole = tmp_path / "whole.mcap"
    whole.write_bytes(run_bytes)
    assert list(run.chunks())[-1] == list(RunReader(whole).chunks())[-1]


def test_a_hole_and_a_missing_end_are_distinguished(run_bytes, tmp_path):
    path = tmp_path / "both.mcap"
    path.write_bytes(run_bytes[:20_000] + run_bytes[22_000:-9000])
    first, second = RunReader(path).notices
    assert "damaged at byte" in first
    assert "the end is missing" in second


def test_a_missing_chunk_is_reported_though_nothing_is_skipped(run_bytes, tmp_path):
    path = tmp_path / "block.mcap"
    all_chunks = chunks(run_bytes)
    # with its indexes
    first = all_chunks[5][0]
    second = all_chunks[6][0]
    path.write_bytes(run_bytes[:first] + run_bytes[second:])
    assert re.search(r"damaged before byte \d+, 0 bytes skipped", RunReader(path).notices[0])


def test_a_chunk_that_one_bit_makes_another_record_is_reported(run_bytes, tmp_path):
    """Even where no checksum of the whole is there yet."""
    path = tmp_path / "bit.mcap"
    first, _ = chunks(run_bytes)[5]
    for bit in range(8):
        path.write_bytes(damage(run_bytes, first, 1, "flipped", bit)[:-9000])
        assert RunReader(path).damaged


@pytest.mark.slow
def test_one_bit_in_the_index_of_a_chunk_is_no_message(run_bytes, tmp_path):
    whole = messages(parse_mcap(tmp_path, run_bytes))
    _, end = chunks(run_bytes)[5]
    assert run_bytes[end] == Opcode.MESSAGE_INDEX
    for offset in range(end, end + 40):
        for bit in range(8):
            found = parse_mcap(tmp_path, damage(run_bytes, offset, 1, "flipped", bit))
            assert messages(found) == whole
            assert found.damages


def test_a_damaged_index_is_reported(run_bytes, tmp_path):
    whole = messages(parse_mcap(tmp_path, run_bytes))
    found = parse_mcap(tmp_path, damage(run_bytes, len(run_bytes) - 3000, 1, "flipped", 1))
    assert messages(found) == whole
    assert found.damages


def test_without_the_check_a_flipped_bit_is_data(run_bytes, tmp_path, monkeypatch):
    """Negative control."""
    hurt = damage(run_bytes, chunks(run_bytes)[5][0] + 900, 1, "flipped", 3)
    whole = messages(parse_mcap(tmp_path, run_bytes))
    assert is_part(messages(parse_mcap(tmp_path, hurt)), whole)
    class AnyChecksum(int):
        __hash__ = int.__hash__

        def __eq__(self, other):
            return True

    monkeypatch.setattr(mcap_records, "crc32", lambda data: AnyChecksum())
    assert not is_part(messages(parse_mcap(tmp_path, hurt)), whole)


# -- files without checksums ------------------------------------------------------


def test_without_chunks_the_file_still_reads(run_bytes, write_without_chunks, tmp_path):
    found = parse_mcap(tmp_path, write_without_chunks)
    assert messages(found) == messages(parse_mcap(tmp_path, run_bytes))
    assert not found.damages


@pytest.mark.slow_except("100")
@pytest.mark.parametrize("size", [1, 100, 3000])
def test_without_checksums_reading_ends_before_a_hole(write_without_chunks, tmp_path, size):
    whole = messages(parse_mcap(tmp_path, write_without_chunks))
    for offset in range(len(write_without_chunks) // 4, len(write_without_chunks) - size - 1000,
                        997):
        found = messages(parse_mcap(tmp_path, write_without_chunks[:offset]
                                    + write_without_chunks[offset + size:]))
        # Two records of one size can be stitched by a hole of their distance: no seal, no way.
        assert len(set(found) - set(whole)) <= 1
        assert len(found) < len(whole)


@pytest.mark.slow
def test_without_chunks_a_cut_is_no_damage(write_without_chunks, tmp_path):
    whole = messages(parse_mcap(tmp_path, write_without_chunks))
    for size in range(len(write_without_chunks) // 4, len(write_without_chunks), 97):
        found = parse_mcap(tmp_path, write_without_chunks[:size])
        assert messages(found) == whole[:found.count]
        assert not found.damages
        assert not found.complete


@given(st.floats(0, 1), st.integers(1, 4000), DAMAGE_KINDS, st.integers(0, 999))
def test_without_checksums_no_damage_is_a_crash(write_without_chunks, tmp_path_factory, where,
                                                size, kind,
                                                seed):
    offset = len(MCAP_MAGIC) + int(where * (len(write_without_chunks) - len(MCAP_MAGIC) - 1))
    found = parse_mcap(tmp_path_factory.getbasetemp(),
                       damage(write_without_chunks, offset, size, kind, seed))
    assert found.used <= found.length + size


def test_a_tail_of_zeros_is_no_message(write_without_chunks, run_bytes, tmp_path):
    """What a power cut leaves on some file systems."""
    for data in (write_without_chunks, run_bytes):
        whole = messages(parse_mcap(tmp_path, data))
        found = parse_mcap(tmp_path, data[:20_000] + bytes(4096))
        assert is_part(messages(found), whole)
        assert found.count
        assert not found.complete
