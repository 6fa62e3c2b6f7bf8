"""BNO055 machine: start, samples, recovery; it recovers from anything the part does."""

from __future__ import annotations

import ctypes as c

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from imu_model import (
    AFTER_RESET,
    BACKOFF,
    GYR,
    LEG_LIMIT,
    LIA,
    MODE,
    MS,
    OFFSETS,
    POWER_OFF,
    PROBE,
    RESET,
    RESET_WAIT,
    RUN,
    SAVE,
    SCRIPT_LEG_LIMIT,
    SETUP,
    SYS_STATUS,
    TRIGGER,
    UNIT,
    Part,
)

SLOT_TICKS = MS // 2  # resolution of the model's wakes


@pytest.fixture(autouse=True)
def _no_offsets(core: c.CDLL) -> None:
    core.eeprom_cells().contents[:] = b"\xff" * 1024
    core.eeprom_set(-1, 0)


def running(core: c.CDLL, **options: int) -> Part:
    part = Part(core, **options)
    part.until(RUN, 1000)
    part.slots(2)
    return part


def test_start_up_takes_what_the_part_takes(core: c.CDLL) -> None:
    part = Part(core)
    assert part.until(SETUP, 500) >= 400
    assert part.until(RUN, 200) <= 150
    view = part.slots(2)
    assert view.valid
    assert view.nack == view.timeout == view.reinit == 0
    assert part.log.index(("w", UNIT, 2)) < part.log.index(("w", MODE, 8))


def test_reserved_bits_of_the_mode_may_read_as_the_part_likes(core: c.CDLL) -> None:
    """The data sheet states 0x1C after a reset, and the bits 7 to 4 as reserved."""
    part = Part(core)
    part.reserved_mode = 0x10
    part.until(RUN, 1000)
    view = part.slots(200)
    assert view.valid
    assert view.reinit == 0


