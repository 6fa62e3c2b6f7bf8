"""A comparator without hysteresis on D2 or D3: up to a million edges a second.

INT0 goes before every other interrupt. Called back to back it would leave one instruction of
the program between two edges and nothing to slot, heartbeat counter and watchdog.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import pytest
from firmware_rig import FLAG, Rig, build_patched, eeprom_image

pytestmark = pytest.mark.emulator
Make = Callable[..., Rig]
NONE, ENABLE, MUX = range(3)
MODE_DISARMED = 0
MODE_ARMED = 1
BURST = 5
EIMSK = 0x3D
INT0 = 1
"""Register that masks the interrupts of the rings, and vector of the first of them."""
NO_WATCHDOG = ("src/main.cpp", "watchdog_start(settings.safety_out != 0,",
               "watchdog_start(false,")
NO_CATCH_UP = ("src/board/clock.h",
               "(soonest > ticks ? soonest : ticks)",
               "(soonest > ticks ? ticks : ticks)")
NO_BUDGET = ("src/board/edges.cpp", '"cbi  %[eimsk], %[own]        \\n\\t"',
             '"nop                          \\n\\t"')


def live(rig: Rig) -> Rig:
    rig.nano.set_ring(1, [(i + 0.5) / 10 for i in range(10)])
    rig.run(0.5)
    rig.beat(0.6, MODE_DISARMED)
    rig.beat(0.1, MODE_ARMED)
    assert rig.state()["flags"] & FLAG["OUTPUT_LIVE"]
    rig.nano.pin_log()
    return rig


def cut(rig: Rig, seconds: float = 0.3) -> float | None:
    """Seconds from now, the last beat, to the first fall of D6 or D5; None: it stays high."""
    begin = rig.now
    rig.run(seconds)
    falls = [e.t for e in rig.nano.pin_log() if e.pin in ("D5", "D6") and e.level == 0]
    return falls[0] - begin if falls else None


@pytest.mark.parametrize(("edge_min_us", "budget"), [(100, 77), (0, 255)])
@pytest.mark.parametrize("ring", [0, 1])
@pytest.mark.slow_except("*-100-77")
def test_the_first_phase_after_a_reset_has_its_budget_of_edges(nano: Make, ring: int,
                                                              edge_min_us: int,
                                                              budget: int) -> None:
    """A Nano that is reset in a chatter masks its interrupt after as many edges as later on."""
    rig = nano(eeprom=eeprom_image(ring_b=1, edge_min_us=edge_min_us))
    rig.nano.set_chatter(ring, 300e3)
    while not rig.nano.peek(EIMSK) >> ring & 1:
        rig.run(20e-6)
        assert rig.now < 0.1, "the ring is not counted"
    while rig.nano.peek(EIMSK) >> ring & 1:
        rig.run(20e-6)
        assert rig.now < 0.1, "it is never masked"
    assert rig.nano.isr(INT0 + ring).n == budget


@pytest.mark.parametrize("edge_min_us", [0, 100])
@pytest.mark.parametrize("rings", [(0,), (1,), (0, 1)])
@pytest.mark.parametrize("rate", [100e3, 260e3, 1e6])
@pytest.mark.slow
def test_the_link_and_the_cutoff_live_on(nano: Make, rate: float, rings: tuple[int, ...],
                                         edge_min_us: int) -> None:
    rig = live(nano(eeprom=eeprom_image(safety_out=ENABLE, ring_b=1, edge_min_us=edge_min_us)))
    for ring in rings:
        rig.nano.set_chatter(ring, rate, irregular=True)
    begin = rig.now
    rig.beat(0.5, MODE_ARMED)
    states = rig.states(begin)
    assert len(states) >= 48
    assert all(b["t_ck"] - a["t_ck"] < 26_000 for a, b in itertools.pairwise(states))
    assert all(s["flags"] & FLAG["OUTPUT_LIVE"] for s in states)  # beats are heard
    assert all(s["flags"] & FLAG["ENC_REJECT"] for s in states[2:])
    counts = [v["arg"] >> 16 for _, n, v in rig.frames if n == "EVENT" and v["code"] == BURST]
    assert counts[-1] == max(counts) == sum(1 << ring for ring in rings)
    after = cut(rig)
    assert after is not None
    assert 0.08 <= after <= 0.12
    for ring in rings:
        rig.nano.set_chatter(ring, 0)
    rig.run(0.1)  # and it counts again
    before = rig.state()
    edges = (rig.nano.edges(0), rig.nano.edges(1))
    rig.nano.set_wheel(20)
    rig.run(0.5)
    rig.nano.set_wheel(0)
    rig.run(0.05)
    after_ = rig.state()
    assert abs(after_["enc_count"] - before["enc_count"] - rig.nano.edges(0) + edges[0]) <= 1
    assert abs(after_["enc2_count"] - before["enc2_count"] - rig.nano.edges(1) + edges[1]) <= 1
    assert not after_["flags"] & FLAG["ENC_REJECT"]


def slots_in_a_burst(rig: Rig, lead_us: int) -> list[int]:
    """Times of the slots in a burst of edges that begins before the last phase of one of them."""
    # A STATE arrives 1.135 ms after its latch.
    latch = [t for t, name, _ in rig.frames if name == "STATE"][-1] - 1.135e-3
    deadline = latch + 0.0096
    while deadline - lead_us * 1e-6 < rig.now + 1e-3:
        deadline += 0.01
    rig.run(deadline - lead_us * 1e-6 - rig.now)
    begin = rig.now
    rig.nano.set_chatter(0, 300e3)
    rig.run(0.6e-3)
    rig.nano.set_chatter(0, 0)
    rig.beat(0.1, MODE_ARMED)
    return [state["t_ck"] for state in rig.states(begin - 0.03)]


@pytest.mark.slow
@pytest.mark.parametrize("lead_us", [100, 70, 50, 30, 0])
def test_a_burst_at_the_end_of_a_slot_delays_no_slot(nano: Make, lead_us: int) -> None:
    rig = live(nano(eeprom=eeprom_image(safety_out=ENABLE, ring_b=1)))
    times = slots_in_a_burst(rig, lead_us)
    assert max(b - a for a, b in itertools.pairwise(times)) < 23_000
    grid = [(t - times[-1]) / 20_000 for t in times[-6:]]
    assert all(abs(one - round(one)) < 0.01 for one in grid), "and the slots keep their times"


@pytest.mark.long
def test_a_match_that_has_passed_comes_with_the_next_turn_of_the_timer(nano: Make, elf: Path,
                                                                       tmp_path: Path) -> None:
    """The control: 33 ms later."""
    rig = live(nano(image=build_patched(tmp_path, NO_CATCH_UP),
                    eeprom=eeprom_image(safety_out=ENABLE, ring_b=1)))
    times = slots_in_a_burst(rig, 50)
    assert max(b - a for a, b in itertools.pairwise(times)) > 60_000


@pytest.mark.slow_except("0")
@pytest.mark.parametrize("ring", [0, 1])
def test_the_watchdog_fires_in_a_chatter(nano: Make, ring: int) -> None:
    rig = live(nano(eeprom=eeprom_image(safety_out=ENABLE, ring_b=1)))
    rig.nano.set_chatter(ring, 1e6)
    rig.run(0.01)
    rig.nano.hang()
    after = cut(rig)
    assert after is not None
    assert after <= 0.08


@pytest.mark.parametrize("edge_min_us", [0, 100])
@pytest.mark.slow
def test_our_pulse_keeps_its_width_in_a_chatter(nano: Make, edge_min_us: int) -> None:
    rig = nano(eeprom=eeprom_image(safety_out=MUX, ring_b=1, edge_min_us=edge_min_us))
    rig.run(0.5)
    for ring in (0, 1):
        rig.nano.set_chatter(ring, 1e6)
    rig.run(0.1)
    rig.nano.pin_log()
    rig.run(1.0)
    edges = [(e.t, e.level) for e in rig.nano.pin_log() if e.pin == "D9"]
    widths = [b[0] - a[0] for a, b in itertools.pairwise(edges) if a[1]]
    assert len(widths) >= 47
    assert all(w == pytest.approx(1.5e-3, abs=1e-6) for w in widths)


@pytest.mark.slow
def test_what_the_design_allows_is_never_masked(nano: Make) -> None:
    """5000 edges/s on both rings, and close to what the rule accepts, 8000 on one."""
    rig = live(nano(eeprom=eeprom_image(ring_b=1)))
    rig.nano.set_ring(1, [(i + 0.3) / 20 for i in range(20)])
    rig.run(0.1)
    rig.nano.set_wheel(250)
    rig.run(1.0)
    rig.nano.set_ring(1, [0.1, 0.6])
    rig.nano.set_wheel(400)
    rig.run(1.0)
    assert not [v for _, n, v in rig.frames if n == "EVENT" and v["code"] == BURST]
    assert not any(s["flags"] & FLAG["ENC_REJECT"] for s in rig.states())


@pytest.mark.long
def test_without_the_budget_the_link_dies_and_only_the_watchdog_is_left(
        nano: Make, elf: Path, tmp_path: Path) -> None:
    """The control: no STATE, no cut by the interrupt; the reset of the watchdog lets go of D6."""
    for name, changes, cuts in (("watchdog", (NO_BUDGET,), True),
                                ("nothing", (NO_BUDGET, NO_WATCHDOG), False)):
        rig = live(nano(build_patched(tmp_path / name, *changes),
                        eeprom=eeprom_image(safety_out=ENABLE)))
        rig.nano.set_chatter(0, 1e6)
        begin = rig.now
        assert (cut(rig) is not None) is cuts, name
        assert len(rig.states(begin)) < 10, name  # of 30
