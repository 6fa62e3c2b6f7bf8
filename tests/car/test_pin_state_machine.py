"""In any order of events the ESC pin follows the mode.

Not ARMED and not RAW: every pulse within 5 us of neutral, or none, 40 ms after
the mode changed. Where the bus is lost and no cut-off is fitted, FAULT means that.
And no pulse away from neutral, ever, without a live command.
"""

from __future__ import annotations

import contextlib
import math

import pytest
from hypothesis import Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)
from pin_witness import Witness

from dart_hal.car import Car, engine
from dart_hal.car.driver import Driver
from dart_hal.core.errors import BadCommand, LinkLost, NotArmed
from dart_hal.devices.actuation import Event
from dart_hal.devices.actuation.plan import Planner
from dart_hal.devices.links.base import open_backend
from dart_hal.wire.codec import UP
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.messages import HELLO
from dart_lab.sim.truth import world_of

FAULT_WITHIN = 0.08
"""s from a bus that fails to its mode: two PWM frames of tries, and a State."""


WAIT = st.sampled_from([0.3, 0.05, 0.0])
"""s that pass behind a fault, while the user's loop goes on."""


class Guarded:
    """A guard process as the driver sees it, without the process."""

    writes = False

    def __init__(self) -> None:
        self.tripped = False
        self.age = 0.0

    def gate(self):
        return "GUARD_TRIPPED" if self.tripped else "GUARD_SILENT" if self.age is None else None

    def ready(self) -> None: ...

    def beat(self, *, at_neutral: bool, off: bool = False) -> None:
        self.tripped = self.tripped and not at_neutral

    def close(self, *, at_neutral: bool) -> None: ...


