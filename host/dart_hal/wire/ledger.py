"""How many frames were lost, from what arrived.

The sender counts every frame of a direction, sent or dropped, in one 8-bit
number. Below 256 consecutive losses the difference is exact; above, the
device time of STATE tells how often the number went round.
"""

from __future__ import annotations

from struct import Struct

from dart_hal.wire.messages import HELLO, STATE, TICKS_PER_SECOND

STATE_PERIOD = TICKS_PER_SECOND // 100
"""Ticks between two STATE frames."""

LONG = 100 * STATE_PERIOD
"""Silence between two STATE frames [ticks] below which 256 frames cannot fit:
1 s holds 100 STATE and some 20 others."""

LIMIT = 30 * TICKS_PER_SECOND
"""Silence [ticks] beyond which the other frames (2 to 12 per s) make the number
of rounds ambiguous; also what a device time that runs backwards looks like."""

SLACK = 16
"""STATE frames that a busy Nano may have left out without counting them."""

ROUND = 256
MASK32 = 0xFFFF_FFFF
T_CK = Struct("<I")
_BOOT = Struct("<IH")
_BOOT_AT = 14
"""Offset of board_id and boot_count in HELLO's payload."""


def boot_of(hello: bytes) -> tuple[int, int]:
    """(board_id, boot_count) of a HELLO payload: names one run of one Nano."""
    board, count = _BOOT.unpack_from(hello, _BOOT_AT)
    return board, count


def rounds(elapsed: int, counted: int) -> int:
    """Frames to add (a multiple of 256) so that ``counted`` fills ``elapsed`` ticks."""
    short = elapsed // STATE_PERIOD - SLACK - counted
    return -(-short // ROUND) * ROUND if short > 0 else 0


class Ledger:
    """Running account of one direction of one link.

    ``lost``: frames missing between the first and the last good one.
    ``rebased``: how often the count began anew (another boot, or a silence
    above ``LIMIT``), where what went missing cannot be told.
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

    def note(self, ident: int, seq: int, payload: bytes) -> None:
        """Enter one good frame, in the order of arrival."""
        step = ((seq - self._seq - 1) & 0xFF) + 1 if self._seq >= 0 else 1
        self._seq = seq
        if ident == STATE.id:
            (t,) = T_CK.unpack_from(payload)
            if self._t >= 0:
                elapsed = (t - self._t) & MASK32
                if elapsed > LONG:
                    step = self._silence(elapsed, step)
            self._t = t
            self._state_index = self._index + step
        elif ident == HELLO.id:
            step = self._hello(payload, step)
        self._index += step
        self.lost += step - 1

    def _silence(self, elapsed: int, step: int) -> int:
        if elapsed > LIMIT:
            self.rebased += 1
            return 1
        return step + rounds(elapsed, self._index + step - self._state_index)

    def _hello(self, payload: bytes, step: int) -> int:
        boot = boot_of(payload)
        changed = self._boot is not None and boot != self._boot
        self._boot = boot
        if not changed:
            return step
        self.rebased += 1
        self._t = -1
        return 1
