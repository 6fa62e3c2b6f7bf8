"""Check the rules of a set of definitions before files are generated.

Two definitions with different seeds never accept each other's frames, because the CRC is a
bijection of its initial value. All seeds must therefore differ.
"""

from __future__ import annotations

from collections.abc import Sequence

from dart_hal.core.errors import UsageError
from dart_hal.wire.messages import (
    LOG_TEXT_MIN,
    MAX_BLOCK,
    MESSAGES,
    RETIRED,
    SEED_FOREVER,
    Message,
)

FOREVER = ("HELLO", "HELLO_REQ")
# Ids of messages from and to the Nano.
_UP = range(0x01, 0x40)
_DOWN = range(0x40, 0x80)


def min_size(message: Message) -> int:
    """Return the smallest payload [B]: the size, except of LOG, whose text may be shorter."""
    return 1 + LOG_TEXT_MIN if message.variable else message.size


def check(messages: Sequence[Message] = MESSAGES,
          retired: Sequence[tuple[str, int]] = RETIRED) -> None:
    """Raise UsageError if ids, directions, sizes or seeds violate a rule."""
    _check_ids(messages)
    _check_seeds(messages, retired)


def _check_ids(messages: Sequence[Message]) -> None:
    by_id: dict[int, Message] = {}
    for m in messages:
        if m.id in by_id:
            raise UsageError(f"{m.name} and {by_id[m.id].name} share the id {m.id:#04x}")
        by_id[m.id] = m
        allowed = _DOWN if m.dir == "down" and m.name != "HELLO_REQ" else _UP
        if m.id not in allowed:
            raise UsageError(f"{m.name}: id {m.id:#04x} is not one of direction {m.dir!r}")
        if m.wire_size > MAX_BLOCK or m.size + 4 >= 254:
            raise UsageError(f"{m.name}: {m.size} B do not fit into one COBS block")


def _check_seeds(messages: Sequence[Message], retired: Sequence[tuple[str, int]]) -> None:
    taken: dict[int, str] = {SEED_FOREVER: "HELLO and HELLO_REQ"}
    for m in messages:
        if m.name in FOREVER:
            continue
        if m.seed in taken:
            raise UsageError(f"the seed {m.seed:#06x} of {m.name} is also that of {taken[m.seed]}",
                             remedy="rename a field of the newer definition")
        taken[m.seed] = m.name
    texts = {m.text for m in messages}
    for text, seed in retired:
        if seed != SEED_FOREVER and seed in taken and text not in texts:
            raise UsageError(f"the seed {seed:#06x} of {taken[seed]} is that of the retired "
                             f"definition {text.split(';')[0]!r}",
                             remedy="rename a field of the newer definition")