class PinMachine(RuleBasedStateMachine):
    """One simulated car; every rule lets some time pass."""

    nano = "mock"
    cutoffs = ("none", "oe", "mux")

    @initialize(data=st.data(),
                boot=st.sampled_from(["none", "old", "optiboot"]), seed=st.integers(1, 3))
    def open(self, data, boot, seed):
        self.cutoff = cutoff = data.draw(st.sampled_from(self.cutoffs))
        self.backend = open_backend(
            f"sim://?nano={self.nano}&seed={seed}&cutoff={cutoff}&boot={boot}&physics=kinematic")
        self.world = world_of(self.backend)
        self.car = Car.over(self.backend, raise_on_trip=False)
        self.driver = self.car._engine.driver
        self.guard = Guarded()
        self.driver._guard = self.guard
        self.driver.actuator.gate = self.guard.gate
        self.driver.observer.guard_age = lambda: self.guard.age
        self.witness = Witness(self.world)
        self.raw = None
        self.loop = None
        self.bus_lost_at = math.inf
        self.deaf_until = self.mute_until = self.no_hello_until = -math.inf
        self.car.on_bytes(self._line)
        self.car.on_state(lambda state: self._look())
        self._look()
        self.drive_on(0.5)

    # -- what happens ---------------------------------------------------------------

    @rule(throttle=st.sampled_from([0.5, 0.3, -0.4, None]))
    def drive_on(self, throttle):
        """Everything heals, the car arms, and the user's loop drives on under any event that
        follows; or it stops commanding (None)."""
        self._drive_on(throttle)

    @precondition(lambda self: self.car.mode != "ARMED")
    @rule(throttle=st.sampled_from([0.5, -0.4]))
    def drive_on_after_a_stop(self, throttle):
        """Again: what matters is what happens to a car that moves."""
        self._drive_on(throttle)

    @rule()
    def arm(self):
        with contextlib.suppress(NotArmed, LinkLost):
            self.car.arm()

    @precondition(lambda self: self.loop is None and self.car.mode == "ARMED")
    @rule(throttle=st.floats(-0.4, 0.5), valid_for=st.sampled_from([0.05, 0.2, 0.5]))
    def one_command(self, throttle, valid_for):
        self._drive(throttle, valid_for)

    @precondition(lambda self: self.raw is None and self.car.mode == "DISARMED")
    @rule(lifted=st.booleans())
    def open_raw(self, lifted):
        block = self.car.raw(lifted=lifted)
        with contextlib.suppress(NotArmed, LinkLost):
            block.__enter__()
            self.raw = block

    @precondition(lambda self: self.raw is not None)
    @rule(throttle_us=st.floats(1300, 1900), frames=st.integers(1, 25), again=st.booleans())
    def pulses(self, throttle_us, frames, again):
        for k in range(frames):
            if k == 0 or again:
                with contextlib.suppress(BadCommand):
                    self._command(0.2, lambda: self.car.pulses(
                        steering_us=1500, throttle_us=throttle_us))
            self._pass(0.01)

    @precondition(lambda self: self.raw is not None)
    @rule()
    def close_raw(self):
        block = self.raw
        self.raw = None
        block.__exit__(None, None, None)

    @rule(wait=WAIT)
    def stop(self, wait):
        self.car.stop()
        self._pass(wait)

    @rule(bad=st.sampled_from([math.nan, True, "x", None, 1e300]), wait=WAIT)
    def command_that_is_no_number(self, bad, wait):
        with pytest.raises(BadCommand):
            self.car.drive(throttle=bad)
        lost = self.backend.bus.nack > 0            # then the pin could not be changed
        assert lost or self.driver.actuator.applied.throttle == 0.0
        self._pass(wait)

    @rule(cause=st.sampled_from(["brownout", "watchdog", "external"]), reported=st.booleans(),
          wait=WAIT)
    def reboot(self, cause, reported, wait):
        if not reported:
            self.no_hello_until = self.now + 4.0
        self.witness.resets.append(self.world.t)
        self.world.nano.reset(cause)
        self._pass(wait)

    @rule(seconds=st.floats(0.02, 0.4), up=st.booleans(), down=st.booleans(), wait=WAIT)
    def silence(self, seconds, up, down, wait):
        self.deaf_until = self.now + seconds * up
        if down:
            self.witness.muted.append(self.now)
            self.mute_until = self.now + seconds
        self._pass(wait)

    @rule(times=st.sampled_from([1, 3, 10**9]), wait=WAIT)
    def bus_error(self, times, wait):
        self.backend.bus.nack = max(self.backend.bus.nack, times)
        self.bus_lost_at = min(self.bus_lost_at, self.now) if times > 3 else self.bus_lost_at
        self._pass(wait)

    @rule(wait=WAIT)
    def bus_back(self, wait):
        self.backend.bus.nack = 0
        self.bus_lost_at = math.inf
        self._pass(wait)

    @rule(wait=WAIT)
    def brown_out_of_the_board(self, wait):
        self.witness.resets.append(self.world.t)        # cuts the pulse under way
        self.world.pca.brown_out(self.world.t)
        self._pass(wait)

    @rule(age=st.sampled_from([None, 0.0]), tripped=st.booleans(), wait=WAIT)
    def guard_fails(self, age, tripped, wait):
        self.guard.age = age
        self.guard.tripped = tripped
        self._pass(wait)

    @rule(on=st.booleans(), wait=WAIT)
    def encoder(self, on, wait):
        self.world.nano.set_ring(0, self.world.car.ring_a.edges if on else ())
        self._pass(wait)

    @rule(fault=st.sampled_from(["ok", "off", "stuck", "garbage"]), wait=WAIT)
    def imu(self, fault, wait):
        self.world.nano.set_imu_fault(fault)
        self._pass(wait)

    @precondition(lambda self: self.car.mode == "LOCKED")
    @rule()
    def unlock(self):
        self.car.unlock("the test goes on")

    @rule(seconds=st.floats(0.01, 0.7))
    def time_passes(self, seconds):
        self._pass(seconds)

    # -- what must hold -----------------------------------------------------------

    @invariant()
    def pin_follows_the_mode(self):
        if hasattr(self, "witness"):
            self._look()
            self.witness.check(cutoff=self.cutoff)

    def teardown(self):
        if not hasattr(self, "car"):
            return
        self._pass(0.1)
        self.backend.bus.nack = 0
        self.backend.link.close = lambda: None          # the world goes on without the program
        self.car.close()
        self._look()
        end = self.world.t
        self.world.advance(end + 0.5)
        self.witness.record_mode(end, "CLOSED")
        self.witness.check(cutoff=self.cutoff)
        self.world.nano.close()

    # -- helpers ------------------------------------------------------------------------

    @property
    def now(self):
        return self.car._engine.now

    def _drive_on(self, throttle):
        self._heal()
        if self.car.mode != "ARMED":
            self.loop = None
            if self.raw is not None:
                self.close_raw()
            self._pass(0.9)
            with contextlib.suppress(NotArmed, LinkLost):
                self.car.arm()
        self.loop = throttle
        self._pass(0.1)

    def _line(self, direction, data, t):
        if t < (self.deaf_until if direction == "rx" else self.mute_until):
            return b""
        if direction == "rx" and t < self.no_hello_until:
            frames = FrameDecoder(UP).feed(data)
            return b"" if any(f.message is HELLO for f in frames) else data
        return data

    def _heal(self):
        self.bus_back(wait=0.0)
        self.guard.age = 0.0
        self.guard.tripped = False
        self.deaf_until = self.mute_until = self.no_hello_until = -math.inf
        self.encoder(on=True, wait=0.0)
        self.imu(fault="ok", wait=0.0)
        self.driver.observer._lost.clear()              # else FRAME_LOSS refuses for 5 s
        if self.car.mode == "LOCKED":
            self.unlock()

    def _drive(self, throttle, valid_for=0.2):
        self._command(valid_for, lambda: self.car.drive(throttle=throttle, valid_for=valid_for))

    def _command(self, valid_for, call):
        now = self.now
        call()
        self.witness.record_command(now, now + valid_for)
        self._look()

    def _pass(self, seconds):
        end = self.now + seconds
        while self.now < end - 1e-9:
            with contextlib.suppress(LinkLost):
                for _ in self.car.states(duration=end - self.now, timeout=end - self.now):
                    if self.loop is not None:
                        self._drive(self.loop)
            self._look()
        self.witness.check(cutoff=self.cutoff)

    def _look(self):
        mode = self.car.mode
        self.witness.record_mode(self.now, mode)
        if self.now - self.bus_lost_at > FAULT_WITHIN:
            assert mode in ("FAULT", "CLOSED"), f"the bus is lost and the mode is {mode}"


