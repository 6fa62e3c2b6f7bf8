"""The actuator while open: limits, expiry, priorities, faults."""

from __future__ import annotations

import errno
import math
from dataclasses import replace
from fractions import Fraction

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.core.config import CarFiles
from dart_hal.core.errors import BadCommand, PcaFault
from dart_hal.devices.actuation import LIVE_DEMAND, RAW_DEMAND, Actuator, PinDemand
from dart_hal.devices.actuation.pca9685 import NEUTRAL_FRAMES
from tests.devices.actuation.pwm_world import World, car_files

NEUTRAL = pytest.approx(1500.0, abs=5.0)
HELD = PinDemand("neutral", "held", ("NOT_ARMED",))


def opened(files: CarFiles | None = None, output: PinDemand = LIVE_DEMAND,
           **options: object) -> tuple[World, Actuator]:
    world = World()
    actuator = world.actuator(files, **options)
    actuator.open()
    actuator.demand = lambda: output
    return world, actuator


def drive(world: World, actuator: Actuator, steering: float, throttle: float, frames: int = 1,
          source: str = "user") -> None:
    for _ in range(frames):
        actuator.command(steering, throttle, 0.2, source, world.t)
        world.run(actuator, 1)


def test_a_command_reaches_the_pins_as_angle_and_throttle() -> None:
    world, actuator = opened()
    drive(world, actuator, 0.2, 0.3, frames=50)
    throttle = [length for _, length in world.pulses(1)[-40:]]
    steering = [length for _, length in world.pulses(0)[-40:]]
    assert sum(throttle) / 40 == pytest.approx(1500 + 450 * 0.3, abs=0.2)
    assert actuator.map.angle(sum(steering) / 40) == pytest.approx(0.2, abs=2e-4)
    assert actuator.applied.steering == pytest.approx(0.2, abs=0.009)


def test_no_command_moves_a_disarmed_car() -> None:
    world, actuator = opened(output=PinDemand())
    applied = actuator.command(0.3, 1.0, 0.2, "user", world.t)
    assert "NOT_ARMED" in applied.limited
    drive(world, actuator, 0.3, 1.0, frames=20)
    assert all(length == NEUTRAL for _, length in world.pulses(1)[3:])
    assert actuator.applied.steering == pytest.approx(0.0, abs=0.01)


def test_command_returns_what_the_next_frame_applies() -> None:
    world, actuator = opened()
    for steering, throttle in ((0.1, 0.2), (-0.3, -0.5), (9.0, 9.0), (0.0, 0.0)) * 5:
        promised = actuator.command(steering, throttle, 0.2, "user", world.t)
        assert actuator.frame(world.t) == promised
        world.t += 0.02


def test_a_command_of_the_disarmed_car_has_no_effect_after_arming() -> None:
    world, actuator = opened(output=PinDemand())
    actuator.command(0.0, 1.0, 0.5, "user", world.t)
    actuator.demand = lambda: LIVE_DEMAND
    world.run(actuator, 3)
    assert actuator.applied.throttle_us == NEUTRAL


@pytest.mark.parametrize("throttle", [0.5, -0.5])
def test_a_command_expires_to_neutral_with_steering_held_and_trips_once(throttle) -> None:
    world, actuator = opened()
    drive(world, actuator, 0.2, throttle, frames=5)
    before = actuator.applied.steering
    world.run(actuator, 9)                                    # 0.18 s: still valid
    assert actuator.applied.throttle == pytest.approx(throttle, abs=0.02)
    assert actuator.trips() == ()
    world.run(actuator, 2)
    assert actuator.applied.throttle_us == NEUTRAL
    assert "EXPIRED" in actuator.applied.limited
    assert actuator.applied.steering == pytest.approx(before, abs=0.01)
    world.run(actuator, 5)
    assert "EXPIRED" in actuator.applied.limited
    assert actuator.trips() == ("COMMAND_EXPIRED",)
    assert actuator.trips() == ()
    assert actuator.counters.expired == 1


def test_running_out_at_neutral_is_a_stop_and_no_trip() -> None:
    world, actuator = opened()
    drive(world, actuator, 0.2, 0.0, frames=5)
    world.run(actuator, 30)
    assert actuator.trips() == ()
    assert "EXPIRED" in actuator.applied.limited


