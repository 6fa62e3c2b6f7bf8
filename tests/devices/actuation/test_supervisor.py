"""The supervisor's table, one law or row of the safety document per test."""

from __future__ import annotations

import copy
from dataclasses import replace

import pytest

from dart_hal.core.errors import NotArmed
from dart_hal.core.timing import PWM_FRAME
from dart_hal.devices.actuation import ArmState, Event, Facts, Supervisor, list_cautions, refusals
from dart_hal.devices.actuation.arming import BY_NAME, REFUSALS, WAIVABLE
from dart_hal.devices.actuation.guard import GuardLogic
from dart_hal.devices.actuation.pca9685 import NEUTRAL_FRAMES
from dart_hal.devices.actuation.states import ENTRY, GRID, TABLE, check_table, read_grid

SLOT = 0.01


def supervisor_in(state: ArmState) -> tuple[Supervisor, float]:
    """A supervisor in ``state``, and the time."""
    s, t = Supervisor(), 0.0
    if state is ArmState.CLOSED:
        return s, t
    s.event(Event.OPEN, t)
    if state is ArmState.OPENING:
        return s, t
    s.event(Event.OPENED, t)
    if state is ArmState.RAW:
        s.event(Event.RAW_OPEN, t)
    elif state is ArmState.FAULT:
        s.event(Event.BUS_LOST, t)
    elif state is not ArmState.DISARMED:
        s.arm(t)
        if state is ArmState.ARMING:
            return s, t
        t = run(s, t, 3.0)
        for _ in range({ArmState.ARMED: 0, ArmState.TRIPPED: 1, ArmState.LOCKED: 3}[state]):
            if s.state is not ArmState.ARMED:
                t = run(s, t, 0.6)
                s.arm(t)
                t = run(s, t, 2.1)
            s.event(Event.TRIP, t, ("LINK_STALE",))
    assert s.state is state
    return s, t


def run(s: Supervisor, t: float, seconds: float, **inputs: object) -> float:
    for _ in range(round(seconds / SLOT)):
        t += SLOT
        s.step(t, **inputs)
    return t


@pytest.mark.parametrize("state", list(ArmState))
@pytest.mark.parametrize("event", list(Event))
def test_every_event_in_every_state_follows_the_table(state, event) -> None:
    s, t = supervisor_in(state)
    s.event(event, t)
    assert s.state is TABLE[state][event]


def test_the_throttle_obeys_in_armed_and_raw_alone() -> None:
    obeys = {s for s in ArmState if ENTRY[s].output.throttle not in ("neutral", "untouched")}
    assert obeys == {ArmState.ARMED, ArmState.RAW}


@pytest.mark.parametrize("broken", [
    GRID.replace("BUS_BACK", "BUS_LOST"),
    "\n".join(line for line in GRID.splitlines() if not line.startswith("TRIP ")),
    GRID.replace("CHECKED       .", "CHECKED"),
])
def test_a_grid_with_a_hole_is_not_accepted(broken: str) -> None:
    with pytest.raises(AssertionError):
        read_grid(broken)


@pytest.mark.parametrize(("state", "event"), [
    (ArmState.TRIPPED, Event.CLEARED), (ArmState.DISARMED, Event.ARM),
    (ArmState.LOCKED, Event.UNLOCK)])
def test_a_shortcut_into_armed_is_not_accepted(state, event) -> None:
    table = copy.deepcopy(TABLE)
    table[state][event] = ArmState.ARMED
    with pytest.raises(AssertionError):
        check_table(table)


def test_arming_takes_two_seconds_of_neutral_and_half_a_second_of_good_checks() -> None:
    s, t = supervisor_in(ArmState.ARMING)
    t = run(s, t, 1.98)
    assert s.state is ArmState.ARMING
    t = run(s, t, 0.03)
    assert s.state is ArmState.ARMED
    s, t = supervisor_in(ArmState.ARMING)
    t = run(s, t, 1.8)
    s.step(t, refused=("LINK_NOT_GOOD_500MS",))
    t = run(s, t, 0.48)
    assert s.state is ArmState.ARMING
    run(s, t, 0.05)
    assert s.state is ArmState.ARMED


