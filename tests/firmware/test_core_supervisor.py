"""Supervisor of the Nano: one test per transition and per blocked transition."""

from __future__ import annotations

import ctypes as c
from typing import NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

BOOT, IDLE, LINKED, IS_LIVE, TRIPPED, LOCKED = range(6)
IS_DISARMED, IS_ARMED, IS_RAW, IS_STOPPED = range(4)
TICKS_PER_MS = 2000
MAX_BEAT_MS = 110


class SupervisorView(NamedTuple):
    state: int
    enable: int
    bypass: int  # the ESC gets the PCA9685's pulse
    own: int
    beat_ok: int
    age: int
    conditions: int


class Sut:
    """A supervisor and its clock [ms]; a beat each 20 ms unless stated."""

    def __init__(self, core: c.CDLL, now: float = 0.0) -> None:
        self.core = core
        self.now = now
        core.supervisor_new(c.c_uint32(MAX_BEAT_MS * TICKS_PER_MS))

    @property
    def ticks(self) -> c.c_uint32:
        return c.c_uint32(int(self.now * TICKS_PER_MS) & 0xFFFFFFFF)

    def view(self) -> SupervisorView:
        out = (c.c_uint8 * 7)()
        self.core.supervisor_get(self.ticks, out)
        return SupervisorView(*out)

    @property
    def state(self) -> int:
        return self.view().state

    def step(self) -> int:
        while self.core.supervisor_step(self.ticks):
            pass
        return self.state

    def wait(self, ms: float) -> int:
        for _ in range(int(ms)):
            self.now += 1
            self.step()
        return self.state

    def ready(self) -> Sut:
        self.core.supervisor_ready()
        self.step()
        return self

    def beat(self, mode: int = IS_DISARMED, token: bool = True) -> int:
        self.step()
        self.core.supervisor_beat(self.ticks, mode, int(token))
        return self.step()

    def beats(self, ms: float, mode: int = IS_DISARMED, token: bool = True, gap: int = 20) -> int:
        for _ in range(int(ms / gap)):
            self.wait(gap)
            self.beat(mode, token)
        return self.state

    def link_up(self) -> Sut:
        self.ready().beats(600)
        assert self.state == LINKED
        return self

    def live(self) -> Sut:
        self.link_up().beats(20, IS_ARMED)
        assert self.state == IS_LIVE
        return self


@pytest.fixture
def sut(core: c.CDLL) -> Sut:
    return Sut(core)


OUTPUTS = {BOOT: (0, 0, 0), IDLE: (0, 0, 1), LINKED: (1, 0, 1), IS_LIVE: (1, 1, 1),
           TRIPPED: (0, 0, 1), LOCKED: (0, 0, 1)}


def outputs(view: SupervisorView) -> tuple[int, int, int]:
    return view.enable, view.bypass, view.own


# --- each transition ---------------------------------------------------------

def test_boot_to_idle_when_ready(sut: Sut) -> None:
    assert sut.step() == BOOT
    assert outputs(sut.view()) == OUTPUTS[BOOT]
    assert sut.ready().state == IDLE
    assert outputs(sut.view()) == OUTPUTS[IDLE]


def test_idle_to_linked_after_500_ms_of_beats(sut: Sut) -> None:
    sut.ready()
    assert sut.beats(500) == IDLE  # the first of 25 beats starts the run: 480 ms
    assert sut.beats(20) == LINKED
    assert outputs(sut.view()) == OUTPUTS[LINKED]


@pytest.mark.parametrize("mode", [IS_ARMED, IS_RAW])
def test_linked_to_live_on_armed_or_raw(sut: Sut, mode: int) -> None:
    assert sut.link_up().beats(20, mode) == IS_LIVE
    assert outputs(sut.view()) == OUTPUTS[IS_LIVE]


def test_linked_to_idle_without_a_beat(sut: Sut) -> None:
    assert sut.link_up().wait(MAX_BEAT_MS) == LINKED
    assert sut.wait(1) == IDLE