def test_validity_is_limited_to_half_a_second() -> None:
    world, actuator = opened()
    assert "VALIDITY" in actuator.command(0.0, 0.5, 60.0, "user", world.t).limited
    world.run(actuator, 30)
    assert actuator.applied.throttle_us == NEUTRAL


@pytest.mark.parametrize("valid_for", [0.1, 0.5])
def test_a_validity_within_the_limit_is_not_reported(valid_for) -> None:
    world, actuator = opened()
    assert "VALIDITY" not in actuator.command(0.0, 0.5, valid_for, "user", world.t).limited


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("place", ["steering", "throttle", "valid_for"])
def test_a_command_that_is_not_a_number_is_neutral_in_the_same_call(bad, place) -> None:
    world, actuator = opened()
    drive(world, actuator, 0.1, 0.5, frames=5)
    values = {"steering": 0.1, "throttle": 0.5, "valid_for": 0.2, place: bad}
    with pytest.raises(BadCommand, match=place):
        actuator.command(**values, source="user", now=world.t)
    assert actuator.applied.throttle_us == NEUTRAL
    assert actuator.trips() == ("COMMAND_INVALID",)
    drive(world, actuator, 0.1, 0.5, frames=5)               # not without the supervisor
    assert actuator.applied.throttle_us == NEUTRAL
    actuator.demand = lambda: HELD
    world.run(actuator, 1)
    actuator.demand = lambda: LIVE_DEMAND
    drive(world, actuator, 0.1, 0.5, frames=5)
    assert actuator.applied.throttle == pytest.approx(0.5, abs=0.02)


def test_time_that_goes_back_is_refused() -> None:
    world, actuator = opened()
    drive(world, actuator, 0.1, 0.5, frames=5)
    with pytest.raises(BadCommand, match="time went back"):
        actuator.command(0.1, 0.5, 0.2, "user", world.t - 1.0)
    actuator.frame(world.t - 1.0)
    assert actuator.applied.throttle_us == NEUTRAL
    assert actuator.trips() == ("COMMAND_INVALID", "TIME_BACKWARD")


@given(st.floats(-2, 2), st.floats(-2, 2))
def test_commands_are_clipped_to_the_limits_and_clipping_is_reported(steering, throttle) -> None:
    world, actuator = opened(car_files(max_throttle=0.5, min_throttle=-0.3, max_steering=0.25))
    drive(world, actuator, steering, throttle, frames=3)
    applied, count = actuator.applied, 4.88 / 450 + 1e-9
    assert -0.3 - count <= applied.throttle <= 0.5 + count
    assert abs(applied.steering) <= 0.25 + 0.009
    beyond = not -0.3 <= throttle <= 0.5 or abs(steering) > 0.25
    assert ("RANGE" in applied.limited) == beyond


@given(st.lists(st.tuples(st.floats(-0.3, 0.3), st.floats(-1, 1)), min_size=1, max_size=15))
def test_slew_limits_hold_between_any_two_frames(commands) -> None:
    world, actuator = opened(car_files(steering_slew=2.0, throttle_slew=5.0))
    last = actuator.applied
    for steering, throttle in commands:
        drive(world, actuator, steering, throttle)
        applied = actuator.applied
        assert abs(applied.throttle - last.throttle) <= 5.0 * 0.02 + 2 * 4.88 / 450 + 1e-9
        assert abs(applied.steering - last.steering) <= 2.0 * 0.02 + 2 * 0.0085
        last = applied


def test_stop_is_neutral_at_once_despite_the_slew_limit_with_steering_held() -> None:
    world, actuator = opened(car_files(steering_slew=2.0, throttle_slew=5.0))
    drive(world, actuator, 0.2, 0.8, frames=20)
    before = actuator.applied.steering
    assert actuator.stop().throttle_us == NEUTRAL
    assert actuator.applied.steering == pytest.approx(before, abs=0.01)


def test_a_stop_ramp_of_the_car_file_takes_its_time() -> None:
    files = car_files()
    throttle = msgspec.structs.replace(files.config.throttle, stop_ramp=0.5)
    files = CarFiles(msgspec.structs.replace(files.config, throttle=throttle), files.calibration,
                     None, files.folder, "x")
    world, actuator = opened(files)
    drive(world, actuator, 0.0, 1.0, frames=5)
    actuator.stop()
    actuator.demand = lambda: HELD
    world.run(actuator, 12)
    assert actuator.applied.throttle == pytest.approx(0.5, abs=0.05)
    world.run(actuator, 15)
    assert actuator.applied.throttle_us == NEUTRAL


