"""Traffic and damage to test with: what a drive sends, what a bad line makes of it."""

from __future__ import annotations

from collections.abc import Callable
from random import Random
from typing import Any

from dart_hal.wire.codec import encode
from dart_hal.wire.ledger import STATE_PERIOD
from dart_hal.wire.messages import (
    DIAG,
    EVENT,
    HELLO,
    LOG,
    MESSAGES,
    PROTO,
    SCHEMA,
    STATE,
    TICKS_PER_SECOND,
    TIME_PONG,
    Message,
)

_RANGES = {"u8": (0, 0xFF), "u16": (0, 0xFFFF), "u32": (0, 0xFFFF_FFFF), "i16": (-32768, 32767)}
_WRAP = 0xFFFF_FFFF


def random_values(message: Message, rng: Random) -> tuple[Any, ...]:
    """Values in wire order, anywhere in their ranges."""
    if message.variable:
        text = bytes(rng.randrange(32, 127) for _ in range(rng.randrange(4, message.size)))
        return rng.randrange(4), text
    return tuple(rng.randint(*_RANGES[f.type]) for f in message.fields for _ in range(f.count))


def mix_frames(count: int, seed: int) -> list[bytes]:
    """``count`` frames of every message in turn, random values, seq from 0."""
    rng = Random(seed)
    return [encode(m, i, random_values(m, rng))
            for i in range(count) for m in (rng.choice(MESSAGES),)]


def drive(seconds: float, seed: int = 0, boot: int = 1) -> list[bytes]:
    """Frames of the Nano in the order of a drive: HELLO, STATE at 100 Hz, the rest between."""
    rng = Random(seed)
    frames: list[bytes] = []

    def send(message: Message, *values: Any) -> None:
        frames.append(encode(message, len(frames), values))

    send(HELLO, PROTO, 0, SCHEMA, 0, 1, 0, 0, 0, 0xC0FFEE, boot, 1, 2, 0x1234, 20, 10, 0,
         TICKS_PER_SECOND, 0x5678)
    count = 0.0
    rate = 0.0
    for i in range(round(seconds * 100)):
        t = (i + 20) * STATE_PERIOD & _WRAP
        rate = min(max(rate + rng.gauss(0, 30), 0), 1500)
        count += rate / 100
        send(STATE, *_state(t, int(count), rate, rng))
        if i % 50 == 10:
            send(TIME_PONG, i // 50 & 0xFFFF, t // 2, t + 400 & _WRAP, t + 900 & _WRAP, 0)
        if i % 50 == 30:
            send(DIAG, t, i & 0xFFFF, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1500, 0, 900, 4980, boot)
        if i % 1000 == 500:
            send(EVENT, t, 6, i // 1000 & 0xFF, 0)
            send(LOG, 1, b"parameter written")
    return frames


def _state(t: int, count: int, rate: float, rng: Random) -> tuple[int, ...]:
    interval = min(int(TICKS_PER_SECOND / rate), 0xFFFF) if rate > 1 else 0xFFFF
    imu = [round(rng.gauss(0, 60)) for _ in range(6)]
    return (t, count, t - interval // 2 & _WRAP, interval, 0, 0, *imu,
            400 + rng.randrange(50), 0x3F, 0x0C01, rng.randrange(20))


Fault = Callable[[bytes, Random], bytes]


def flip_bits(bits: int) -> Fault:
    """Invert so many different bits."""
    def fault(data: bytes, rng: Random) -> bytes:
        value = int.from_bytes(data, "little")
        for at in rng.sample(range(8 * len(data)), bits):
            value ^= 1 << at
        return value.to_bytes(len(data), "little")
    return fault


def change_byte(data: bytes, rng: Random) -> bytes:
    """Replace one byte by another value."""
    at = rng.randrange(len(data))
    return data[:at] + bytes((data[at] ^ rng.randrange(1, 256),)) + data[at + 1:]


def drop_byte(data: bytes, rng: Random) -> bytes:
    """Lose one byte."""
    at = rng.randrange(len(data))
    return data[:at] + data[at + 1:]


def double_byte(data: bytes, rng: Random) -> bytes:
    """Receive one byte twice."""
    at = rng.randrange(len(data))
    return data[:at + 1] + data[at:]


def burst(length: int) -> Fault:
    """Replace so many neighbours by noise."""
    def fault(data: bytes, rng: Random) -> bytes:
        at = rng.randrange(len(data) - length + 1)
        return data[:at] + rng.randbytes(length) + data[at + length:]
    return fault


SMALL_FAULTS: dict[str, Fault] = {
    "1 bit": flip_bits(1), "2 bits": flip_bits(2), "3 bits": flip_bits(3),
    "changed": change_byte, "dropped": drop_byte, "doubled": double_byte,
}
"""Faults of which none may pass the CRC."""
