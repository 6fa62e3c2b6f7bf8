"""The batch path gives what the live decoder gives, on every input."""

from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dart_hal.wire import batch, columns, samples
from dart_hal.wire.codec import UP, encode
from dart_hal.wire.crc import columns as crc_columns
from dart_hal.wire.crc import crc16
from dart_hal.wire.decoder import Decoder
from dart_hal.wire.messages import MESSAGES, STATE

FAULTS = [*samples.SMALL_FAULTS.values(), samples.burst(8)]


@pytest.fixture(autouse=True, params=[1, 64], ids=["all by column", "as shipped"])
def _few(request, monkeypatch):
    """Also with every group, however small, on the vectorised path."""
    monkeypatch.setattr(batch, "_FEW", request.param)
    monkeypatch.setattr(columns, "_ROWS", 7 if request.param == 1 else 4096)


def agree(stream, messages=MESSAGES):
    decoder = Decoder(messages)
    frames = decoder.feed(stream)
    result = batch.decode(stream, messages)
    assert result.frames() == frames
    assert result.counters == decoder.counters
    return result


@st.composite
def damaged(draw):
    rng = Random(draw(st.integers(0, 2**32)))
    frames = draw(st.sampled_from([samples.mixed(40, 1), samples.drive(0.5, 2),
                                   samples.drive(0.3, 3) + samples.drive(0.3, 4, boot=2)]))
    share = draw(st.sampled_from([0.0, 0.05, 0.5]))
    gone = draw(st.sampled_from([0.0, 0.1]))
    out = [draw(st.sampled_from(FAULTS))(f, rng) if rng.random() < share and len(f) > 8 else f
           for f in frames if rng.random() >= gone]
    return b"".join(out) + draw(st.binary(max_size=60))


@given(damaged())
@settings(max_examples=150, deadline=None)
def test_damaged_streams(stream):
    agree(stream)
    agree(stream, UP)


@given(st.lists(st.sampled_from([b"\0", b"\x01", b"\x02\x10", b"\x2b\x10", b"\xff"])
                | st.binary(max_size=50), max_size=40).map(b"".join))
@settings(max_examples=150)
def test_noise(stream):
    agree(stream)


@given(st.lists(st.binary(min_size=41, max_size=41), min_size=1, max_size=20))
@settings(max_examples=100)
def test_blocks_of_the_length_of_state(bodies):
    """Any bytes behind a first code and the type of STATE: broken chains, wrapping steps."""
    agree(b"".join(bytes([2 + i % 42, 0x10]) + body.replace(b"\0", b"\x01") + b"\0"
                   for i, body in enumerate(bodies)))


def test_all_faults_over_a_drive():
    rng = Random(11)
    frames = samples.drive(20.0, seed=5)
    hurt = [rng.choice(FAULTS)(f, rng) if i % 3 == 0 and len(f) > 8 else f
            for i, f in enumerate(frames)]
    counters = agree(b"".join(hurt)).counters
    assert min(counters.ok, counters.crc, counters.cobs, counters.length, counters.gaps,
               counters.repaired) > 0


def test_silences_and_restarts():
    first, second = samples.drive(60.0, seed=1), samples.drive(10.0, seed=2, boot=2)
    result = agree(b"".join(first[:100] + first[700:900] + first[4800:] + second[:50]
                            + second[400:]))
    assert result.counters.rebased == 2


def test_columns_hold_the_values():
    frames = samples.drive(2.0, seed=6)
    result = agree(b"".join(frames))
    state = result.columns["STATE"]
    live = [f for f in Decoder(UP).feed(b"".join(frames)) if f.message is STATE]
    assert state.rows["t_ck"].tolist() == [f.as_dict()["t_ck"] for f in live]
    assert state.rows["gyro"].tolist() == [list(f.as_dict()["gyro"]) for f in live]
    assert state.end.tolist() == [f.end for f in live]
    assert not state.rows.flags.writeable


@pytest.mark.parametrize("stream", [b"", b"\0", b"\0\0", b"\x01", b"\x01\0", b"\x10" * 300,
                                    b"\x10" * 300 + b"\0"])
def test_nothing_is_no_failure(stream):
    assert agree(stream).frames() == []


def test_broken_column_decoder_is_seen(monkeypatch):
    """Negative control: without the CRC both ways differ."""
    monkeypatch.setattr(batch, "open_blocks", _trusting)
    stream = b"".join(samples.flip_bits(1)(f[:-1], Random(1)) + b"\0"
                      for f in samples.drive(1.0) if len(f) == 44)
    with pytest.raises(AssertionError):
        agree(stream)


def _trusting(stream, starts, message):
    unstuffed, _, seq, payload = columns.open_blocks(stream, starts, message)
    return unstuffed, unstuffed, seq, payload


@given(st.integers(0, 40), st.integers(1, 20), st.integers(0, 0xFFFF), st.integers(0, 2**32))
def test_crc_by_columns(length, count, seed, rng_seed):
    data = np.frombuffer(Random(rng_seed).randbytes(length * count), np.uint8)
    data = data.reshape(length, count)
    assert crc_columns(data, seed).tolist() == [crc16(column.tobytes(), seed)
                                                for column in data.T]


def test_dtypes_have_the_size_of_the_payload():
    for m in MESSAGES:
        if not m.variable:
            assert columns.dtype(m.id).itemsize == m.size


def test_any_buffer():
    stream = encode(STATE, 0, STATE.struct.unpack(bytes(38)))
    for data in (stream, bytearray(stream), memoryview(stream)):
        assert batch.decode(data).counters.ok == 1