def test_the_source_listed_first_wins_and_the_other_is_reported() -> None:
    world, actuator = opened()
    actuator.command(0.0, 0.5, 0.2, "user", world.t)
    actuator.command(0.0, -0.1, 0.1, "gamepad", world.t)
    lost = actuator.command(0.0, 0.5, 0.2, "user", world.t)
    assert lost.limited[0] == "OVERRIDDEN(gamepad)"
    world.run(actuator, 1)
    assert actuator.applied.throttle == pytest.approx(-0.1, abs=0.02)
    world.t += 0.1                                            # the gamepad falls silent
    world.run(actuator, 1)
    assert actuator.applied.throttle == pytest.approx(0.5, abs=0.02)


def test_an_unlisted_source_loses_against_every_listed_one() -> None:
    world, actuator = opened()
    actuator.command(0.0, 0.2, 0.2, "user", world.t)
    lost = actuator.command(0.0, 0.9, 0.2, "stranger", world.t)
    assert "OVERRIDDEN(user)" in lost.limited


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_throttle_cap_of_a_lost_encoder(sign) -> None:
    world, actuator = opened()
    actuator.throttle_cap = 0.1
    drive(world, actuator, 0.0, sign * 0.5, frames=2)
    assert actuator.applied.throttle == pytest.approx(sign * 0.1, abs=0.012)
    assert "RANGE" in actuator.applied.limited


def raw_pulses(world: World, actuator: Actuator, throttle_us: float, frames: int = 1,
               steering_us: float = 1300.0) -> None:
    for _ in range(frames):
        actuator.pulses(steering_us, throttle_us, world.t)
        world.run(actuator, 1)


def test_raw_pulses_act_in_raw_mode_alone_and_within_1000_to_2000_us() -> None:
    world, actuator = opened(output=PinDemand())
    actuator.pulses(1300.0, 1700.0, world.t)
    world.run(actuator, 3)
    assert actuator.applied.throttle_us == NEUTRAL
    actuator.demand = lambda: RAW_DEMAND
    world.run(actuator, 3)
    assert actuator.applied.throttle_us == NEUTRAL, "a pulse from before raw() must not act"
    raw_pulses(world, actuator, 1700.0, frames=3)
    assert actuator.applied.throttle_us == pytest.approx(1700, abs=4.9)
    assert actuator.applied.steering_us == pytest.approx(1300, abs=4.9)
    for pulse in (999.0, 2001.0, math.nan, True, "1500", None):
        with pytest.raises(BadCommand, match="throttle_us"):
            actuator.pulses(1500.0, pulse, world.t)
    assert actuator.applied.throttle_us == NEUTRAL


def test_raw_pulses_hold_for_a_fifth_of_a_second_and_running_out_trips() -> None:
    world, actuator = opened(output=RAW_DEMAND)
    limited = actuator.pulses(1300.0, 1700.0, world.t, valid_for=60.0).limited
    assert "VALIDITY" in limited
    world.run(actuator, 11)
    assert actuator.applied.throttle_us == pytest.approx(1700, abs=4.9)
    assert actuator.trips() == ()
    world.run(actuator, 1)
    assert actuator.applied.throttle_us == NEUTRAL
    assert actuator.applied.steering_us == pytest.approx(1300, abs=4.9)
    assert "EXPIRED" in actuator.applied.limited
    assert actuator.trips() == ("COMMAND_EXPIRED",)


def test_raw_pulses_that_run_out_at_neutral_are_no_trip() -> None:
    world, actuator = opened(output=RAW_DEMAND)
    raw_pulses(world, actuator, 1500.0)
    world.run(actuator, 20)
    assert actuator.trips() == ()


