"""RAW on the floor and with lifted wheels: as safe as ARMED, asserted at the ESC pin."""

from __future__ import annotations

import random
from contextlib import suppress

import pytest

from dart_hal.car import Car
from dart_hal.car.facts import Observer
from dart_hal.core.errors import BadCommand, NotArmed
from dart_hal.devices.links.base import open_backend
from dart_hal.recording.run import RunReader
from dart_lab.sim.truth import world_of
from tests.common import MOCK_URL, NEUTRAL_US

pytestmark = pytest.mark.usefixtures("armed_esc")
FAST_US = 1900.0
RESET_SILENCE_S = 0.120
"""s from a reset of the Nano to neutral without a cut-off, as in the fault table."""
LIMITED = "\n[limits]\nmax_throttle = 0.3\n"


class RawBench:
    """A car and the pulses of its ESC pin; ``lift_wheels``: the IMU measures nothing of the
    wheels."""

    def __init__(self, tmp_path, **options) -> None:
        self.backend = open_backend(MOCK_URL)
        self.backend.car_toml += LIMITED
        self.world = world_of(self.backend)
        self.pulses: list[tuple[float, float]] = []
        self.world.watchers.append(lambda channel, pulse: channel == 1 and self.pulses.append(
            (pulse[1], (pulse[1] - pulse[0]) * 1e6)))
        self.car = Car.over(self.backend, cars=tmp_path, **options)

    def lift_wheels(self) -> None:
        sense = self.world.nano.set_imu
        shake = random.Random(1)
        self.world.nano.set_imu = lambda gyro, acc: sense(
            *([shake.gauss(0.0, size) for _ in range(3)] for size in (0.02, 0.3)))

    def spin(self, seconds: float, throttle_us: float = FAST_US) -> None:
        for _ in self.car.states(duration=seconds):
            self.car.pulses(steering_us=1500.0, throttle_us=throttle_us)

    def last_above(self, limit_us: float = NEUTRAL_US + 5.0) -> float:
        return max((end for end, length in self.pulses if length > limit_us), default=0.0)


@pytest.fixture
def bench(tmp_path):
    made = RawBench(tmp_path)
    yield made
    made.car.close()


def test_pulses_after_a_restart_are_marked_as_such(bench):
    with bench.car.raw():
        bench.spin(0.3)
        bench.world.nano.reset("brownout")
        with pytest.raises(BadCommand, match="DISARMED since MCU_REBOOTED"):
            bench.spin(3.0)


def test_a_loop_that_stalls_in_raw_is_stopped(bench):
    car = bench.car
    with car.raw():
        bench.spin(0.3)
        stalled = car._engine.now
        for _ in car.states(duration=1.0):
            pass
        assert bench.last_above() - stalled <= 0.25
        assert car.mode == "DISARMED"
        with pytest.raises(BadCommand, match="COMMAND_EXPIRED"):
            bench.spin(0.1)


def driven_after_a_boot(bench: RawBench) -> float:
    """s from the Nano's reset to the end of the last pulse above neutral; the program goes on."""
    with bench.car.raw():
        bench.spin(0.3)
        assert bench.pulses[-1][1] > NEUTRAL_US + 5.0
        reset = bench.car._engine.now
        bench.world.nano.reset("watchdog")
        with suppress(BadCommand):
            bench.spin(1.0)
        for _ in bench.car.states(duration=0.5):
            pass
    return bench.last_above() - reset


def test_a_nano_that_boots_in_raw_ends_it(bench):
    assert driven_after_a_boot(bench) <= RESET_SILENCE_S
    assert bench.car.mode == "DISARMED"
    with pytest.raises(BadCommand, match="needs raw"):
        bench.spin(0.1)


@pytest.mark.slow
def test_without_the_answer_to_a_boot_it_would_go_on(bench, monkeypatch):
    """Negative control."""
    monkeypatch.setattr(bench.car._engine.receiver, "on_boot", lambda: None)
    assert driven_after_a_boot(bench) > 0.9


def test_on_the_floor_the_limits_of_the_car_hold(bench):
    span = bench.car.files.config.throttle.span_us
    with bench.car.raw():
        bench.spin(0.3, throttle_us=2000.0)
    assert max(length for _, length in bench.pulses) == pytest.approx(
        NEUTRAL_US + 0.3 * span, abs=5.0)


