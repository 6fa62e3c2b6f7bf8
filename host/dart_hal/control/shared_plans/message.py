"""The message of a car that shares its plans, as bytes for the room of the fleet."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from math import isfinite
from struct import Struct, error
from typing import NamedTuple

from dart_hal.control.shared_plans.timed_plan import (
    MAX_KNOTS,
    MAX_LEVEL,
    TimedPlan,
)
from dart_hal.core.errors import UsageError

# Format of the bytes; head, plan and the part for each car.
PLAN_FORMAT = 1
MESSAGE_HEAD = Struct("<BIBBIIIIfB")
PLAN_HEAD = Struct("<BddB")
CAR_RECORD = Struct("<II")
# Largest number of cars: 253 bytes with two plans of ``MAX_KNOTS``.
MAX_CARS = 12
# Largest age of the first knot of a plan [s], and largest arc length [m].
MAX_PLAN_AGE = 1e5
MAX_ARC_LENGTH = 1e4
# Messages that are cached: cars of one process decode a message once, not once each.
MAX_CACHED_MESSAGES = 512


class PlanMessage(NamedTuple):
    """State of a car.

    id: number in the roster; boot: of this session; committed: the plan that it executes, adopted
    from its proposal ``version``; proposal: the plan that it would adopt, number ``number``, None
    if it has none; priority: of the proposal, the smaller one precedes; accepted: for each car the
    number of its proposal that was acknowledged last; heard: for each car its session, (n,) each.
    Times of the plans are seconds since the message was sent: negative in the past.
    """

    id: int
    boot: int
    seq: int
    version: int
    committed: TimedPlan
    number: int
    proposal: TimedPlan | None
    priority: float
    accepted: tuple[int, ...]
    heard: tuple[int, ...]


def encode(m: PlanMessage, key: int) -> bytes:
    """Return the bytes of a message. Raises UsageError for more than ``MAX_CARS``."""
    if len(m.accepted) > MAX_CARS:
        raise UsageError(
            "too many cars share their plans",
            found=f"{len(m.accepted)}",
            expected=f"at most {MAX_CARS}",
        )
    head = MESSAGE_HEAD.pack(
        PLAN_FORMAT,
        key,
        m.id,
        len(m.accepted),
        m.boot,
        m.seq & 0xFFFFFFFF,
        m.version,
        m.number,
        m.priority,
        m.proposal is not None,
    )
    plans = _encode_plan(m.committed) + (_encode_plan(m.proposal) if m.proposal else b"")
    return head + plans + b"".join(map(CAR_RECORD.pack, m.accepted, m.heard))


@lru_cache(maxsize=MAX_CACHED_MESSAGES)
def decode(data: bytes, key: int) -> PlanMessage | None:
    """Return the message in bytes, None if they are none of these cars. Never raises."""
    try:
        return _decode(data, key)
    except (error, IndexError, ValueError):
        return None


def _decode(data: bytes, key: int) -> PlanMessage:
    """Decode a message. Raises ValueError, IndexError, struct.error."""
    version, key_received, id_, n, boot, seq, plan_version, number, priority, proposes = (
        MESSAGE_HEAD.unpack_from(data)
    )
    if version != PLAN_FORMAT or key_received != key or not isfinite(priority):
        raise ValueError("another format, other paths or no number")
    committed, offset = _decode_plan(data, MESSAGE_HEAD.size)
    proposal = None
    if proposes:
        proposal, offset = _decode_plan(data, offset)
    if not boot or len(data) != offset + n * CAR_RECORD.size:
        raise ValueError("a wrong length")
    rows = list(CAR_RECORD.iter_unpack(data[offset:]))
    return PlanMessage(
        id_, boot, seq, plan_version, committed, number, proposal, priority,
        tuple(accepted for accepted, _ in rows), tuple(heard for _, heard in rows),
    )


def _encode_plan(plan: TimedPlan) -> bytes:
    """Return path, time, arc length, and the levels, two in a byte."""
    levels = (*plan.levels, 0)
    pairs = bytes(levels[k] | levels[k + 1] << 4 for k in range(0, len(levels) - 1, 2))
    return PLAN_HEAD.pack(plan.path, plan.t, plan.s, len(plan.levels)) + pairs


def _decode_plan(data: bytes, offset: int) -> tuple[TimedPlan, int]:
    """Return a plan and the offset of what follows. Raises ValueError, IndexError, struct.error."""
    path, t, s, n = PLAN_HEAD.unpack_from(data, offset)
    offset += PLAN_HEAD.size
    levels = tuple(data[offset + k // 2] >> 4 * (k % 2) & 15 for k in range(n))
    is_drivable = all(abs(b - a) <= 1 for a, b in pairwise(levels))
    if (
        not 0 < n <= MAX_KNOTS
        or max(levels) > MAX_LEVEL
        or levels[-1]
        or not is_drivable
        or not abs(t) < MAX_PLAN_AGE
        or not abs(s) < MAX_ARC_LENGTH
    ):
        raise ValueError("a plan that no car can execute")
    return TimedPlan(path, t, s, levels), offset + (n + 1) // 2