def test_a_refusal_while_arming_disarms_with_the_list() -> None:
    s, t = supervisor_in(ArmState.ARMING)
    s.step(t + SLOT, refused=("RUN_STOP", "IMU_STALE", "NEUTRAL_TOO_SHORT"))
    assert s.state is ArmState.DISARMED
    assert set(s.reasons) == {"RUN_STOP", "IMU_STALE"}


def test_what_waiting_does_not_cure_ends_arming_in_bounded_time() -> None:
    s, t = supervisor_in(ArmState.ARMING)
    run(s, t, 4.1, refused=("CLOCK_NOT_SYNCED",))
    assert s.state is ArmState.DISARMED
    assert s.reasons == ("CLOCK_NOT_SYNCED",)


@pytest.mark.parametrize("state", [ArmState.CLOSED, ArmState.OPENING, ArmState.FAULT, ArmState.RAW,
                                   ArmState.TRIPPED, ArmState.LOCKED])
def test_arm_is_refused_by_name_where_it_cannot_lead_to_armed(state: ArmState) -> None:
    s, t = supervisor_in(state)
    with pytest.raises(NotArmed) as caught:
        s.arm(t)
    assert caught.value.reasons
    assert s.state is state


def test_a_trip_clears_half_a_second_after_its_cause_and_never_rearms() -> None:
    s, t = supervisor_in(ArmState.ARMED)
    t = run(s, t, 0.3, causes=("LINK_STALE",))
    assert s.state is ArmState.TRIPPED
    assert s.output.why == ("STALE_LINK", "NOT_ARMED")
    t = run(s, t, 0.48)
    assert s.state is ArmState.TRIPPED
    t = run(s, t, 0.05)
    assert s.state is ArmState.DISARMED
    run(s, t, 10.0)
    assert s.state is ArmState.DISARMED


def test_three_trips_in_a_minute_lock_and_only_unlock_opens() -> None:
    s, t = supervisor_in(ArmState.LOCKED)
    assert (s.output.steering, s.beat) == ("held", "STOP")
    t = run(s, t, 70.0)
    assert s.state is ArmState.LOCKED
    assert s.output.steering == "centre"
    s.event(Event.UNLOCK, t, ("checked",))
    assert s.state is ArmState.DISARMED
    s.arm(t)
    t = run(s, t, 0.6)
    s.event(Event.TRIP, t)
    assert s.state is ArmState.TRIPPED, "unlock restarts the count"


@pytest.mark.parametrize(("interval", "locks"), [(10.0, True), (29.0, True), (30.5, False)])
def test_the_third_trip_locks_however_calm_it_was_in_between_a_minute(interval, locks) -> None:
    s, t = supervisor_in(ArmState.ARMED)
    s.event(Event.TRIP, t, ("LINK_STALE",))
    for _ in range(2):
        t = run(s, t, interval - 0.6)
        s.arm(t)
        t = run(s, t, 0.6)
        assert s.state is ArmState.ARMED
        s.event(Event.TRIP, t, ("LINK_STALE",))
    assert s.state is (ArmState.LOCKED if locks else ArmState.TRIPPED)


def test_three_trips_in_more_than_a_minute_do_not_lock() -> None:
    s, t = supervisor_in(ArmState.ARMED)
    for _ in range(4):
        s.event(Event.TRIP, t, ("LINK_STALE",))
        assert s.state is ArmState.TRIPPED
        t = run(s, t, 30.5)
        s.arm(t)
        t = run(s, t, 0.6)
        assert s.state is ArmState.ARMED


