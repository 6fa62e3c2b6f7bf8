"""The specification itself: sizes, ids, seeds and what the generator refuses."""

from dataclasses import replace
from itertools import count

import pytest

from dart_hal.core.errors import UsageError
from dart_hal.wire import messages as spec
from dart_hal.wire.codec import encode
from dart_hal.wire.crc import crc16
from dart_hal.wire.messages import BY_NAME, MESSAGES, STATE, Message
from dart_hal.wire.rules import check

PAYLOADS = {
    "HELLO": 34, "HELLO_REQ": 6, "STATE": 38, "DIAG": 32, "TIME_PONG": 16, "EVENT": 10,
    "EDGES": 24, "LOG": 50, "PARAM_VALUE": 8, "CAPTURE": 18, "RC": 14, "BATTERY": 10,
    "HEARTBEAT": 10, "TIME_PING": 6,
    "PARAM_GET": 2, "PARAM_SET": 8, "REBOOT": 6, "EDGES_REQ": 2, "CAPTURE_REQ": 2,
}


def fresh(message: Message, **changes) -> Message:
    """The message with other attributes; seed and text are computed again."""
    return replace(message, **changes)


def with_field(message: Message, index: int, **changes) -> Message:
    fields = list(message.fields)
    fields[index] = replace(fields[index], **changes)
    return fresh(message, fields=tuple(fields))


def same_seed_as(message: Message, other: Message) -> Message:
    """``other`` with a field renamed until its seed is that of ``message``."""
    for number in count():
        candidate = with_field(other, 0, name=f"f{number}")
        if candidate.seed == message.seed:
            return candidate


def test_payload_sizes():
    assert {m.name: m.size for m in MESSAGES} == PAYLOADS


def test_golden_hello_req():
    frame = encode(BY_NAME["HELLO_REQ"], 0, {"proto": 1, "schema": 0, "flags": 0})
    assert frame == bytes.fromhex("02 02 02 01 01 01 01 01 03 38 FB 00")


def test_crc_check_values():
    assert crc16(b"123456789") == 0x29B1
    assert crc16(bytes(range(40))) == 0x0476


@pytest.mark.parametrize("changes", [
    {"name": "other"}, {"type": "u64"}, {"count": 2}, {"scale": 0.25}, {"unit": "m"}])
@pytest.mark.parametrize("index", range(len(STATE.fields)))
def test_seed_follows_every_part_of_the_definition(changes, index):
    assert with_field(STATE, index, **changes).seed != STATE.seed


def test_seed_follows_order_id_and_direction():
    swapped = (STATE.fields[1], STATE.fields[0], *STATE.fields[2:])
    for other in (fresh(STATE, fields=swapped), fresh(STATE, id=0x11), fresh(STATE, dir="down")):
        assert other.seed != STATE.seed


def test_seed_does_not_follow_the_words():
    assert with_field(STATE, 0, doc="another sentence").seed == STATE.seed
    assert fresh(STATE, doc="another sentence", rate="50 Hz").seed == STATE.seed


def test_the_definitions_pass():
    check()


@pytest.mark.slow
def test_equal_seeds_are_refused():
    twin = same_seed_as(STATE, BY_NAME["DIAG"])
    messages = [twin if m.name == "DIAG" else m for m in MESSAGES]
    with pytest.raises(UsageError, match="also that of STATE"):
        check(messages)


def test_the_seed_of_a_retired_definition_is_refused():
    old = same_seed_as(STATE, BY_NAME["EVENT"])
    check(retired=[(old.text, old.seed ^ 1)])
    with pytest.raises(UsageError, match="retired"):
        check(retired=[(old.text, old.seed)])
    check(retired=[(STATE.text, STATE.seed)])


@pytest.mark.parametrize(("name", "changes"), [
    ("DIAG", {"id": 0x10}), ("DIAG", {"id": 0x41}), ("HEARTBEAT", {"id": 0x11}),
    ("DIAG", {"fields": (spec.MessageField("x", "u8", "", count=251),)})])
def test_bad_ids_and_lengths_are_refused(name, changes):
    messages = [fresh(m, **changes) if m.name == name else m for m in MESSAGES
                if m.name == name or m.id != changes.get("id") or m.name == "STATE"]
    with pytest.raises(UsageError):
        check(messages)


def test_parameters_count_from_one_and_hold_their_defaults():
    assert [p.id for p in spec.PARAMS] == list(range(1, len(spec.PARAMS) + 1))
    assert all(p.low <= p.default <= p.high for p in spec.PARAMS)