@pytest.mark.slow
def test_wheels_off_the_ground_have_the_full_range_and_it_is_recorded(tmp_path):
    run = tmp_path / "run.mcap"
    bench = RawBench(tmp_path, record=run)
    bench.lift_wheels()
    with bench.car.raw(lifted=True):
        bench.spin(1.0, throttle_us=2000.0)
        assert bench.car.mode == "RAW"
    bench.car.close()
    assert max(length for _, length in bench.pulses) == pytest.approx(2000.0, abs=10.0)
    assert "wheels" in RunReader(run).metadata["raw_lifted"]


def moving(bench: RawBench) -> float:
    """s after the car began to move until the last pulse above neutral."""
    with bench.car.raw(lifted=True):
        began = bench.car._engine.now
        with pytest.raises(BadCommand, match="CAR_MOVES"):
            bench.spin(3.0)
    return bench.last_above() - began


def test_a_car_that_is_not_lifted_after_all_is_stopped(bench):
    assert moving(bench) < 0.6
    assert bench.world.truth().v_x < 2.0


@pytest.mark.slow
def test_without_the_look_at_the_imu_it_would_drive_off(bench, monkeypatch):
    """Negative control."""
    monkeypatch.setattr(Observer, "is_moving", False)
    with pytest.raises(pytest.fail.Exception):
        moving(bench)


def spin_without_imu(bench: RawBench, seconds: float) -> float:
    """Lifted wheels, and the IMU sends zeros for so long; s until the last pulse of the 0.6 s
    that follow the first zeros."""
    bench.lift_wheels()
    with suppress(BadCommand), bench.car.raw(lifted=True):
        bench.spin(0.3)
        began = bench.world.t
        bench.world.nano.set_imu_fault("zero")
        bench.world.schedule(began + seconds, lambda world: world.nano.set_imu_fault())
        bench.spin(0.6)
    return bench.last_above() - began


def test_lifted_wheels_turn_on_through_a_few_samples_of_zeros(bench):
    """A still car with a quiet gyro sends some: calibrate esc ended with "the IMU moves"."""
    assert spin_without_imu(bench, 0.06) > 0.55


def test_lifted_wheels_are_stopped_without_the_imu(bench):
    """The negative control: a gap that may hide a car which comes to the floor."""
    assert spin_without_imu(bench, 0.6) < 0.25


@pytest.mark.slow_except("moving")
@pytest.mark.parametrize("fault", ["moving", "no imu"])
def test_lifted_is_refused_where_the_imu_does_not_show_a_car_at_rest(bench, fault):
    if fault == "moving":
        sense = bench.world.nano.set_imu
        bench.world.nano.set_imu = lambda gyro, acc: sense((0.0, 0.0, 0.6), (0.0, 0.0, 0.0))
    else:
        bench.world.nano.set_imu_fault("off")
    with pytest.raises(NotArmed) as refused, bench.car.raw(lifted=True):
        pass
    assert "CAR_MOVES" in refused.value.reasons
    assert bench.car.mode == "DISARMED"


@pytest.mark.slow
def test_no_pulse_at_all_is_for_lifted_wheels(bench):
    """On the floor it is refused; lifted, a loop that stalls gets its neutral back."""
    with bench.car.raw():
        with pytest.raises(BadCommand, match="lifted wheels"):
            bench.spin(0.1, throttle_us=None)
        bench.car.stop()
    bench.backend.workshop.lift()
    with bench.car.raw(lifted=True):
        bench.spin(0.3)
        bench.spin(0.3, throttle_us=None)
        applied = next(iter(bench.car.states())).applied
        assert (applied.throttle, applied.throttle_us) == (0.0, 0.0)
        quiet = bench.car._engine.now
        assert bench.pulses[-1][0] < quiet - 0.2
        for _ in bench.car.states(duration=0.4):
            pass
        assert bench.car.mode == "DISARMED"
        assert "COMMAND_EXPIRED" in bench.car.causes
    back = [(end, width) for end, width in bench.pulses if end > quiet]
    assert back[0][0] < quiet + 0.3
    assert max(abs(width - NEUTRAL_US) for _, width in back) < 5.0
