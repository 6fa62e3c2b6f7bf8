"""The watchdog's modes against the data sheet of the ATmega328P.

"The first time-out in the Watchdog Timer will set WDIF ... If the interrupt is
not executed before the next time-out, a System Reset will be applied" (WDIE).
"""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.emulator

WATCHDOG_S = 0.016
"""s, 2048 cycles of 128 kHz: the shortest, WDP = 0."""
WDE = 0x08
WDIE = 0x40
RESET = b"B\x08\x00"
"""Boot message after a watchdog reset."""


def answer(nano, how, mode, seconds):
    """What the program sends within ``seconds`` once it loops, and when the first came."""
    nano.write(how + bytes([mode]))
    nano.drain(nano.now + 60e-6)  # three bytes at 500 kbaud: now the loop begins
    start = nano.now
    sent = b""
    first = None
    while nano.now < start + seconds:
        nano.run(min(nano.now + 1e-4, start + seconds))
        for data, t in nano.read():
            first = t - start if first is None else first
            sent += data
    return sent, first


@pytest.mark.parametrize(("mode", "periods"), [(WDE, 1), (WDE | WDIE, 2)])
def test_a_hang_with_interrupts_off_ends_where_wde_is_set(nano, mode, periods):
    sent, first = answer(nano, b"l", mode, 0.1)
    assert sent == RESET
    assert first == pytest.approx(periods * WATCHDOG_S, abs=3e-4)


def test_a_hang_with_interrupts_off_stays_in_interrupt_mode(nano):
    """The control: WDIE alone can never reset."""
    sent, _ = answer(nano, b"l", WDIE, 0.5)
    assert sent == b""


def test_both_modes_interrupt_first_and_then_reset(nano):
    sent, first = answer(nano, b"m", WDE | WDIE, 0.1)
    assert sent == b"K" + RESET
    assert first == pytest.approx(WATCHDOG_S, abs=3e-4)


def test_interrupt_mode_goes_on_interrupting(nano):
    sent, _ = answer(nano, b"m", WDIE, 10.5 * WATCHDOG_S)
    assert sent == 10 * b"K"


def test_wde_alone_resets_with_interrupts_on(nano):
    assert answer(nano, b"m", WDE, 0.1)[0] == RESET


def test_wde_is_cleared_only_with_the_key(nano):
    nano.ask(b"r\x60\x08", 0.0005)  # WDE by a plain write: that is allowed
    nano.ask(b"r\x60\x00", 0.0005)  # and this is not
    assert nano.ask(b"s\x60", 0.0005) == b"\x08"
    assert nano.drain(nano.now + 0.05) == RESET


def test_a_freeze_lasts_until_the_watchdog_bites(make_nano):
    for mode, bites in ((WDE | WDIE, True), (WDIE, False)):
        nano = make_nano()
        nano.write(b"m" + bytes([mode]))
        nano.drain(nano.now + 0.002)
        nano.freeze()
        assert (nano.drain(nano.now + 0.2) == RESET) is bites