def test_raw_ends_ten_seconds_after_the_last_call_or_at_a_trip() -> None:
    s, t = supervisor_in(ArmState.RAW)
    t = run(s, t, 9.0)
    s.note_raw_call(t)
    t = run(s, t, 9.9)
    assert s.state is ArmState.RAW
    run(s, t, 0.2)
    assert s.state is ArmState.DISARMED
    s, t = supervisor_in(ArmState.RAW)
    s.step(t + SLOT, causes=("LINK_STALE",))
    assert s.state is ArmState.DISARMED


def test_a_lost_bus_is_a_fault_that_leads_back_to_disarmed() -> None:
    s, t = supervisor_in(ArmState.ARMED)
    t = run(s, t, 0.1, bus_ok=False, causes=("PCA_WRITE_FAILED",))
    assert (s.state, s.beat) == (ArmState.FAULT, "STOP")
    s.step(t + SLOT, bus_ok=True)
    assert s.state is ArmState.DISARMED


def test_a_lasting_fault_ends_the_pulses_when_the_guard_does() -> None:
    """Driver and guard write the same pin by turns; one at neutral and one at none alternate."""
    s, t = supervisor_in(ArmState.ARMED)
    guard = GuardLogic()
    guard.note_bytes(b"b", t)
    guard_writes = 0
    fault_at = t + PWM_FRAME
    while guard_writes < 2 * NEUTRAL_FRAMES:
        t += PWM_FRAME
        s.step(t, bus_ok=False, causes=("PCA_WRITE_FAILED",))
        if guard.due(t):
            off = s.output.throttle == "off"
            assert off == guard.switches_off, f"{t - fault_at:.2f} s after the fault"
            guard.note_write(True)
            guard_writes += 1
    assert guard.switches_off
    s.step(t + SLOT, bus_ok=True)
    assert (s.state, s.output.throttle) == (ArmState.DISARMED, "neutral")


def test_a_reboot_of_the_nano_disarms() -> None:
    s, t = supervisor_in(ArmState.ARMED)
    s.event(Event.REBOOT, t)
    assert s.state is ArmState.DISARMED


def test_following_while_disarmed_is_a_car_parameter() -> None:
    s = Supervisor(follow_disarmed=True)
    s.event(Event.OPEN, 0.0)
    s.event(Event.OPENED, 0.0)
    assert (s.output.throttle, s.output.steering) == ("neutral", "command")


BAD_FACTS = {
    "NO_HELLO": {"hello": False}, "SCHEMA_MISMATCH": {"schema_ok": False},
    "PROTOCOL_TOO_OLD": {"protocol_ok": False}, "LINK_NOT_GOOD_500MS": {"link_good_for": 0.4},
    "FRAME_LOSS": {"frame_loss": 0.03}, "CLOCK_NOT_SYNCED": {"clock_synced": False},
    "MCU_REBOOTED": {"rebooted": True}, "IMU_ABSENT": {"imu_absent": True},
    "IMU_STALE": {"imu_stale": True}, "IMU_STUCK": {"imu_stuck": True},
    "IMU_DOUBTED": {"imu_doubted": True},
    "ENCODER_MOVING": {"wheel_moves": True}, "ENCODER_LOST": {"encoder_lost": True},
    "ENCODER_NOISY": {"encoder_noisy": True}, "CAR_MOVES": {"car_moves": True},
    "PCA_ABSENT": {"bus_fault": "absent"},
    "PCA_MODE": {"bus_fault": "mode"}, "PCA_PRESCALE": {"bus_fault": "prescale"},
    "PCA_WRITE_FAILED": {"bus_fault": "write"}, "NEUTRAL_TOO_SHORT": {"neutral_for": 1.9},
    "PWM_CLOCK_UNCALIBRATED": {"clock_calibrated": False},
    "CALIBRATION_OTHER_BOARD": {"other_board": True},
    "MOVES_AT_NEUTRAL": {"moves_at_neutral": True},
    "THROTTLE_NOT_NEUTRAL": {"throttle": 0.1}, "COMMAND_INVALID": {"command_ok": False},
    "RAW_MODE_OPEN": {"raw_open": True},
    "RUN_STOP": {"run_stop": True},
    "RC_LOST": {"rc_lost": True},
    "GUARD_MISSING": {"guard_age": None}, "GUARD_SILENT": {"guard_age": 0.2},
    "LATCHED": {"latched": True}, "CALIBRATION_MISSING": {"calibration_missing": True},
    "CUTOFF_REQUIRED": {"cutoff_required": True},
    "CUTOFF_UNTESTED": {"cutoff": "mux", "cutoff_test": "pending"},
    "CUTOFF_TEST_FAILED": {"cutoff": "mux", "cutoff_test": "failed"},
    "BEAT_LIMIT_UNKNOWN": {"cutoff": "oe", "beat_limit": None},
    "BEAT_LIMIT_TOO_LONG": {"cutoff": "oe", "beat_limit": 1000},
    "MCU_WATCHDOG_FIRED": {"watchdog_fired": True},
}