def test_raw_obeys_the_limits_of_the_car_and_the_cap_of_a_lost_encoder() -> None:
    world, actuator = opened(car_files(max_throttle=0.2, min_throttle=0.0), output=RAW_DEMAND)
    raw_pulses(world, actuator, 1900.0, frames=3)
    assert actuator.applied.throttle_us == pytest.approx(1500 + 0.2 * 450, abs=4.9)
    assert "RANGE" in actuator.applied.limited
    raw_pulses(world, actuator, 1100.0, frames=3)
    assert actuator.applied.throttle_us == NEUTRAL
    actuator.throttle_cap = 0.0
    raw_pulses(world, actuator, 1900.0, frames=3)
    assert actuator.applied.throttle_us == NEUTRAL
    raw_pulses(world, actuator, 1500.0, frames=3, steering_us=1000.0)
    servo = actuator.car.steering
    assert actuator.applied.steering_us == pytest.approx(servo.center_us - servo.span_us, abs=4.9)


def test_wheels_off_the_ground_have_the_full_range() -> None:
    world, actuator = opened(car_files(max_throttle=0.2),
                             output=replace(RAW_DEMAND, full_range=True))
    raw_pulses(world, actuator, 2000.0, frames=3, steering_us=1000.0)
    assert actuator.applied.throttle_us == pytest.approx(2000, abs=4.9)
    assert actuator.applied.steering_us == pytest.approx(1000, abs=4.9)


@pytest.mark.parametrize("wild", [1e300, -11.0, True, None, "x", 10**400, [1], b"1"])
@pytest.mark.parametrize("place", ["steering", "throttle"])
def test_wild_numbers_are_refused_at_neutral(wild, place) -> None:
    world, actuator = opened()
    drive(world, actuator, 0.1, 0.5, frames=5)
    values = {"steering": 0.1, "throttle": 0.5, "valid_for": 0.2, place: wild}
    with pytest.raises(BadCommand, match=place) as refused:
        actuator.command(**values, source="user", now=world.t)
    assert refused.value.expected
    assert refused.value.remedy
    assert actuator.applied.throttle_us == NEUTRAL
    assert actuator.trips() == ("COMMAND_INVALID",)


@pytest.mark.parametrize(("neutral_us", "pulse_us"), [(600.0, 750.0), (2400.0, 2250.0)])
def test_a_wrong_neutral_is_bounded_to_the_range_of_servokit(neutral_us, pulse_us) -> None:
    _, actuator = opened()
    actuator._planner._neutral_us = neutral_us
    assert actuator._planner.plan_neutral(0.0, ()).throttle_us == pulse_us


def test_a_long_text_as_a_command_is_cut_in_the_message() -> None:
    world, actuator = opened()
    with pytest.raises(BadCommand) as refused:
        actuator.command(0.0, "x" * 10_000, 0.2, "user", world.t)
    assert refused.value.found == "'" + "x" * 79


def test_what_numpy_calls_a_number_is_one() -> None:
    world, actuator = opened()
    for number in (np.float64(0.5), np.float32(0.5), np.array(0.5), Fraction(1, 2)):
        actuator.command(number, number, number, "user", world.t)
    with pytest.raises(BadCommand):
        actuator.command(0.0, np.True_, 0.2, "user", world.t)


def test_an_equal_value_is_written_within_100_ms_of_a_brown_out() -> None:
    world, actuator = opened()
    drive(world, actuator, 0.0, 0.0, frames=10)
    browned = world.t
    world.chip.brown_out(world.t)
    drive(world, actuator, 0.0, 0.0, frames=10)
    led = [t for t in world.bus.log if t.t_start >= browned and len(t.written) == 9]
    assert led[0].t_stop - browned < 0.1


def test_a_brown_out_is_found_in_1_1_s_and_healed_at_neutral() -> None:
    world, actuator = opened()
    drive(world, actuator, 0.1, 0.5, frames=10)
    world.pulses(1)
    browned = world.t
    world.chip.brown_out(world.t)
    for _ in range(120):
        actuator.command(0.1, 0.5, 0.2, "user", world.t)
        world.run(actuator, 1)
    after = [(rise, length) for rise, length in world.pulses(1) if rise > browned]
    assert after[0][0] - browned < 1.1
    assert all(length == NEUTRAL for _, length in after)
    assert len(after) > 50
    assert actuator.trips() == ("PCA_READBACK",)
    assert actuator.counters.reinits == 1
    assert "NOT_ARMED" in actuator.applied.limited


def test_one_or_two_missing_acknowledges_do_not_show() -> None:
    world, actuator = opened()
    drive(world, actuator, 0.0, 0.5, frames=3)
    world.bus.nack = 2
    drive(world, actuator, 0.0, 0.5, frames=1)
    assert actuator.trips() == ()
    assert actuator.counters.retries == 2
    assert actuator.applied.throttle == pytest.approx(0.5, abs=0.02)