def test_linked_to_idle_on_stop(sut: Sut) -> None:
    assert sut.link_up().beats(20, IS_STOPPED) == IDLE


def test_live_to_linked_on_disarmed(sut: Sut) -> None:
    assert sut.live().beats(20, IS_DISARMED) == LINKED


def test_live_to_tripped_without_a_beat(sut: Sut) -> None:
    assert sut.live().wait(MAX_BEAT_MS) == IS_LIVE
    assert sut.wait(1) == TRIPPED
    assert outputs(sut.view()) == OUTPUTS[TRIPPED]


def test_live_to_tripped_if_the_outputs_were_cut_before_a_beat_in_time_was_read(sut: Sut) -> None:
    """Else the Nano would report LIVE while the ESC has the Nano's own neutral."""
    sut.live().wait(MAX_BEAT_MS - 1)
    assert sut.state == IS_LIVE
    sut.core.supervisor_lose()
    assert sut.step() == TRIPPED
    assert sut.beats(20, IS_ARMED) == TRIPPED


def test_live_to_tripped_on_stop(sut: Sut) -> None:
    assert sut.live().beats(20, IS_STOPPED) == TRIPPED


def test_tripped_to_linked_after_500_ms_disarmed(sut: Sut) -> None:
    sut.live().wait(200)
    assert sut.beats(500) == TRIPPED
    assert sut.beats(40) == LINKED


def test_third_trip_within_60_s_locks(sut: Sut) -> None:
    sut.link_up()
    for trip in range(3):
        assert sut.beats(20, IS_ARMED) == IS_LIVE, trip
        sut.wait(200)
        if trip < 2:
            assert sut.beats(600) == LINKED
    assert sut.state == LOCKED
    assert outputs(sut.view()) == OUTPUTS[LOCKED]


@pytest.mark.slow
def test_three_trips_in_more_than_60_s_do_not_lock(sut: Sut) -> None:
    sut.link_up()
    for _ in range(4):
        assert sut.beats(20, IS_ARMED) == IS_LIVE
        assert sut.wait(200) == TRIPPED
        assert sut.beats(600) == LINKED
        sut.beats(30_000, gap=20)


@pytest.mark.slow
def test_an_old_trip_is_forgotten_and_the_newer_ones_are_not(sut: Sut) -> None:
    sut.link_up()
    for calm in (50_000, 15_000, 5_000):
        assert sut.beats(20, IS_ARMED) == IS_LIVE
        assert sut.wait(200) == TRIPPED
        assert sut.beats(calm) == LINKED
    assert sut.beats(20, IS_ARMED) == IS_LIVE
    assert sut.wait(200) == LOCKED  # the third since 50 s, the first of all being 71 s old


# --- each blocked transition -------------------------------------------------

def test_boot_is_not_left_before_ready(sut: Sut) -> None:
    assert sut.beats(2000, IS_ARMED) == BOOT


@pytest.mark.parametrize(("mode", "token"),
                         [(IS_STOPPED, True), (IS_DISARMED, False), (IS_ARMED, False)])
def test_idle_is_not_left_by_stop_or_a_wrong_token(sut: Sut, mode: int, token: bool) -> None:
    sut.ready()
    assert sut.beats(2000, mode, token) == IDLE
    assert sut.view().beat_ok  # the link is alive all the same


def test_idle_is_not_left_with_gaps_above_60_ms(sut: Sut) -> None:
    assert sut.ready().beats(3000, gap=61) == IDLE
    assert sut.beats(3000, gap=60) == LINKED  # the limit itself is good


def test_linked_does_not_arm_with_a_wrong_token(sut: Sut) -> None:
    assert sut.link_up().beats(500, IS_ARMED, token=False) == LINKED


def test_a_wrong_token_takes_the_throttle_away(sut: Sut) -> None:
    assert sut.live().beats(20, IS_ARMED, token=False) == LINKED


def test_tripped_is_not_left_by_armed_beats(sut: Sut) -> None:
    sut.live().wait(200)
    assert sut.beats(3000, IS_ARMED) == TRIPPED
    assert sut.beats(3000, IS_RAW) == TRIPPED


