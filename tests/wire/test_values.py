"""Frames as values: layout, scales, records, gates, counters that wrap, encoding errors."""

from dataclasses import FrozenInstanceError
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.core.errors import UsageError
from dart_hal.wire.codec import UP, encode, pack
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.frame import WireFrame, layout
from dart_hal.wire.messages import BY_NAME, LOG, MESSAGES, STATE
from dart_hal.wire.plausible import Gates
from dart_hal.wire.unwrap import unwrap
from tests.wire import wire_samples as samples

AT = layout(STATE.id)
BASE = list(STATE.struct.unpack(bytes(38)))


def state(t, count, gyro=(0, 0, 0)):
    values = list(BASE)
    values[AT["t_ck"]], values[AT["enc_count"]], values[AT["gyro"]] = t, count, gyro
    return values


@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: m.name)
def test_layout_dict_and_record_agree(message):
    values = samples.random_values(message, Random(1))
    frame = WireFrame(message, 0, pack(message, values))
    named = frame.as_dict()
    record = frame.record()
    assert list(named) == [f.name for f in message.fields]
    for name, at in layout(message.id).items():
        assert named[name] == frame.values()[at] == getattr(record, name)
    assert pack(message, named) == frame.payload
    with pytest.raises(FrozenInstanceError):
        setattr(record, message.fields[0].name, 0)


def test_records_are_named_after_their_message():
    assert type(WireFrame(BY_NAME["HELLO_REQ"], 0, bytes(6)).record()).__name__ == "HelloReq"


def test_si_values():
    si = WireFrame(STATE, 0, pack(STATE, state(4_000_000, 9, (900, -1800, 0)))).as_si()
    assert si["t_ck"] == 2.0
    assert si["enc_count"] == 9
    assert si["gyro"] == pytest.approx((1.0, -2.0, 0.0))


def test_log_text_is_padded_and_bounded():
    assert pack(LOG, (1, "ok")) == b"\x01ok  "
    assert pack(LOG, {"level": 1, "text": "x" * 49}) == b"\x01" + b"x" * 49
    assert pack(LOG, (1, "\u00b5")) == b"\x01?   "
    with pytest.raises(UsageError, match="49"):
        pack(LOG, (1, "x" * 50))
    with pytest.raises(UsageError):
        pack(LOG, (256, "text"))


@pytest.mark.parametrize(("values", "text"), [
    ({"proto": 1, "schema": 0}, "flags"),
    ({"proto": 1, "schema": 0, "flags": 0, "more": 1}, "more"),
    ((1, 0), "HELLO_REQ"), ((256, 0, 0), "HELLO_REQ"), ((1, 0, "a"), "HELLO_REQ")])
def test_wrong_values_are_named(values, text):
    with pytest.raises(UsageError, match=text):
        encode(BY_NAME["HELLO_REQ"], 0, values)


def test_arrays_must_have_their_length():
    named = WireFrame(STATE, 0, bytes(38)).as_dict()
    with pytest.raises(UsageError, match="gyro"):
        pack(STATE, named | {"gyro": (0, 0)})


def test_a_drive_passes_the_gates():
    decoder = FrameDecoder(UP, Gates())
    frames = samples.drive(10.0, seed=2)
    assert len(decoder.feed(b"".join(frames))) == len(frames)
    assert decoder.counters.implausible == 0


@pytest.mark.parametrize("bad", [
    state(20_000, 0), state(19_999, 0), state(2_000_000_000, 0), state(40_000, 1000),
    state(40_000, 2**32 - 5), state(40_000, 0, (31_501, 0, 0)), state(40_000, 0, (0, -32768, 0))])
def test_impossible_frames_are_refused_once(bad):
    decoder = FrameDecoder(UP, Gates())
    frames = [encode(STATE, i, v) for i, v in
              enumerate([state(20_000, 0), bad, state(60_000, 3), state(80_000, 4)])]
    assert [f.seq for f in decoder.feed(b"".join(frames))] == [0, 2, 3]
    assert (decoder.counters.implausible, decoder.counters.gaps) == (1, 1)
    assert len(FrameDecoder(UP).feed(b"".join(frames))) == 4


def test_the_limits_themselves_pass():
    gates = Gates(max_edge_rate=1000)
    assert gates.passes(state(0, 0))
    assert gates.passes(state(20_000, 11, (31_500, -31_500, 0)))
    assert not gates.passes(state(40_000, 11 + 12))


def test_a_noisy_sensor_is_no_reason_to_refuse_the_frame():
    """With a glitch rule of 0 the firmware counts up to 255 edges in each of three phases."""
    gates = Gates()
    assert all(gates.passes(state(20_000 * k, 765 * k)) for k in range(50))
    assert not gates.passes(state(20_000 * 50, 765 * 50 + 100)), "more than it can count"


def test_gates_follow_a_restart_after_one_frame():
    gates = Gates()
    verdicts = [gates.passes(state(t, c)) for t, c in
                ((9_000_000, 500), (9_020_000, 501), (50_000, 0), (70_000, 0), (90_000, 1))]
    assert verdicts == [True, True, False, True, True]


def test_a_frame_refused_long_ago_is_no_base():
    gates = Gates()
    verdicts = [gates.passes(state(t, 0)) for t in
                (20_000, 2_000_000_000, 40_000, 2_000_020_000, 60_000)]
    assert verdicts == [True, False, True, False, True]


def test_hello_has_the_gates_of_a_restart():
    decoder = FrameDecoder(UP, Gates())
    frames = samples.drive(5.0, 1) + samples.drive(1.0, 2, boot=2)
    assert len(decoder.feed(b"".join(frames))) == len(frames)


@given(st.integers(0, 2**40), st.lists(st.integers(0, 2**16 - 1), max_size=50))
def test_unwrapped_counters_run_on(start, steps):
    truth = np.cumsum([start, *steps])
    raw = truth & 0xFFFF
    offset = start - (start & 0xFFFF)
    assert unwrap(raw.astype(np.uint16), 16).tolist() == (truth - offset).tolist()


def test_unwrapping_nothing():
    assert unwrap(np.empty(0, np.uint32), 32).tolist() == []
