"""The ELF in simavr: heartbeat to pins, watchdog, resets, parameters."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import pytest
from firmware_rig import BOARD_ID, FLAG, Rig, build_patched, eeprom_image

from dart_hal.core.errors import DartHalError
from dart_hal.devices.links.boot import BOOTS
from dart_hal.wire.messages import CAPS

pytestmark = pytest.mark.emulator
Make = Callable[..., Rig]
NONE, ENABLE, MUX = range(3)
DISARMED, ARMED, RAW, STOP = range(4)
LIVE_FLAG = FLAG["OUTPUT_LIVE"]
TRIPPED = FLAG["TRIPPED"]
BEAT_OK = FLAG["BEAT_OK"]
SAFETY_OUT = 7
WDT_RESET = 8
BAUD = 9
EDGES_A = 1
WDTCSR = 0x60
MUTE = ("  uint8_t const tail = tx_tail;\n",
        "  uint8_t const tail = tx_tail;\n  if (slots_begun() >= 150) {\n"
        "    UCSR0B = static_cast<uint8_t>(UCSR0B & ~_BV(UDRIE0));\n    return;\n  }\n")
LONGEST_BLOCK = 2 * 12.5e-6
"""s: two interrupts of at most 200 cycles before one is served."""


def make_linked(nano: Make, cutoff: int, **params: int) -> Rig:
    rig = nano(eeprom=eeprom_image(safety_out=cutoff, **params))
    rig.run(0.5)
    rig.beat(0.6, DISARMED)
    return rig


def live(nano: Make, cutoff: int, **params: int) -> Rig:
    rig = make_linked(nano, cutoff, **params)
    rig.beat(0.1, ARMED)
    assert rig.state()["flags"] & LIVE_FLAG
    rig.nano.pin_log()
    return rig


def supervisor_events(rig: Rig) -> list[tuple[int, int]]:
    events: dict[int, int] = {v["count"]: v["arg"] for _, n, v in rig.frames
                              if n == "EVENT" and v["code"] == 2}
    return [(arg >> 8, arg & 0xFF) for arg in events.values()]


def test_the_states_up_to_live_are_reported(nano: Make) -> None:
    rig = live(nano, NONE)
    rig.run(0.3)
    assert supervisor_events(rig) == [(0, 1), (1, 2), (2, 3), (3, 4)]
    assert rig.state()["flags"] & TRIPPED
    assert not rig.state()["flags"] & (LIVE_FLAG | BEAT_OK)
    assert rig.state()["beat_age"] == 255


def test_oe_is_enabled_when_linked_and_cut_120_ms_after_the_last_beat(nano: Make) -> None:
    rig = nano(eeprom=eeprom_image(safety_out=ENABLE))
    rig.run(0.5)
    assert rig.nano.pins()["D6"] == 0
    rig.beat(0.6, DISARMED)
    assert rig.nano.pins()["D6"] == 1
    rig.beat(0.1, ARMED)
    last = rig.now - 0.02 + 16 * 20e-6  # its delimiter
    rig.nano.pin_log()
    rig.run(0.3)
    (cut,) = [e for e in rig.nano.pin_log() if e.pin == "D6"]
    assert cut.level == 0
    assert 0.110 <= cut.t - last <= 0.120


@pytest.mark.parametrize(("board_high", "limit"), [(False, 0.002), (True, 0.005)])
def test_stop_cuts_at_once_or_after_the_pulse(nano: Make, board_high: bool, limit: float) -> None:
    """While D8 shows a pulse of the PCA9685, /OE waits for its end: 3 ms."""
    rig = live(nano, ENABLE)
    rig.nano.set_pin("D8", board_high)
    begin = rig.now
    rig.beat(0.02, STOP)
    (cut,) = [e for e in rig.nano.pin_log() if e.pin == "D6"]
    assert cut.level == 0
    assert limit - 0.002 <= cut.t - begin < limit


def test_the_multiplexer_switches_only_while_our_pulse_is_low(nano: Make) -> None:
    rig = make_linked(nano, MUX)
    rig.nano.set_pin("D8", False)
    rig.beat(0.2, ARMED)
    last = rig.now - 0.02 + 16 * 20e-6
    rig.run(0.5)
    log = rig.nano.pin_log()
    pulse = [(e.t, e.level) for e in log if e.pin == "D9" and e.level is not None]
    selects = [(e.t, e.level) for e in log if e.pin == "D5" and e.t > 0.1]
    assert [level for _, level in selects] == [1, 0]
    for t, _ in selects:
        before = [level for at, level in pulse if at <= t]
        after = [at for at, level in pulse if at > t and level]
        assert before[-1] == 0
        assert after[0] - t > 0.01
    assert 0.110 <= selects[1][0] - last <= 0.140


def test_our_pulse_is_1500_us_each_20_ms(nano: Make) -> None:
    rig = make_linked(nano, MUX)
    rig.nano.pin_log()
    rig.beat(1.0, DISARMED)
    pulse = [(e.t, e.level) for e in rig.nano.pin_log() if e.pin == "D9"]
    rises = [t for t, level in pulse if level]
    widths = [b[0] - a[0] for a, b in itertools.pairwise(pulse) if a[1]]
    assert all(w == pytest.approx(1.5e-3, abs=1e-6) for w in widths)
    assert len(widths) > 45
    # an interrupt begins each pulse, 18.5 ms after the hardware has ended the last one
    assert all(0.020 <= b - a <= 0.020 + LONGEST_BLOCK for a, b in itertools.pairwise(rises))


def test_without_the_option_no_pin_is_driven(nano: Make) -> None:
    rig = live(nano, NONE)
    assert {rig.nano.pins()[p] for p in ("D5", "D6", "D9")} == {None}
    assert rig.hello()["caps"] == 1 << CAPS.index("CAPTURE") | 1 << CAPS.index("GYRO_LOOK")


@pytest.mark.parametrize("wrong", [0, 1])
def test_a_wrong_token_never_arms(nano: Make, wrong: int) -> None:
    rig = nano(eeprom=eeprom_image(safety_out=ENABLE))
    rig.run(0.5)
    rig.beat(1.5, ARMED, token=rig.hello()["boot_nonce"] ^ 0x55 if wrong else 0)
    assert rig.nano.pins()["D6"] == 0
    assert not rig.state()["flags"] & LIVE_FLAG
    assert rig.state()["flags"] & BEAT_OK


def test_the_token_of_the_last_boot_is_void_after_a_reset(nano: Make) -> None:
    rig = live(nano, ENABLE)
    token = rig.hello()["boot_nonce"]
    rig.nano.reset("external")
    rig.run(0.5)
    rig.beat(1.5, ARMED, token=token)
    assert rig.nano.pins()["D6"] == 0
    assert rig.hello()["boot_count"] == 6


def test_three_trips_lock_until_a_reset(nano: Make) -> None:
    rig = make_linked(nano, ENABLE)
    for _ in range(3):
        rig.beat(0.1, ARMED)
        rig.run(0.2)
        rig.beat(0.7, DISARMED)
    rig.beat(1.0, ARMED)
    assert supervisor_events(rig)[-1] == (4, 5)
    assert rig.nano.pins()["D6"] == 0
    rig.nano.reset("external")
    rig.frames.clear()
    rig.run(0.5)
    rig.beat(0.7, DISARMED)
    rig.beat(0.1, ARMED)
    assert rig.state()["flags"] & LIVE_FLAG


def test_direction_change_while_rolling_is_ambiguous(nano: Make) -> None:
    rig = make_linked(nano, NONE)
    rig.nano.set_wheel(10)
    rig.beat(0.3, ARMED, flags=1)
    assert not rig.state()["flags"] & FLAG["ENC_AMBIGUOUS"]
    rig.beat(0.1, ARMED, flags=2)
    assert rig.state()["flags"] & FLAG["ENC_AMBIGUOUS"]
    rig.nano.set_wheel(0)
    rig.beat(0.3, ARMED, flags=2)
    assert not rig.state()["flags"] & FLAG["ENC_AMBIGUOUS"]


# --- watchdog and resets -----------------------------------------------------

def test_a_hang_cuts_within_80_ms_and_is_reported_after_the_reset(nano: Make) -> None:
    rig = live(nano, ENABLE)
    begin = rig.now
    rig.nano.hang()
    rig.run(0.2)
    (cut,) = [e for e in rig.nano.pin_log() if e.pin == "D6"]
    assert cut.level == 0
    assert cut.t - begin <= 0.080
    silent = len(rig.states())
    rig.run(0.5)
    assert len(rig.states()) == silent  # no reset by itself: ATmegaBOOT would not end it
    rig.nano.reset("external")
    new = rig.run(0.8)
    hello = next(v for _, n, v in new if n == "HELLO")
    assert hello["reset_cause"] == 0x12
    assert hello["boot_count"] == 6
    assert any(n == "EVENT" and v["code"] == 8 for _, n, v in new)
    assert rig.state()["flags"] & FLAG["WATCHDOG_LAST_BOOT"]
    rig.nano.reset("external")
    rig.run(0.4)
    assert not rig.state()["flags"] & FLAG["WATCHDOG_LAST_BOOT"]


def test_our_own_pulse_outlives_the_hang(nano: Make) -> None:
    rig = live(nano, MUX)
    rig.nano.hang()
    rig.run(0.5)
    log = rig.nano.pin_log()
    rises = [e.t for e in log if e.pin == "D9" and e.level == 1]
    assert rises[-1] > rig.now - 0.021
    assert [e.level for e in log if e.pin == "D5"] == [0]


def test_with_wdt_reset_the_nano_restarts_by_itself(nano: Make) -> None:
    rig = optiboot(nano, ENABLE, wdt_reset=1)
    rig.nano.hang()
    rig.run(0.14)  # 64 ms to the interrupt, 64 ms to the reset
    rig.nano.hang(False)
    new = rig.run(0.5)
    hello = next(v for _, n, v in new if n == "HELLO")
    assert hello["reset_cause"] == 0x10  # Optiboot keeps WDRF for itself, RAM has the mark
    assert hello["caps"] & 16
    assert rig.nano.pins()["D6"] == 0


def optiboot(nano: Make, cutoff: int, **params: int) -> Rig:
    """LIVE, on a board that has started through Optiboot."""
    rig = nano(eeprom=eeprom_image(safety_out=cutoff, **params))
    rig.nano.set_boot(BOOTS["optiboot"])
    rig.nano.reset("power")
    rig.run(1.6)
    rig.beat(0.6, DISARMED)
    rig.beat(0.1, ARMED)
    assert rig.hello()["bootloader"] == 2
    assert rig.state()["flags"] & LIVE_FLAG
    rig.nano.pin_log()
    return rig


# A hang with interrupts off: nothing but the watchdog's reset lets go of the pins.

@pytest.mark.parametrize("cutoff", [ENABLE, MUX])
def test_a_freeze_lets_go_of_the_pins(nano: Make, cutoff: int) -> None:
    rig = optiboot(nano, cutoff)
    begin = rig.now
    rig.nano.freeze()
    for _ in range(10):
        rig.run(0.01)
        rig.send("HEARTBEAT", arm_token=rig.hello()["boot_nonce"], mode=ARMED)
    pin = "D6" if cutoff == ENABLE else "D5"
    off = [e.t for e in rig.nano.pin_log() if e.pin == pin and not e.level]
    assert 0.05 <= off[0] - begin <= 0.075
    rig.frames.clear()
    rig.run(0.5)
    assert rig.hello()["boot_count"] == 6  # runs again, disarmed
    assert not rig.nano.pins()[pin]


def test_without_a_cutoff_a_freeze_stays_as_it_is(nano: Make) -> None:
    """The control, and the decision: no pin to let go of, the next open resets the board."""
    rig = optiboot(nano, NONE)
    rig.nano.freeze()
    rig.frames.clear()
    assert not [n for _, n, _ in rig.run(0.5) if n == "HELLO"]


def test_with_the_old_bootloader_a_freeze_ends_in_resets_with_released_pins(nano: Make) -> None:
    try:
        rig = nano(bootloader=True, eeprom=eeprom_image(safety_out=MUX))
    except DartHalError as error:
        pytest.skip(f"no ATmegaBOOT: {error}")
    rig.run(2.0)
    rig.beat(0.6, DISARMED)
    rig.nano.set_pin("D8", False)
    rig.beat(0.1, ARMED)
    assert rig.nano.pins()["D5"] == 1
    rig.nano.pin_log()
    begin = rig.now
    rig.nano.freeze()
    rig.run(2.0)
    log = rig.nano.pin_log()
    assert next(e.t for e in log if e.pin == "D5") - begin <= 0.075
    assert not [e for e in log if e.pin in ("D5", "D6", "D9") and e.level and e.t > begin + 0.08]
    assert {rig.nano.pins()[p] for p in ("D5", "D6", "D9")} == {None}


def test_a_loop_hang_with_the_old_bootloader_stays_and_does_not_reset(nano: Make) -> None:
    rig = live(nano, ENABLE)
    rig.nano.hang()
    rig.run(1.0)
    assert [e.level for e in rig.nano.pin_log() if e.pin == "D6"] == [0]
    assert rig.nano.pins()["D6"] == 0  # driven low, not released: no reset came


def test_the_interrupt_cuts_without_loop_and_watchdog(nano: Make) -> None:
    rig = live(nano, ENABLE)
    last = rig.now - 0.02 + 16 * 20e-6
    rig.nano.hang()
    for _ in range(200):
        rig.nano.poke(WDTCSR, 0)  # the slot interrupt would switch it on
        rig.run(0.001)
    (cut,) = [e for e in rig.nano.pin_log() if e.pin == "D6"]
    assert cut.level == 0
    assert 0.110 <= cut.t - last <= 0.120


@pytest.mark.slow
def test_a_dead_transmitter_starves_the_watchdog(nano: Make, elf: Path, tmp_path: Path) -> None:
    """Beats come, the loop runs, nothing is sent any more from 2 s on."""
    rig = nano(build_patched(tmp_path, ("src/board/uart.cpp", MUTE[0], MUTE[1])),
               eeprom=eeprom_image(safety_out=ENABLE))
    rig.run(0.5)
    rig.beat(0.6, DISARMED)
    rig.beat(1.2, ARMED)
    begin = len(rig.states())
    # D8 is open, and high by its pull-up: /OE was switched on after a look of 2.4 us.
    on, look, on_again, cut = [e for e in rig.nano.pin_log() if e.pin == "D6" and e.t > 1.0]
    assert (on.level, look.level, on_again.level, cut.level) == (1, 0, 1, 0)
    assert look.t - on.t < 5e-6
    assert cut.t - rig.frames[-1][0] <= 0.080
    assert 100 < begin < 180


@pytest.mark.parametrize(("cause", "bit"), [("external", 2), ("power", 1), ("brownout", 4)])
def test_reset_causes(nano: Make, cause: str, bit: int) -> None:
    rig = nano()
    rig.run(0.5)
    rig.nano.reset(cause)
    new = rig.run(0.2)
    assert next(v for _, n, v in new if n == "HELLO")["reset_cause"] & bit


def test_reboot_on_request(nano: Make) -> None:
    rig = live(nano, ENABLE)
    rig.send("REBOOT", magic=0, kind=1)
    rig.run(0.05)
    assert not any(n == "HELLO" for _, n, _ in rig.run(0.05))
    rig.send("REBOOT", magic=0x44415254, kind=1)
    new = rig.run(0.5)
    hello = next(v for _, n, v in new if n == "HELLO")
    assert hello["boot_count"] == 6
    assert hello["board_id"] == BOARD_ID
    assert rig.nano.pins()["D6"] == 0
    assert any(s["enc_count"] == 0 for s in rig.states())


@pytest.mark.slow
def test_the_old_bootloader_hands_over_and_is_found_again(nano: Make) -> None:
    try:
        rig = nano(bootloader=True)
    except DartHalError as error:
        pytest.skip(f"no ATmegaBOOT: {error}")
    rig.run(2.5)
    first = next(t for t, n, _ in rig.frames if n == "STATE")
    assert 1.2 <= first <= 1.6
    assert rig.hello()["bootloader"] == 1
    rig.send("REBOOT", magic=0x44415254, kind=2)
    rig.frames.clear()
    rig.run(0.5)
    assert not rig.frames  # the bootloader listens
    rig.run(2.0)
    assert rig.states()
    assert rig.hello()["boot_count"] == 6


# --- parameters and identity ---------------------------------------------------

def test_parameters_survive_a_reset(nano: Make) -> None:
    rig = nano()
    rig.run(0.5)
    assert rig.state()["flags"] & FLAG["PARAM_DEFAULTS"]
    before = rig.hello()["param_crc"]
    answer = rig.ask("PARAM_SET", "PARAM_VALUE", id=EDGES_A, value=18)
    assert (answer["status"], answer["value"]) == (0, 18)
    rig.run(0.3)
    rig.nano.reset("power")
    rig.run(0.5)
    hello = rig.hello()
    assert hello["edges_per_rev"] == (18, 10)
    assert hello["param_crc"] != before
    assert not rig.state()["flags"] & FLAG["PARAM_DEFAULTS"]
    assert any(n == "EVENT" and v["code"] == 6 for _, n, v in rig.frames)


@pytest.mark.slow_except("0", "80", "105")
@pytest.mark.parametrize("after_ms", [0, 1, 5, 20, 50, 80, 95, 100, 105, 110, 120])
def test_what_was_confirmed_survives_a_reset_at_any_moment(nano: Make, after_ms: int) -> None:
    rig = nano(eeprom=eeprom_image(safety_out=NONE))
    rig.run(0.5)
    rig.send("PARAM_SET", id=SAFETY_OUT, value=MUX)
    confirmed = any(n == "PARAM_VALUE" for _, n, _ in rig.run(after_ms / 1000))
    rig.send("REBOOT", magic=0x44415254, kind=1)
    rig.frames.clear()
    rig.run(0.5)
    rig.frames.clear()
    assert rig.hello()["boot_count"] == 6
    multiplexer = bool(rig.hello()["caps"] & 8)
    assert multiplexer or not confirmed
    assert not (multiplexer and after_ms <= 50)  # the control: too early, and not confirmed
    assert confirmed or after_ms < 120


def test_refused_parameters(nano: Make) -> None:
    rig = nano()
    rig.run(0.5)
    refused = {}
    for id, value in ((EDGES_A, 1), (BAUD, 250_000), (99, 0)):
        seq = rig.seq
        answer = rig.ask("PARAM_SET", "PARAM_VALUE", id=id, value=value)
        assert answer["req_seq"] == seq
        refused[id] = (answer["status"], answer["value"])
    assert refused == {EDGES_A: (2, 20), BAUD: (2, 500_000), 99: (1, 0)}
    first = rig.send("PARAM_SET", id=EDGES_A, value=30)
    rig.send("PARAM_SET", id=EDGES_A, value=31)
    answers = [v for _, n, v in rig.run(0.2) if n == "PARAM_VALUE"]
    assert [(a["status"], a["value"]) for a in answers] == [(3, 30), (0, 30)]
    assert answers[1]["req_seq"] == first


def test_wdt_reset_is_refused_unless_optiboot_is_there(nano: Make) -> None:
    rig = nano()
    rig.run(0.5)
    assert rig.hello()["bootloader"] == 1  # ATmegaBOOT, or none: it cannot be known
    assert rig.ask("PARAM_SET", "PARAM_VALUE", id=WDT_RESET, value=1)["status"] == 2
    assert rig.ask("PARAM_SET", "PARAM_VALUE", id=WDT_RESET, value=0)["status"] == 0
    rig = optiboot(nano, NONE)
    assert rig.ask("PARAM_SET", "PARAM_VALUE", id=WDT_RESET, value=1)["status"] == 0


def test_a_stored_wdt_reset_is_not_obeyed_on_the_old_bootloader(nano: Make) -> None:
    rig = live(nano, ENABLE, wdt_reset=1)
    assert not rig.hello()["caps"] & 16
    rig.nano.hang()
    rig.run(0.5)
    assert [e.level for e in rig.nano.pin_log() if e.pin == "D6"] == [0]
    assert rig.nano.pins()["D6"] == 0


@pytest.mark.parametrize("nth", [1, 2, 10, 27, 28])
def test_a_torn_byte_leaves_the_old_parameters(nano: Make, nth: int) -> None:
    rig = nano(eeprom=eeprom_image(safety_out=ENABLE))
    rig.run(0.5)
    rig.nano.tear_eeprom(nth)
    rig.send("PARAM_SET", id=SAFETY_OUT, value=MUX)
    assert not any(n == "PARAM_VALUE" and v["status"] == 0 for _, n, v in rig.run(0.3))
    rig.frames.clear()
    rig.run(0.5)
    assert rig.hello()["caps"] & 12 == 4
    assert not rig.state()["flags"] & FLAG["PARAM_DEFAULTS"]


def test_two_torn_records_leave_defaults_no_driven_pin_and_a_flag(nano: Make) -> None:
    image = bytearray(eeprom_image(safety_out=MUX))
    image[0xA8] ^= 0x10
    image[0xC0:0xC8] = image[0xA0:0xA8]
    rig = nano(eeprom=bytes(image))
    rig.run(0.5)
    assert rig.state()["flags"] & FLAG["PARAM_DEFAULTS"]
    rig.beat(0.7, DISARMED)
    rig.beat(0.1, ARMED)
    assert {rig.nano.pins()[p] for p in ("D5", "D6", "D9")} == {None}


def test_the_baud_parameter_counts_at_boot(nano: Make) -> None:
    rig = nano(eeprom=eeprom_image(baud=115_200), host_baud=115_200)
    rig.run(2.0)
    assert rig.nano.uart_stats().baud == pytest.approx(115_200, rel=0.03)
    ticks = [s["t_ck"] for s in rig.states()]
    assert len(ticks) >= 198
    assert rig.decoder.counters.gaps == 0


def test_a_new_board_makes_an_id_and_keeps_it(nano: Make) -> None:
    rig = nano(eeprom=b"\xff" * 1024)
    rig.run(1.5)
    hello = rig.hello()
    assert hello["board_id"] not in (0, 0xFFFFFFFF)
    assert hello["boot_count"] == 1
    assert any(n == "LOG" and b"new board" in bytes(v["text"], "ascii")
               if isinstance(v.get("text"), str) else n == "LOG" for _, n, v in rig.frames)
    rig.nano.reset("power")
    rig.frames.clear()
    rig.run(0.5)
    assert rig.hello()["board_id"] == hello["board_id"]
    assert rig.hello()["boot_count"] == 2
