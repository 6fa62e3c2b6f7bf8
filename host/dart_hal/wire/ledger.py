"""Count lost frames by the sequence numbers of the received ones.

1. The sender counts every frame of a direction, sent or dropped, in one 8-bit number.
2. Below 256 consecutive losses, the difference of two numbers is exact.
3. Above, the device time of STATE gives the number of wraps.
"""

from __future__ import annotations

from struct import Struct

from dart_hal.wire.messages import HELLO, STATE, TICKS_PER_SECOND

# Period of STATE frames [ticks].
STATE_PERIOD = TICKS_PER_SECOND // 100

# Silence between two STATE frames [ticks] below which 256 frames cannot fit: 1 s holds 100 STATE
# and some 20 others.
MAX_EXACT_SILENCE = 100 * STATE_PERIOD

# Silence [ticks] above which the other frames (2 to 12 per s) make the number of wraps ambiguous. A
# device time that runs backwards looks like a longer silence, too.
MAX_COUNTED_SILENCE = 30 * TICKS_PER_SECOND

# STATE frames that a busy Nano may omit without counting them.
MAX_SKIPPED_STATES = 16

# The sequence number has 8 bits.
SEQ_MODULUS = 256
MASK32 = 0xFFFF_FFFF
T_CK = Struct("<I")
_BOOT = Struct("<IH")
# Offset of board_id and boot_count in HELLO's payload.
_BOOT_AT = 14


def parse_boot(hello: bytes) -> tuple[int, int]:
    """Return (board_id, boot_count) of a HELLO payload: the identity of one run of a Nano."""
    board, count = _BOOT.unpack_from(hello, _BOOT_AT)
    return board, count


def count_wrapped(elapsed: int, counted: int) -> int:
    """Return the frames of the missed wraps (a multiple of 256).

    elapsed [ticks]: device time between two STATE frames; counted: frames between them, modulo 256.
    """
    # Smallest multiple of 256 with which the frames suffice for the elapsed time.
    short = elapsed // STATE_PERIOD - MAX_SKIPPED_STATES - counted
    return -(-short // SEQ_MODULUS) * SEQ_MODULUS if short > 0 else 0


class SequenceTracker:
    """Counts the lost frames of one direction of one link.

    lost: missing frames between the first and the last valid one; rebased: restarts of the count,
    by a boot or a silence above ``MAX_COUNTED_SILENCE``, whose losses are unknown.
    """

    __slots__ = ("_boot", "_index", "_seq", "_state_index", "_t", "lost", "rebased")

    def __init__(self) -> None:
        self.lost = 0
        self.rebased = 0
        self._index = 0
        self._seq = -1
        self._t = -1
        self._state_index = 0
        self._boot: tuple[int, int] | None = None

    def add_frame(self, message_id: int, seq: int, payload: bytes) -> None:
        """Add a valid frame, in the order of arrival."""
        # Frames since the last one, 1 to 256, by the sequence number alone.
        step = ((seq - self._seq - 1) & 0xFF) + 1 if self._seq >= 0 else 1
        self._seq = seq
        if message_id == STATE.id:
            (t,) = T_CK.unpack_from(payload)
            if self._t >= 0:
                elapsed = (t - self._t) & MASK32
                if elapsed > MAX_EXACT_SILENCE:
                    step = self._step_after_silence(elapsed, step)
            self._t = t
            self._state_index = self._index + step
        elif message_id == HELLO.id:
            step = self._step_after_hello(payload, step)
        self._index += step
        self.lost += step - 1

    def _step_after_silence(self, elapsed: int, step: int) -> int:
        """Return the frames since the last one after a long silence [ticks]."""
        if elapsed > MAX_COUNTED_SILENCE:
            self.rebased += 1
            return 1
        return step + count_wrapped(elapsed, self._index + step - self._state_index)

    def _step_after_hello(self, payload: bytes, step: int) -> int:
        """Return the frames since the last one; restart the count after a boot."""
        boot = parse_boot(payload)
        changed = self._boot is not None and boot != self._boot
        self._boot = boot
        if not changed:
            return step
        self.rebased += 1
        self._t = -1
        return 1