def test_a_lost_bus_is_a_fault_that_ends_at_neutral_when_the_chip_answers() -> None:
    world, actuator = opened()
    drive(world, actuator, 0.0, 0.5, frames=3)
    world.bus.stuck = "scl"
    drive(world, actuator, 0.0, 0.5, frames=20)
    assert actuator.fault is not None
    assert actuator.trips() == ("PCA_WRITE_FAILED",)
    world.bus.stuck = ""
    drive(world, actuator, 0.0, 0.5, frames=8)
    assert actuator.fault is None
    assert actuator.applied.throttle_us == NEUTRAL


def test_a_lost_chip_is_tried_again_each_100_ms() -> None:
    world, actuator = opened()
    drive(world, actuator, 0.0, 0.5, frames=3)
    world.bus.stuck = "scl"
    attempts: list[float] = []
    bring_up = actuator.pca.open

    def counted(*given: object) -> None:
        attempts.append(world.t)
        bring_up(*given)

    actuator.pca.open = counted
    drive(world, actuator, 0.0, 0.5, frames=50)
    pauses = np.diff(attempts)
    assert len(pauses) >= 8
    assert pauses.min() > 0.099, "the bus is not flooded"
    assert pauses.max() < 0.121, "five or six frames of 20 ms"


def fail_reads(world: World) -> None:
    """From now on each read fails, and each write is taken."""
    transfer = world.bus.transfer

    def writes_only(address: int, data: bytes, n_read: int) -> bytes:
        if n_read:
            raise OSError(errno.EIO, "interrupted")
        return transfer(address, data, n_read)

    world.bus.transfer = writes_only


def test_a_chip_that_cannot_be_set_up_again_gets_neutral_all_the_same() -> None:
    """Setting it up takes some twenty transfers, reads first; neutral is one write."""
    world, actuator = opened()
    drive(world, actuator, 0.1, 0.5, frames=10)
    fail_reads(world)
    while actuator.fault is None:
        drive(world, actuator, 0.1, 0.5)
    noticed = world.t
    assert actuator.trips() == ("PCA_WRITE_FAILED",)
    for _ in range(60):
        drive(world, actuator, 0.1, 0.5)
        assert actuator.applied.throttle_us == NEUTRAL
    # A pulse that is under way, and no other, may still be that of the command.
    late = [length for rise, length in world.pulses(1) if rise > noticed + 0.02]
    assert len(late) >= 58
    assert all(length == NEUTRAL for length in late)


def test_a_chip_with_other_settings_that_cannot_be_set_up_gets_no_pulse() -> None:
    """By another prescale, the counts of neutral may be those of full throttle."""
    world, actuator = opened()
    drive(world, actuator, 0.1, 0.5, frames=10)

    def find_other_prescale(*, pulses: bool = True) -> None:
        fail_reads(world)
        raise PcaFault("the PCA9685 lost its settings")

    actuator.pca.check = find_other_prescale
    drive(world, actuator, 0.1, 0.5, frames=60)
    world.t += 1.0
    assert world.t - world.pulses(1)[-1][0] > 0.9
    assert actuator.applied.throttle_us == 0.0


def test_a_bus_that_another_user_keeps_locked_is_a_fault_and_no_hang() -> None:
    world, actuator = opened()
    drive(world, actuator, 0.1, 0.5, frames=3)
    tries: list[float] = []

    def refuse() -> bool:
        tries.append(world.t)
        assert len(tries) < 100_000, "it waits for ever"
        return False

    try_lock, world.bus.try_lock = world.bus.try_lock, refuse
    drive(world, actuator, 0.1, 0.5, frames=10)
    assert actuator.trips() == ("PCA_WRITE_FAILED",)
    assert "stays locked" in actuator.fault.what
    world.bus.try_lock = try_lock
    drive(world, actuator, 0.1, 0.5, frames=10)
    assert actuator.fault is None
    assert actuator.applied.throttle_us == NEUTRAL