@pytest.mark.parametrize(("byte_us", "runs"), [(200, True), (270, True), (400, False)])
def test_offsets_are_restored_over_the_slowest_bus_that_may_be_set(core: c.CDLL, byte_us: int,
                                                                   runs: bool) -> None:
    """100 kHz and 180 us of stretching are 270 us a byte; the control is a bus that hangs."""
    learnt = running(core)
    learnt.reg[OFFSETS:OFFSETS + 22] = bytes(range(1, 23))
    learnt.quiet = True
    learnt.slots(60, moving=False)
    learnt.until(RUN, 200)
    while core.imu_store_step():
        pass
    part = Part(core, stretch=byte_us * MS // 1000)
    part.slots(150)
    assert (part.view().timeout == 0) == runs
    assert (bytes(part.reg[OFFSETS:OFFSETS + 22]) == bytes(range(1, 23))) == runs


def test_the_other_address_is_found(core: c.CDLL) -> None:
    assert running(core, address=0x29).view().valid


def test_samples_are_those_of_the_part(core: c.CDLL) -> None:
    part = running(core)
    for _ in range(50):
        view = part.slots(1)
        assert view.valid
        assert view.acc == tuple(part.level + 10 * i for i in range(3))
        assert view.gyro == view.acc
        assert part.now - view.start == 10 * MS - 7 * MS // 2


def test_the_short_plan_reads_its_registers(core: c.CDLL) -> None:
    view = running(core, plan=1).slots(1)
    assert view.acc[2] == view.gyro[0] == view.gyro[1] == 0
    assert view.acc[1] == view.acc[0] + 10
    assert view.gyro[2] == view.acc[0] + 20


@pytest.mark.parametrize(("updates_ms", "changed"), [
    ((0,), 1), ((3,), 2), ((9.5,), 1), ((0, 3), 3), ((), 0)])
def test_a_look_shows_when_the_data_changed(core: c.CDLL, updates_ms: tuple[float, ...],
                                            changed: int) -> None:
    """The look is over at 2.5 ms, the gyro's bytes of a read are taken at 7.5 ms."""
    part = running(core)
    part.updates = tuple(round(ms * MS) for ms in updates_ms)
    part.slots(1)
    view = part.slots(1)
    assert view.valid
    assert view.changed == changed


@pytest.mark.parametrize(("options", "looks"), [
    ({}, True), ({"plan": 1}, False), ({"stretch": 600}, False)], ids=["ours", "short", "slow"])
def test_a_look_has_its_time(core: c.CDLL, options: dict[str, int], looks: bool) -> None:
    """A part of 300 us a byte is read for 6 ms: a look would be in the way."""
    part = running(core, **options)
    part.reads.clear()
    view = part.slots(10)
    per_slot = len([reg for reg in part.reads if reg == GYR]) / 10
    assert view.valid
    assert per_slot == (2 if looks else 0 if "plan" in options else 1)
    assert bool(view.changed) == looks


def test_a_look_that_hangs_costs_no_read(core: c.CDLL) -> None:
    part = running(core)
    start = part.now
    part.core.imu_look(part._u32())
    part.hangs = True
    for _ in range(6):
        part.now += SLOT_TICKS
        part.core.imu_step(part._u32())
    assert part.view().resting
    part.core.imu_slot(part._u32(), part.edges, 0)
    assert not part.view().resting
    for _ in range(10):
        part.now += SLOT_TICKS
        part.core.imu_step(part._u32())
    assert part.view().valid
    assert part.view().start == start + 3 * MS
    assert part.view().changed == 0


def test_one_refused_read_clears_valid_and_keeps_the_sample(core: c.CDLL) -> None:
    part = running(core)
    before = part.view()
    part.fault = "nack"
    after = part.slots(1)
    assert not after.valid
    assert after.has_sample
    assert after.acc == before.acc
    assert after.start == before.start
    assert after.nack == before.nack + 1
    part.fault = "ok"
    assert part.slots(1).valid
    assert part.view().state == RUN


def test_the_sample_expires_before_its_age_does(core: c.CDLL) -> None:
    part = running(core)
    part.fault = "hang"
    part.deaf_to_power = True
    assert part.slots(25).has_sample
    assert not part.slots(4).has_sample


def test_sda_low_is_cleared_within_a_slot(core: c.CDLL) -> None:
    part = running(core)
    part.fault = "sda"
    part.slots(1)
    assert part.fault == "ok"
    assert part.clears == 1
    assert part.slots(1).valid
    assert part.view().state == RUN


def test_ten_failures_reset_the_part(core: c.CDLL) -> None:
    part = running(core)
    part.fault = "nack"
    part.slots(9)
    assert part.view().state == RUN
    part.fault = "ok"
    part.slots(1)
    assert part.view().valid  # the tenth was good
    part.fault = "nack"
    part.slots(10)
    part.fault = "ok"
    assert part.until(RESET_WAIT, 30) >= 0
    assert ("w", TRIGGER, 0x20) in part.log
    assert part.until(RUN, 1000) <= 900


def test_a_refused_reset_switches_the_supply(core: c.CDLL) -> None:
    part = running(core)
    part.fault = "scl"
    assert part.until(POWER_OFF, 130) >= 100
    assert not part.powered
    assert part.until(RUN, 1300) <= 1200


def test_a_reset_that_does_not_help_switches_the_supply(core: c.CDLL) -> None:
    part = running(core)
    part.reg[SYS_STATUS] = 1
    real = part.sample

    def broken() -> None:
        real()
        if not part.reg[MODE]:
            part.ready_at = part.now + 10_000 * MS  # never wakes from its reset
        part.reg[SYS_STATUS] = 1

    part.sample = broken  # type: ignore[method-assign]
    part.until(AFTER_RESET, 1900)
    part.until(POWER_OFF, 300)
    part.sample = real  # type: ignore[method-assign]
    part.until(SETUP, 1300)
    part.fault = "nack"
    while part.view().state == SETUP:
        part.slots(1)
    assert part.view().state == RESET, "with its supply back, a reset may help again"
    part.fault = "ok"
    part.until(RUN, 1300)


def test_a_brown_out_is_detected_and_set_up_again(core: c.CDLL) -> None:
    part = running(core)
    part.boot(0)  # registers lost, answers at once
    assert part.until(SETUP, 600) <= 20, "zeros have the mode read at once"
    part.until(RUN, 150)
    assert part.reg[MODE] == 8
    assert part.reg[UNIT] == 2


def test_no_sample_of_zeros_is_ever_valid(core: c.CDLL) -> None:
    """A fall to CONFIG in each phase of the poll: found, set up, and no zero given out."""
    for wait in range(0, 110, 7):
        part = running(core)
        part.slots(wait)
        part.boot(0)
        began = part.now
        while part.now - began < 300 * MS:
            view = part.slots(1)
            assert not view.valid or any(view.acc + view.gyro)
        assert view.valid
        assert view.state == RUN


def test_a_part_at_rest_may_read_zeros(core: c.CDLL) -> None:
    """One sample of zeros is no fault; the one before it stays. Two are no data."""
    part = running(core)
    before = part.view()
    resets = part.view().reinit
    part.frozen = True
    for base in (LIA, GYR):
        part.reg[base:base + 6] = bytes(6)
    one = part.slots(1)
    assert (one.valid, one.acc, one.gyro) == (1, before.acc, before.gyro)
    two = part.slots(1)
    assert (two.valid, two.state, two.reinit) == (0, RUN, resets)
    part.frozen = False
    assert part.slots(1).valid


def test_absence_is_reported_within_6_s_and_never_final(core: c.CDLL) -> None:
    part = Part(core)
    part.deaf_to_power = True
    part.fault = "nack"
    assert not part.slots(100).absent
    assert part.until(BACKOFF, 4000) <= 4000
    assert part.view().absent
    assert not part.view().valid
    part.deaf_to_power = False
    part.fault = "ok"
    part.until(RUN, 5000 + 1500)
    assert not part.slots(2).absent


def test_stuck_needs_a_turning_wheel_and_200_ms(core: c.CDLL) -> None:
    part = running(core)
    part.frozen = True
    assert not part.slots(100, moving=False).stuck
    part.frozen = False
    part.slots(1)
    part.frozen = True
    assert not part.slots(18).stuck  # 19 equal samples with the last moving one
    view = part.slots(1)
    assert view.stuck
    assert not view.valid
    part.frozen = False
    assert part.slots(2).valid


def test_stretching_past_the_deadline_is_a_timeout_not_a_hang(core: c.CDLL) -> None:
    part = running(core)
    part.stretch = 3000  # 1.5 ms per byte
    view = part.slots(3)
    assert view.timeout >= 2
    assert part.max_leg <= LEG_LIMIT + SLOT_TICKS


def test_offsets_are_learnt_once_and_restored(core: c.CDLL) -> None:
    part = running(core)
    part.reg[OFFSETS:OFFSETS + 22] = bytes(range(1, 23))
    part.quiet = True
    part.slots(60, moving=False)  # CALIB_STAT has been read by now
    part.until(RUN, 200)
    while core.imu_store_step():
        pass
    assert ("w", MODE, 0) in part.log[3:]
    modes = [v for k, r, v in part.log if (k, r) == ("w", MODE)]
    part.slots(500, moving=False)
    assert [v for k, r, v in part.log if (k, r) == ("w", MODE)] == modes  # once per boot
    again = running(core)
    assert not again.view().factory
    assert bytes(again.reg[OFFSETS:OFFSETS + 22]) == bytes(range(1, 23))


@pytest.mark.parametrize("why", ["moving", "uncalibrated"])
def test_offsets_are_not_touched(core: c.CDLL, why: str) -> None:
    part = Part(core)
    part.calib = 0x2C if why == "uncalibrated" else 0xFF
    part.until(RUN, 1000)
    part.quiet = why == "uncalibrated"
    for _ in range(200):
        assert part.slots(1).state != SAVE


def test_a_part_that_refuses_our_offsets_runs_on_its_own(core: c.CDLL) -> None:
    test_offsets_are_learnt_once_and_restored(core)
    part = Part(core)
    part.offsets_stick = False
    part.until(RUN, 3000)
    assert part.view().factory
    assert part.slots(2).valid


EVENTS = st.sampled_from(["nack", "hang", "sda", "scl", "reset", "brownout", "garbage", "slow"])


@pytest.mark.slow
@example(faults=[("nack", 1, 45), ("brownout", 1, 0)], start=0)
@given(st.lists(st.tuples(EVENTS, st.integers(1, 40), st.integers(0, 120)), max_size=6),
       st.integers(0, 2**32 - 1))
def test_it_always_comes_back_and_never_blocks(
        core: c.CDLL, faults: list[tuple[str, int, int]], start: int) -> None:
    part = Part(core, start=start)
    for kind, slots, after in faults:
        if kind in ("nack", "hang", "sda", "scl"):
            part.fault = kind
        elif kind == "reset":
            part.boot(650 * MS)
        elif kind == "brownout":
            part.boot(0)
        elif kind == "garbage":
            part.reg[0] = 0x55
        else:
            part.stretch = 4000
        part.slots(slots)
        part.fault = "ok"
        part.stretch = 360
        part.reg[0] = 0xA0
        part.slots(after)
    part.slots(125)  # with registers that froze CONFIG is found by the 1 s poll, not before
    for _ in range(850):  # a back-off of 5 s and a start
        view = part.slots(1)
        if view.valid:
            break
    assert view.valid
    assert view.state == RUN
    assert view.acc[0] == part.level
    assert part.max_leg <= SCRIPT_LEG_LIMIT + SLOT_TICKS


def test_negative_control_a_dead_part_is_never_valid(core: c.CDLL) -> None:
    part = Part(core)
    part.fault = "hang"
    part.deaf_to_power = True
    assert all(not part.slots(10).valid for _ in range(60))
    assert part.view().state in (PROBE, POWER_OFF, BACKOFF)