def test_every_refusal_has_a_fact_that_raises_it_alone() -> None:
    assert set(BAD_FACTS) == {r.name for r in REFUSALS}
    assert refusals(Facts()) == ()
    for name, facts in BAD_FACTS.items():
        assert refusals(Facts(**facts)) == (name,)


def test_all_reasons_are_named_at_once_with_their_remedies() -> None:
    facts = Facts(raw_open=True, hello=False, throttle=0.2)
    assert refusals(facts) == ("NO_HELLO", "THROTTLE_NOT_NEUTRAL", "RAW_MODE_OPEN")
    s, t = supervisor_in(ArmState.DISARMED)
    with pytest.raises(NotArmed) as caught:
        s.arm(t, refusals(facts))
    assert caught.value.reasons == refusals(facts)
    assert all(BY_NAME[name].remedy in str(caught.value) for name in refusals(facts))


def test_waivers_are_by_name_and_only_for_what_may_be_waived() -> None:
    facts = Facts(clock_calibrated=False, calibration_missing=True, raw_open=True)
    assert set(WAIVABLE) == {"PWM_CLOCK_UNCALIBRATED", "CALIBRATION_MISSING"}
    assert refusals(facts, WAIVABLE) == ("RAW_MODE_OPEN",)
    for name in ("RAW_MODE_OPEN", "NO_SUCH_NAME"):
        with pytest.raises(NotArmed, match="cannot be waived"):
            refusals(facts, [name])


def test_an_imu_that_is_not_required_does_not_refuse() -> None:
    facts = Facts(imu_absent=True, imu_stale=True, imu_stuck=True)
    assert len(refusals(facts)) == 3
    assert refusals(replace(facts, imu_required=False)) == ()


def test_a_cut_off_that_cannot_be_watched_is_known_and_refused_where_the_car_demands_it() -> None:
    facts = Facts(cutoff="mux", cutoff_test="unwired")
    assert refusals(facts) == ()
    assert [w.name for w in list_cautions(facts)] == ["CUTOFF_UNPROVEN"]
    assert refusals(replace(facts, cutoff_test_required=True)) == ("CUTOFF_TEST_FAILED",)


def test_cautions_do_not_refuse_and_have_a_remedy() -> None:
    facts = Facts(calibration_old=True, firmware_dirty=True, imu_calibrated=False, loop_late=0.03)
    assert refusals(facts) == ()
    cautions = list_cautions(facts)
    assert [c.name for c in cautions] == ["NO_HARDWARE_CUTOFF", "CALIBRATION_OLD",
                                          "IMU_UNCALIBRATED", "LOOP_LATE", "FIRMWARE_DIRTY"]
    assert all(c.text and c.remedy and str(c).startswith(c.name) for c in cautions)
    assert not list_cautions(Facts(simulated=True)), "a simulated car needs no cut-off"