@pytest.mark.parametrize(("mode", "token"), [(IS_STOPPED, True), (IS_DISARMED, False)])
def test_tripped_is_not_left_by_stop_or_a_wrong_token(sut: Sut, mode: int, token: bool) -> None:
    sut.live().wait(200)
    assert sut.beats(3000, mode, token) == TRIPPED


def test_tripped_needs_500_ms_after_the_trip(sut: Sut) -> None:
    sut.live().beats(20, IS_STOPPED)
    assert sut.beats(480) == TRIPPED


@pytest.mark.slow
def test_locked_is_left_by_nothing(sut: Sut) -> None:
    test_third_trip_within_60_s_locks(sut)
    for mode in (IS_DISARMED, IS_ARMED, IS_RAW, IS_STOPPED):
        assert sut.beats(1000, mode) == LOCKED
    assert sut.beats(70_000) == LOCKED


def test_a_late_beat_does_not_hide_the_gap(sut: Sut) -> None:
    sut.live()
    sut.now += 115  # the loop was elsewhere, then a beat comes
    sut.core.supervisor_beat(sut.ticks, IS_ARMED, 1)
    assert sut.step() == TRIPPED


def test_a_beat_that_came_before_the_look_that_tripped_does_not_erase_the_trip(sut: Sut) -> None:
    """Beats are stamped when they arrive, looks when the loop gets there."""
    sut.link_up()
    for trip in range(3):
        assert sut.beats(20, IS_ARMED) == IS_LIVE, trip
        sut.now += MAX_BEAT_MS + 1
        assert sut.step() in (TRIPPED, LOCKED)
        looked = sut.now
        sut.now = sut.now - 5
        sut.beat(IS_ARMED)
        sut.now = looked
        if trip < 2:
            assert sut.beats(600) == LINKED
    assert sut.state == LOCKED


# --- laws --------------------------------------------------------------------

@given(st.lists(st.tuples(st.integers(1, 200),
                          st.sampled_from([IS_DISARMED, IS_ARMED, IS_RAW, IS_STOPPED]),
                          st.booleans()), max_size=120),
       st.integers(0, 2_147_483))
def test_live_only_with_fresh_armed_beats_of_this_boot(
        core: c.CDLL, beats: list[tuple[int, int, bool]], start: int) -> None:
    sut = Sut(core, start).ready()
    for gap, mode, token in beats:
        sut.wait(gap)
        if sut.state == IS_LIVE:
            assert gap <= MAX_BEAT_MS
        sut.beat(mode, token)
        if sut.state == IS_LIVE:
            assert mode in (IS_ARMED, IS_RAW)
            assert token
        assert outputs(sut.view()) == OUTPUTS[sut.state]


@pytest.mark.parametrize("start", [2_147_483.5, 2_147_483 - 700, 4_294_967])
def test_the_wrap_of_the_clock_changes_nothing(core: c.CDLL, start: float) -> None:
    sut = Sut(core, start).live()
    assert sut.beats(3000, IS_ARMED) == IS_LIVE
    assert sut.wait(MAX_BEAT_MS + 1) == TRIPPED


def test_silence_for_longer_than_the_clock_wraps(core: c.CDLL) -> None:
    """2^32 ticks of 0.5 us after the last beat its stamp is new again: look each ms there."""
    sut = Sut(core).link_up()
    for _ in range(2147):
        sut.now += 1000
        sut.step()
        assert sut.view()[4:6] == (0, 255)
    for _ in range(1000):
        sut.wait(1)
        assert sut.view()[4:6] == (0, 255)
    assert sut.state == IDLE


@given(st.integers(0, 400_000))
def test_beat_age_in_ms_saturates(core: c.CDLL, us: int) -> None:
    sut = Sut(core).ready()
    assert sut.view().age == 255  # none yet
    sut.beat()
    sut.now = us / 1000
    assert sut.view().age == min(us // 1000, 255)