def test_a_fault_that_is_pending_on_closing_starts_no_pulse_afterwards() -> None:
    world, actuator = opened()
    drive(world, actuator, 0.1, 0.5, frames=3)
    world.bus.nack = 10**9
    drive(world, actuator, 0.1, 0.5, frames=1)
    assert actuator.fault is not None
    world.bus.nack = 0
    actuator.close()
    world.run(actuator, 10)                                   # a thread that is still under way
    assert world.t - world.pulses(1)[-1][0] > 0.15
    assert actuator.applied.throttle_us == 0.0


def test_opening_that_fails_leaves_no_pulse(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World()
    world.abandoned()
    actuator = world.actuator()

    def check(*, pulses: bool = True) -> None:
        raise PcaFault("the PCA9685 lost its settings")

    monkeypatch.setattr(actuator.pca, "check", check)
    with pytest.raises(PcaFault):
        actuator.open(keep_off=True)
    world.t += 1.0
    assert world.t - world.pulses(1)[-1][0] > 0.9


def test_the_watch_pulse_comes_back_after_all_channels_were_switched_off() -> None:
    """The guard switches off all channels; the Nano needs this pulse to switch between others."""
    world, actuator = opened()
    actuator.watched = True
    drive(world, actuator, 0.0, 0.0, frames=10)
    world.write(0xFD, 0x10)
    drive(world, actuator, 0.0, 0.0, frames=60)
    assert world.t - world.pulses(15)[-1][0] < 0.1


def test_another_program_that_stops_the_chip_is_found_by_reading_back() -> None:
    world, actuator = opened()
    drive(world, actuator, 0.0, 0.0, frames=60)
    world.write(0x00, 0x31)
    with pytest.raises(PcaFault, match="lost its settings"):
        actuator.pca.check()
    drive(world, actuator, 0.0, 0.0, frames=60)
    assert actuator.counters.reinits == 1
    actuator.pca.check()


def test_the_gate_is_called_right_before_a_write_that_moves_the_car() -> None:
    tripped: list[str | None] = [None]
    world, actuator = opened(gate=lambda: tripped[0])
    drive(world, actuator, 0.0, 0.5, frames=3)
    assert actuator.applied.throttle == pytest.approx(0.5, abs=0.02)
    tripped[0] = "GUARD_SILENT"
    actuator.command(0.0, 0.5, 0.2, "user", world.t)
    actuator.frame(world.t)
    assert actuator.applied.throttle_us == NEUTRAL
    assert actuator.trips() == ("GUARD_SILENT",)


def test_closing_is_neutral_for_some_frames_and_then_no_pulse_on_a_chip_awake() -> None:
    world, actuator = opened()
    drive(world, actuator, 0.2, 0.5, frames=10)
    before = len(world.pulses(1))
    actuator.close()
    world.t += 1.0
    after = world.pulses(1)[before + 1:]
    assert len(after) >= NEUTRAL_FRAMES - 2
    assert all(length == NEUTRAL for _, length in after)
    assert world.t - after[-1][0] > 0.9
    assert world.t - world.pulses(0)[-1][0] > 0.9, "an ESC on the other channel gets none either"
    assert world.chip.peek(0x00) & 0x10 == 0
    written = len(world.bus.log)
    actuator.close()
    actuator.stop()
    assert len(world.bus.log) == written, "closed means no write"


def test_without_a_bus_commands_are_reported_as_not_sent() -> None:
    actuator = Actuator(car_files(), None, lambda s: None)
    actuator.open()
    actuator.demand = lambda: LIVE_DEMAND
    actuator.command(0.1, 0.3, 0.2, "user", 1.0)
    applied = actuator.frame(1.0)
    assert applied.throttle == pytest.approx(0.3, abs=0.02)
    assert {"NOT_SENT", "UNCALIBRATED"} <= set(applied.limited)
    actuator.clock_pulse(1500.0)
    actuator.close()


def test_the_clock_channel_pulses_and_the_cars_own_may_not() -> None:
    world, actuator = opened()
    actuator.clock_pulse(1500.0)
    world.run(actuator, 5)
    assert world.pulses(15)[-1][1] == pytest.approx(1500, abs=2.5)
    with pytest.raises(ValueError, match="drives the car"):
        actuator.pca.write_channel(1, 400)


def test_a_neutral_throttle_reads_zero_and_is_constant() -> None:
    world, actuator = opened()
    drive(world, actuator, 0.1, 0.0, frames=10)
    assert actuator.applied.throttle == 0.0
    assert {round(length, 3) for _, length in world.pulses(1)} == {1498.16}
