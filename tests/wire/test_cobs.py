"""COBS against an independent implementation, exhaustively where it is small."""

from itertools import product

import pytest
from cobs import cobs as oracle
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.wire import cobs

zero_heavy = st.lists(st.sampled_from([0, 0, 1, 254, 255]) | st.integers(0, 255),
                      max_size=700).map(bytes)


@given(zero_heavy)
def test_encoding_is_the_oracles_and_comes_back(raw):
    block = cobs.encode(raw)
    assert block == oracle.encode(raw)
    assert 0 not in block
    assert cobs.decode(block) == raw


@pytest.mark.parametrize("length", range(6))
def test_every_tiny_frame(length):
    for raw in map(bytes, product((0, 1, 2, 255), repeat=length)):
        block = cobs.encode(raw)
        assert block == oracle.encode(raw)
        assert cobs.decode(block) == raw


@pytest.mark.parametrize("length", range(1, 6))
def test_every_tiny_block_is_judged_like_the_oracle(length):
    for block in map(bytes, product((0, 1, 2, 3, 4, 5, 255), repeat=length)):
        try:
            expected = oracle.decode(block)
        except oracle.DecodeError:
            with pytest.raises(cobs.CobsError):
                cobs.decode(block)
        else:
            assert cobs.decode(block) == expected


@pytest.mark.parametrize("length", [252, 253, 254, 255, 256, 507, 508, 509, 762, 763])
@pytest.mark.parametrize("end", [b"", b"\0", b"\0\0", b"\x07"])
@pytest.mark.parametrize("start", [b"", b"\0", b"\x07\0"])
def test_full_blocks_at_the_end_have_no_empty_block_behind(length, start, end):
    raw = start + b"\x01" * length + end
    assert cobs.encode(raw) == oracle.encode(raw)
    assert cobs.decode(cobs.encode(raw)) == raw


def test_the_trap_is_real():
    """A block with the empty one behind it means the same, so nothing but length betrays it."""
    raw = b"\x01" * 254
    padded = b"\xff" + raw + b"\x01"
    assert cobs.decode(padded) == oracle.decode(padded) == raw
    assert cobs.encode(raw) == padded[:-1]


def test_no_block_is_no_frame():
    with pytest.raises(cobs.CobsError):
        cobs.decode(b"")


def test_a_delimiter_inside_a_block_is_refused():
    with pytest.raises(cobs.CobsError):
        cobs.decode(b"\x03\x00\x01")