QUICK_SETTINGS = settings(stateful_step_count=20, deadline=None, derandomize=True,
                          database=None, phases=[Phase.explicit, Phase.generate])


class FirmwareMachine(PinMachine):
    nano = "avr"


@pytest.mark.parametrize("examples", [4, pytest.param(25, marks=pytest.mark.slow)])
def test_the_pin_follows_the_mode(examples):
    run_state_machine_as_test(PinMachine, settings=settings(QUICK_SETTINGS, max_examples=examples))


@pytest.mark.emulator
@pytest.mark.parametrize("examples", [2, pytest.param(6, marks=pytest.mark.slow)])
def test_the_pin_of_the_firmware_follows_the_mode(examples):
    run_state_machine_as_test(FirmwareMachine,
                              settings=settings(QUICK_SETTINGS, max_examples=examples))


@pytest.mark.long
@pytest.mark.emulator
@pytest.mark.parametrize("machine", [PinMachine, FirmwareMachine])
def test_the_pin_follows_the_mode_in_many_orders(machine):
    run_state_machine_as_test(machine, settings=settings(QUICK_SETTINGS, max_examples=200,
                                                         stateful_step_count=40))


def sticky(planner, output):
    """An output that is set where the car arms and forgotten where it disarms."""
    if output.live:
        planner.demand = output


def send_without_stop(driver, now, event=Event.STOP):
    """A stop that changes the state and leaves the pins to somebody else."""
    driver.supervisor.event(event, now)
    return driver.applied


class NoCutoff:
    """What hypothesis would draw for the cut-off."""

    @staticmethod
    def draw(strategy):
        return "none"


def stop_and_wait(machine):
    machine.stop(wait=0.3)


def silence_link(machine):
    machine.silence(seconds=0.3, up=True, down=True, wait=0.3)


def scenario(happens):
    """A car without a cut-off drives, something happens, and the machine looks."""
    machine = PinMachine()
    machine.open(data=NoCutoff, boot="none", seed=1)
    try:
        happens(machine)
        machine.pin_follows_the_mode()
    finally:
        machine.world.nano.close()


@pytest.mark.slow
@pytest.mark.parametrize(("happens", "broken"), [
    (stop_and_wait, [(Planner, "set_demand", sticky), (Driver, "stop", send_without_stop)]),
    (silence_link, [(Driver, "overdue", False), (engine, "PWM_FRAME", 0.2)])])
def test_without_a_layer_the_machine_finds_it(monkeypatch, happens, broken):
    """Negative controls: outputs that a handler forgets; a step that waits for a late frame."""
    scenario(happens)
    for place, name, value in broken:
        monkeypatch.setattr(place, name, value)
    with pytest.raises(AssertionError):
        scenario(happens)
