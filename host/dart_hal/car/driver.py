"""What the pins may carry: the supervisor's state, and the actuator that follows it.

Events change only the state. The actuator reads the output of the state whenever it plans a
frame, so no event handler can forget to set the pins. Where a new state demands neutral, the
frame step writes it at once, without waiting for the next PWM frame.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from math import inf

from dart_hal.car.cutoff_test import CutoffTest
from dart_hal.car.facts import MAX_SWITCH_ON_TIME, STALE_LINK_TIME, Observer
from dart_hal.car.guarding import GuardPost, Hang
from dart_hal.car.rc import RcOverride
from dart_hal.car.receive import Receiver
from dart_hal.car.transmit import Transmitter
from dart_hal.core.config import CarFiles
from dart_hal.core.errors import BadCommand, BusError, NotArmed, UsageError
from dart_hal.core.process.suspend import SuspendDetector
from dart_hal.core.types import Applied, Doubt, Limit, State
from dart_hal.devices.actuation import (
    Actuator,
    ArmState,
    Caution,
    Event,
    Facts,
    Supervisor,
    list_cautions,
    not_armed_error,
    refusals,
)
from dart_hal.devices.actuation.arming import WAIVABLE
from dart_hal.devices.actuation.direction_watch import DirectionWatch
from dart_hal.devices.actuation.guard import BEAT_TIMEOUT
from dart_hal.devices.actuation.neutral_watch import NeutralWatch
from dart_hal.devices.actuation.supervisor import TRANSIENT_REFUSALS
from dart_hal.devices.actuation.trips import describe_trips, list_remedies
from dart_hal.devices.links.base import Backend

# Cause of a trip during ARMING, and the reason that is reported for the refusal.
REFUSAL_BY_CAUSE = {"LINK_STALE": "LINK_NOT_GOOD_500MS", "COMMAND_EXPIRED": "THROTTLE_NOT_NEUTRAL",
              "TIME_BACKWARD": "COMMAND_INVALID", "PCA_READBACK": "PCA_MODE",
              "GUARD_TRIPPED": "GUARD_SILENT", "SUSPENDED": "LINK_NOT_GOOD_500MS"}
# Modes that a run-stop ends.
LIVE_MODES = (ArmState.ARMING, ArmState.ARMED, ArmState.RAW)
# us: the neutral pulse that the Nano makes for a multiplexer.
NANO_NEUTRAL_US = 1500.0


class Driver:
    """Actuator and supervisor of one open car, called by the steps of the engine."""

    def __init__(self, files: CarFiles, backend: Backend, transmitter: Transmitter,
                 receiver: Receiver) -> None:
        self._files = files
        self._backend = backend
        self._transmitter = transmitter
        self._receiver = receiver
        self.supervisor = Supervisor(files.config.throttle.arm_neutral,
                                     files.config.steering.follow_disarmed)
        self.actuator = Actuator(files, backend.bus, backend.clock.sleep,
                                 demand=lambda: self.supervisor.output)
        self.observer = Observer(files, backend, receiver, self.actuator)
        self._neutral_watch = NeutralWatch()
        self._direction_watch = DirectionWatch()
        self.rc: RcOverride | None = None
        if files.config.rc is not None and files.config.rc.enabled:
            self.rc = RcOverride(files.config)
            receiver.handlers["RC"] = self.rc.add
            transmitter.request("RC")
        # In virtual time the world waits for its program, and nothing is missed.
        self.suspend = None if backend.virtual else SuspendDetector()
        self._guard: GuardPost | None = None
        self._beat_at = -inf
        self._hang: Hang | None = None
        # Whether the guard still writes the pins, as far as this program knows.
        self._hangs = False
        self._test: CutoffTest | None = None
        self._passed = False
        if not (backend.virtual or backend.simulated) and backend.bus is not None:
            self.observer.guard_age = lambda: self._guard.age if self._guard else None
        self.waived: tuple[str, ...] = ()
        # Who presses a run-stop now, and the reason.
        self.holders: dict[str, str] = {}
        # Of the last run-stop that ended a drive.
        self.stop_reason = ""
        # Run-stops and calls of stop() so far, and the reason of the last one.
        self.stops = 0
        self._last_stop = ""

    @property
    def applied(self) -> Applied:
        """Return what the ESC gets: the actuator's pulses, unless the Nano has cut them off."""
        return self.apply_cutoff(self.actuator.applied)

    def apply_cutoff(self, applied: Applied) -> Applied:
        """Return the pulses behind the hardware cut-off, by the newest State."""
        observer = self.observer
        if applied.throttle == 0.0 or observer.passing:
            return applied
        pulse = NANO_NEUTRAL_US if observer.cutoff == "mux" else 0.0
        return replace(applied, throttle=0.0, throttle_us=pulse,
                       limited=(*applied.limited, Limit.CUT_OFF.value))

    def correct_hang(self, state: State) -> State:
        """Return a State with what the pins carried at its time, if the guard wrote them."""
        applied = state.applied if self._hang is None else self._hang.correct(state.applied,
                                                                              state.t)
        return state if applied is state.applied else replace(state, applied=applied)

    @property
    def hang_found(self) -> bool:
        """Whether the guard has tripped, and no frame has dealt with it yet."""
        return self._guard is not None and self._guard.tripped and not self._hangs

    def _note_hang(self, now: float, guard: GuardPost) -> None:
        """Note from when until when the guard has written the pins."""
        if not guard.writes:
            self._hangs = False
        elif self._hangs and self._hang is not None:
            self._hang = replace(self._hang, end=now)
        else:
            self._hangs = True
            self._hang = Hang(self._beat_at + BEAT_TIMEOUT, now, self.applied,
                              self.actuator.neutral_us)

    @property
    def mode(self) -> ArmState:
        """Return the state of the supervisor."""
        return self.supervisor.state

    # -- life ------------------------------------------------------------------

    def open(self, now: float) -> None:
        """Bring the pins to rest, and start a guard on a real bus. Raises BusError.

        Servo and ESC get no pulse until the first State: before it, nothing shows whether a wrong
        neutral moves the car.
        """
        self.supervisor.event(Event.OPEN, now)
        self.supervisor.hold_off(now, True)
        try:
            self.actuator.open(keep_off=True)
            if self.actuator.found_pulses:
                self._neutral_watch.note_driven(self._backend.clock.now())
        except BusError:
            self.supervisor.event(Event.OPEN_FAILED, now)
            raise
        self.supervisor.event(Event.OPENED, now)
        bus = self._backend.url.options.get("i2c")
        if bus is not None and not self._backend.virtual and self._backend.bus is not None:
            self._guard = GuardPost(bus, self.actuator)

    def ready(self) -> None:
        """Wait for the guard, which must run before the car is armed; the Nano has answered."""
        if self._guard is not None:
            self._guard.ready()

    def close(self, now: float) -> None:
        """Write neutral for some frames, then end the pulses and the guard.

        If a write fails, the guard or the cut-off stops the car.
        """
        self.supervisor.event(Event.CLOSE, now)
        guard = self._guard
        try:
            self.actuator.close(self._beat_while_closing)
        except BusError:
            self.actuator.counters.bus_errors += 1
        finally:  # also after a second Ctrl-C
            if guard is not None:
                guard.close(at_neutral=self.actuator.applied.throttle_us == 0.0)

    def end_pulses(self) -> None:
        """End the pulses again: guard or link thread may have written once more after ``close``."""
        with suppress(BusError):
            self.actuator.end_pulses()

    def refuse_command(self, now: float) -> None:
        """Write neutral and disarm at once, because a command was not valid."""
        self.actuator.refuse()
        self._step(now, list(self.actuator.trips()), ())

    def _beat_while_closing(self, off: bool) -> None:
        """Send the guard a sign of life before a write of ``close``."""
        if self._guard is not None:
            self._guard.beat(at_neutral=True, off=off)

    def lost(self, now: float) -> None:
        """Write neutral at once after the link has been lost."""
        self.supervisor.step(now, causes=("LINK_STALE",), bus_ok=self.actuator.fault is None)
        self.actuator.stop()

    def set_run_stop(self, held: bool, now: float, source: str, reason: str = "") -> None:
        """Press the run-stop of ``source`` (neutral at once, no arming); False releases it."""
        if not held:
            self.holders.pop(source, None)
            return
        self.holders[source] = reason or f"the run-stop was pressed by: {source}"
        self._note_stop(self.holders[source])
        if self.mode in LIVE_MODES:
            self.stop_reason = self.holders[source]
            self._step(now, ["RUN_STOP"], ())
            self.actuator.stop()

    def _note_stop(self, reason: str) -> None:
        self.stops += 1
        self._last_stop = reason

    def refuse_if_stopped(self, stops: int) -> None:
        """Raise NotArmed if the car was stopped since there were ``stops`` stops.

        A call that waits before it arms the car must not arm it after a stop.
        """
        if self.stops != stops:
            raise NotArmed("the car was stopped while it armed", reasons=("RUN_STOP",),
                           found=self._last_stop, remedy="arm() again when the way is free")

    # -- what happens --------------------------------------------------------------

    def observe(self, state: State, now: float) -> None:
        """Take over a State that arrived at host time ``now`` [s]."""
        self.observer.observe(state, now)
        self._watch_neutral(state, now)
        self._watch_direction(state, now)
        health = state.health
        # An encoder that is lost caps the throttle; in RAW one that is doubted does.
        lost = health.speed_doubted if self.mode is ArmState.RAW else health.encoder_lost
        cap = self._files.config.limits.encoder_lost_throttle
        self.actuator.throttle_cap = cap if lost and not self.supervisor.lifted else None
        self._step_rc(now)

    @property
    def overridden(self) -> bool:
        """Return whether the driver of an RC transmitter drives in the place of the program."""
        return self.rc is not None and self.rc.active and self.mode is ArmState.ARMED

    def _step_rc(self, now: float) -> None:
        """Give the command of the RC driver to the actuator; stop at once without his signal."""
        if self.rc is None:
            return
        if self.rc.step(now, self._receiver.state_ck, armed=self.mode is ArmState.ARMED):
            if self.mode in LIVE_MODES:
                self._step(now, ["RC_LOST"], ())
            # A ramp of a stop ends as well.
            self.actuator.stop_at_once()
        self.actuator.set_override(self.rc.command(now) if self.overridden else None)

    def _watch_neutral(self, state: State, now: float) -> None:
        """Switch the pulses off if the car accelerates at neutral."""
        if self.actuator.moving:
            self._neutral_watch.note_driven(now)
        # While armed, noise of the encoder caps the throttle already and need not disarm as well.
        doubted = self.mode is ArmState.ARMED and Doubt.ENCODER_HIGH in state.health.doubts
        if self._neutral_watch.update(now, state.speed, self.actuator.at_neutral, doubted):
            self.supervisor.silence(now, "MOVES_AT_NEUTRAL")
            self._neutral_watch.restart()

    def _watch_direction(self, state: State, now: float) -> None:
        """Trip if the car speeds up against its throttle, with its wheels on the ground."""
        against = self._direction_watch.update(state.t, state.speed, state.applied.throttle)
        driven = self.mode in (ArmState.ARMED, ArmState.RAW) and not self.supervisor.lifted
        if against and driven and not state.health.speed_doubted:
            self._step(now, ["AGAINST_THROTTLE"], ())
            self.actuator.stop_at_once()

    def on_boot(self) -> None:
        """Disarm after a reboot of the Nano, and refuse until arm() is called again."""
        self.observer.rebooted |= self.mode is not ArmState.DISARMED
        self.supervisor.event(Event.REBOOT, self._backend.clock.now(), ("MCU_REBOOTED",))

    def _causes(self, now: float) -> list[str]:
        """Return the names of what trips the car now."""
        causes = list(self.actuator.trips())
        if self.observer.stale(now) and self.mode is not ArmState.OPENING:
            causes.append("LINK_STALE")
        if self._guard is not None:
            self._note_hang(now, self._guard)
            if self._guard.tripped:
                causes.append("GUARD_TRIPPED")
        if self.supervisor.lifted and self.observer.is_moving:
            causes.append("CAR_MOVES")
        if self._cut_off(now):
            causes.append("CUT_OFF")
        if self.suspend is not None and self.suspend.was_suspended():
            causes.append("SUSPENDED")
        if self.holders:
            causes.append("RUN_STOP")
        if self.rc is not None and self.rc.active and self.mode is ArmState.RAW:
            causes.append("RC_OVERRIDE")
        return causes

    def _cut_off(self, now: float) -> bool:
        """Return whether the Nano blocks the pulses while this program drives."""
        live = self.mode in (ArmState.ARMED, ArmState.RAW)
        self._passed = live and (self._passed or self.observer.passing)
        waited = now - self.supervisor.since > MAX_SWITCH_ON_TIME
        return live and not self.observer.passing and (self._passed or waited)

    # -- the PWM frame -------------------------------------------------------------

    @property
    def overdue(self) -> bool:
        """Return whether the state demands neutral and the pins do not carry it yet."""
        return self.actuator.violates_demand

    def frame(self, now: float) -> Applied:
        """Let the supervisor decide, then write one PWM frame.

        1. Advance the self-test of the cut-off.
        2. Update the supervisor with the causes of a trip and the reasons against arming.
        3. Write the pulses that the new state allows.
        4. Update the supervisor again if the write has failed.
        5. Send the guard its heartbeat; after a bus error none, so that the guard tries by its own
           descriptor of the bus. Once it tries, it ends the pulses when the state does.
        """
        self._step_test(now)
        silent = self._test is not None and self._test.silent
        self.supervisor.hold_off(now, silent or self.observer.blind(now))
        arming = self.mode is ArmState.ARMING
        refused = refusals(self.facts(now), self.waived) if arming else ()
        self._step(now, self._causes(now), refused)
        self.actuator.watched = self.observer.cutoff != "none"
        self.actuator.frame(now)
        if late := self.actuator.trips():
            self._step(now, list(late), ())
        demanded = self.supervisor.output.throttle
        if self._guard is not None and self.actuator.fault is None:
            self._guard.beat(at_neutral=demanded in ("neutral", "off"), off=demanded == "off")
            self._beat_at = now
        elif self._guard is not None and self._guard.tripped and demanded == "off":
            self._guard.beat(at_neutral=False, off=True)
        return self.applied

    def _step(self, now: float, causes: list[str], refused: tuple[str, ...]) -> None:
        self.supervisor.step(now, causes=causes, refused=refused,
                             bus_ok=self.actuator.fault is None)

    def _step_test(self, now: float) -> None:
        """Advance the self-test of the cut-off, which runs in ARMING only."""
        test = self._test
        if test is None:
            return
        if self.mode is not ArmState.ARMING or test.done:
            self._test = None
            return
        test.step(now)
        self.observer.tested = test.outcome

    def heartbeat(self, now: float) -> None:
        """Send the Nano the pulses and the mode."""
        hello = self._receiver.hello
        applied = self.actuator.applied
        direction = (applied.throttle > 0.0) - (applied.throttle < 0.0)
        mode = self._test.beat if self._test is not None else self.supervisor.beat
        self._transmitter.heartbeat(applied, mode, hello.boot_nonce if hello else 0, direction, now)

    # -- what is known -----------------------------------------------------------

    def facts(self, now: float) -> Facts:
        """Return everything that the arming checks need."""
        supervisor = self.supervisor
        refused = self.mode is ArmState.TRIPPED and "COMMAND_INVALID" in supervisor.causes
        facts = self.observer.facts(self.mode, now, supervisor.neutral_for(now),
                                    supervisor.silent)
        return replace(facts, command_ok=not refused, run_stop=bool(self.holders),
                       rc_lost=self.rc is not None and self.rc.lost)

    def is_settled(self, now: float) -> bool:
        """Return whether all conditions hold that are met by waiting after an opening or drive."""
        facts = self.facts(now)
        return (self.mode is not ArmState.TRIPPED
                and facts.link_good_for >= 0.1 and facts.clock_synced and not facts.imu_stale
                and not facts.wheel_moves and (facts.cutoff == "none" or bool(facts.beat_limit))
                and (facts.guard_age is None or facts.guard_age <= STALE_LINK_TIME))

    def cautions(self, now: float) -> tuple[Caution, ...]:
        """Return what does not prevent arming but should be known."""
        return list_cautions(self.facts(now))

    def arm_refusals(self, now: float) -> tuple[str, ...]:
        """Return what prevents arming and is not met by waiting."""
        return tuple(name for name in refusals(self.facts(now)) if name not in TRANSIENT_REFUSALS)

    def raw_refusals(self, now: float, *, lifted: bool = False) -> list[str]:
        """Return why RAW may not be entered now; ``lifted``: the wheels are off the ground.

        A lost encoder is no reason with lifted wheels: edges that are missing there were missed on
        the ground, a calibration may study an ESC at its brake, and no speed is controlled.
        """
        needless = ("NEUTRAL_TOO_SHORT", "CUTOFF_UNTESTED")
        facts = self.facts(now)
        facts = replace(facts, car_moves=lifted and self.observer.is_moving,
                        encoder_lost=facts.encoder_lost and not lifted)
        return [name for name in refusals(facts, WAIVABLE) if name not in needless]

    # -- what the user asks for ------------------------------------------------------

    def arm(self, now: float, waive: tuple[str, ...]) -> None:
        """Start arming. Raises NotArmed with every reason that is not met by waiting."""
        observer = self.observer
        observer.rebooted = False
        observer.tested = "pending"
        self.waived = waive
        self.supervisor.arm(now, refusals(self.facts(now), waive))
        self.resume_pulses(now)
        if observer.cutoff != "none" and self.mode is ArmState.ARMING:
            self._test = CutoffTest(observer, self._transmitter, self._receiver, now)

    def resume_pulses(self, now: float) -> bool:
        """Write neutral again after MOVES_AT_NEUTRAL, with the wheels at rest; return success."""
        state = self.observer.state
        if self.supervisor.silent and state is not None and state.speed == 0.0:
            self.supervisor.resume(now)
        return not self.supervisor.silent

    def refusal_error(self) -> NotArmed:
        """Return the error for an arming that ended in DISARMED."""
        names = [REFUSAL_BY_CAUSE.get(name, name) for name in self.supervisor.reasons]
        return not_armed_error(dict.fromkeys(names or ["LINK_NOT_GOOD_500MS"]))

    def open_raw(self, now: float, *, lifted: bool = False) -> None:
        """Enter RAW. Raises NotArmed unless link and bus are good, UsageError if armed."""
        if self.mode is ArmState.ARMED:
            raise UsageError("raw() of an armed car", found="the car is ARMED",
                             expected="a disarmed car", remedy="car.stop() before raw()")
        if held := self.raw_refusals(now, lifted=lifted):
            raise not_armed_error(held)
        if self.supervisor.silent:
            raise not_armed_error(("MOVES_AT_NEUTRAL",))
        self.supervisor.open_raw(now, lifted)
        if self.mode is not ArmState.RAW:
            raise not_armed_error(("PCA_ABSENT",))

    def raw_pulses(self, steering_us: float, throttle_us: float | None, valid_for: float,
                   now: float) -> Applied:
        """Write pulses in RAW. Raises BadCommand in any other state."""
        if self.mode is not ArmState.RAW:
            causes = self.supervisor.causes
            error = BadCommand("pulses() needs raw()", found=f"the car is {self.mode.value}"
                               + (f" since {describe_trips(causes)}" if causes else ""),
                               remedy="\n".join([*list_remedies(causes),
                                                 "with car.raw(): car.pulses(...)"]))
            error.causes = causes
            raise error
        self.supervisor.note_raw_call(now)
        return self.actuator.pulses(steering_us, throttle_us, now, valid_for)

    def event(self, event: Event, now: float) -> None:
        """Report an event to the supervisor; the pins follow with the frame step."""
        self.supervisor.event(event, now)

    def end_drive(self, now: float, reason: str) -> None:
        """Stop, and let later commands raise Disarmed with the reason until ``arm`` or ``stop``."""
        self._note_stop(reason)
        if self.mode not in LIVE_MODES:
            return
        self.stop_reason = reason
        armed = self.mode is ArmState.ARMED
        self.supervisor.event(Event.STOP, now)
        self.actuator.stop()
        if armed:
            self.supervisor.ended_by = ("RUN_STOP",)

    def stop(self, now: float, event: Event = Event.STOP) -> Applied:
        """Set the throttle to neutral now, keep the steering, and disarm the car."""
        if event is Event.STOP:
            self._note_stop("stop() was called")
        self.supervisor.event(event, now)
        return self.actuator.stop()
