"""The actuator: writes the planned pulses, as counts, to the pins of a PCA9685.

It has no thread and no clock: the owner calls ``frame(now)`` once per PWM frame (every second
STATE frame). For each plan it calls ``demand``, which returns what the supervisor's state allows;
by default neutral.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import cast

from dart_hal.core.config import CarFiles
from dart_hal.core.errors import BadCommand, BusError, PcaFault
from dart_hal.core.ports import Bus
from dart_hal.core.types import Applied, Limit
from dart_hal.devices.actuation.counters import ActuatorCounters
from dart_hal.devices.actuation.limits import (
    MAX_RAW_VALIDITY,
    RawPulses,
    SourceCommand,
    parse_command,
    parse_raw_pulses,
)
from dart_hal.devices.actuation.no_bus import NoBus
from dart_hal.devices.actuation.pca9685 import MAX_ATTEMPTS, NEUTRAL_FRAMES, Pca9685
from dart_hal.devices.actuation.plan import OFF_DEMAND, FramePlan, PinDemand, Planner
from dart_hal.devices.actuation.play import make_play
from dart_hal.devices.actuation.quantiser import NOMINAL_HZ, Quantiser
from dart_hal.devices.actuation.steering_map import steering_map

# s between two reads of the chip's settings and of the pulses of the last frame.
READ_BACK_INTERVAL = 1.0
# s between attempts to set up a lost PCA9685 again.
REOPEN_INTERVAL = 0.1
# us: longer than any servo or ESC pulse (2250 us), so that the capture can tell which it is.
WATCH_PULSE_US = 2300.0
# s by which time may go back through rounding.
TIME_ROUNDING = 1e-6
_NOT_ARMED = (Limit.NOT_ARMED.value,)
_NO_PULSES = (0, 0)


class Actuator:
    """The servo and the ESC of one car.

    ``bus`` None (a replay): commands are computed and reported as NOT_SENT. ``sleep``: in the
    backend's clock. ``demand``: returns the demand of the supervisor's state on the pins.
    ``gate``: called right before each write that moves the car; if it returns a cause, this write
    is neutral and a trip. ``fault``: the present bus error, None = the chip works.
    """

    def __init__(self, files: CarFiles, bus: Bus | None, sleep: Callable[[float], None], *,
                 demand: Callable[[], PinDemand] = PinDemand,
                 gate: Callable[[], str | None] | None = None) -> None:
        car = files.config
        clock = files.oscillator_hz
        table = files.calibration.steering.map if files.calibration else None
        self.car = car
        self.counters = ActuatorCounters()
        self.demand = demand
        self.gate = gate
        self.map = steering_map(car, table)
        self.neutral_us = files.neutral_us
        self.clock_calibrated = clock is not None
        self.pca = Pca9685(bus if bus is not None else cast(Bus, NoBus()),
                           address=car.pwm.address, frequency=car.pwm.frequency,
                           channels=(car.steering.channel, car.throttle.channel), sleep=sleep,
                           oscillator_hz=clock.value if clock else NOMINAL_HZ)
        self.fault: BusError | None = None
        self.watched = self._watching = False
        self._sending = bus is not None
        self._sleep = sleep
        self._opened = False
        self.moving = False
        """Whether the throttle pulse of the last frame was not neutral."""
        self.found_pulses = False
        """Whether ``open`` found a pulse of another program on the pins."""
        play = make_play(files, self.map)
        self._planner = Planner(car, self.map, self.neutral_us, self.pca.frame, play)
        # Without error feedback where the play is taken up: a change by one count and back would
        # move the wheels across the play.
        self._quantisers = tuple(Quantiser(self.pca.count_us, car.pwm.error_feedback and still)
                                 for still in (play is None, True))
        self._trips: list[str] = []
        self._expired: SourceCommand | RawPulses | None = None
        self._checked_at = self._tried_at = -math.inf
        self.applied = self._to_applied(self._rest_counts(0.0), _NOT_ARMED)

    # -- open and close --------------------------------------------------

    def open(self, *, keep_off: bool = False) -> Applied:
        """Bring the pins to neutral and centre from any state, for two frames.

        keep_off: channels without a pulse stay off. A pulse of another program is replaced by
        neutral for ``NEUTRAL_FRAMES``, so that the ESC stops the motor.
        Raises PcaMissing, PcaFault or BusError after three attempts.
        """
        try:
            for attempt in range(MAX_ATTEMPTS if self._sending else 0):
                try:
                    off = keep_off and self.pca.is_off()
                    self.found_pulses = not off
                    self._bring_up(off)
                    self._sleep((NEUTRAL_FRAMES if keep_off and not off else 2) * self.pca.frame)
                    break
                except BusError as error:
                    self.counters.bus_errors += 1
                    self.fault = error
                    if attempt == MAX_ATTEMPTS - 1:
                        raise
                    self._sleep(REOPEN_INTERVAL)
            self._opened = True
        finally:
            if not self._opened:  # the neutral that was written would stay
                with suppress(BusError):
                    self.end_pulses()
        return self.applied

    def close(self, beat: Callable[[bool], None] = lambda off: None) -> None:
        """Write neutral and the last steering for ``NEUTRAL_FRAMES``, then end all pulses.

        No pulse remains, since after closing no sensor shows whether the neutral drives the car.
        The chip is not put to sleep: it would keep the old pulse until it wakes.

        beat: called before each write, with whether the write ends the pulses.
        Raises BusError when a write fails.
        """
        if not self._opened:
            return
        self._opened = False
        self._planner.clear_requests()
        off = self._planner.demand.throttle == "off"
        counts = self._rest_counts(self._planner.angle)
        try:
            for _ in range(0 if off else NEUTRAL_FRAMES):
                beat(False)
                self._send(counts)
                self._sleep(self.pca.frame)
        finally:
            beat(True)
            self.end_pulses()
            self.applied = self._to_applied(_NO_PULSES, OFF_DEMAND.why)

    def end_pulses(self) -> None:
        """Switch off all channels of the PCA9685; another device gets no write. Raises BusError."""
        if self._sending and self.pca.recognised:
            self.pca.all_off()

    # -- commands --------------------------------------------------------

    def command(self, steering: float, throttle: float, valid_for: float, source: str,
                now: float, reasons: tuple[str, ...] = ()) -> Applied:
        """Store a source's request of steering [rad] and throttle [-1..1] for ``valid_for`` s.

        reasons: names of ``Limit`` for ``Applied.limited`` while the request acts.
        Returns the pulses of the next frame. Raises BadCommand for values that are not finite
        numbers and if time goes back; the throttle is then already at neutral.
        """
        self._planner.set_demand(self.demand())
        with self._trip_on_error():
            requested = parse_command(steering, throttle, valid_for, source, now, reasons)
            self._check_time(now)
            self._planner.arbiter.put(requested)
            plan = self._planner.plan(now, source)
        self.counters.overridden += any(name.startswith("OVERRIDDEN") for name in plan.limited)
        return self._to_applied(self._peek(plan), plan.limited, plan.moving)

    def pulses(self, steering_us: float, throttle_us: float | None, now: float,
               valid_for: float = MAX_RAW_VALIDITY) -> Applied:
        """Store pulses for calibration, valid for at most 0.2 s; they act while the demand is raw.

        throttle_us None: no pulse for the ESC, only with the wheels off the ground.
        Raises BadCommand outside 1000 to 2000 us; the throttle is then already at neutral.
        """
        self._planner.set_demand(self.demand())
        with self._trip_on_error():
            self._check_time(now)
            self._planner.raw = parse_raw_pulses(steering_us, throttle_us, self.neutral_us,
                                           self.demand().full_range, now, valid_for)
            plan = self._planner.plan(now, "raw")
        return self._to_applied(self._peek(plan), plan.limited, plan.moving)

    @contextmanager
    def _trip_on_error(self) -> Iterator[None]:
        """Write neutral before an error of the block is raised."""
        try:
            yield
        except BaseException:
            self.refuse()
            raise

    def _check_time(self, now: float) -> None:
        """Raise BadCommand if time has gone back."""
        if now < self._planner.last - TIME_ROUNDING:
            raise BadCommand("time went back", found=f"{now} s",
                             expected=f"{self._planner.last} s or later")

    def requested_command(self, now: float) -> SourceCommand | None:
        """Return the valid command of highest priority at ``now``, armed or not; None = none."""
        return self._planner.arbiter.winner(now)

    @property
    def throttle_cap(self) -> float | None:
        """Largest |throttle| while the encoder is lost; None = the car's limits."""
        return self._planner.throttle_cap

    @throttle_cap.setter
    def throttle_cap(self, cap: float | None) -> None:
        self._planner.throttle_cap = cap

    def set_battery_cap(self, cap: float | None) -> None:
        """Limit forward throttle from the next frame on: the battery is low; None = no limit."""
        self._planner.battery_cap = cap

    def set_obstacle(self, obstacle: bool) -> None:
        """Withhold forward throttle from the next frame on, or pass it again."""
        self._planner.obstacle = obstacle

    def set_override(self, command: SourceCommand | None) -> None:
        """Set the command that precedes those of all sources; None: the override has ended.

        Then requests made during it are dropped: neutral until a source sends the next one.
        """
        if command is None and self._planner.override is not None:
            self._planner.clear_requests()
        self._planner.override = command

    def stop_at_once(self) -> Applied:
        """Write neutral throttle without a ramp, and the last steering. Raises nothing."""
        self._planner.throttle = 0.0
        return self.stop()

    @property
    def violates_demand(self) -> bool:
        """Whether the last frame may move the car although the state no longer allows it."""
        written = self._planner.demand
        demanded = self.demand()
        goes_off = demanded.throttle == "off" and written.throttle != "off"
        return goes_off or (written.live and not demanded.live)

    @property
    def at_neutral(self) -> bool:
        """Whether the last pulse written is the neutral pulse of the car's files."""
        return self._opened and not self.moving and self.applied.throttle_us > 0.0

    def stop(self) -> Applied:
        """Write neutral throttle, by the ramp of car.toml if it has one, and the last steering.

        Raises nothing: a bus error is kept in ``fault`` and reported as a trip.
        """
        self._planner.set_demand(self.demand())
        self._planner.clear_requests()
        return self._put(self._planner.plan_stop(_NOT_ARMED))

    def neutral(self) -> Applied:
        """Write neutral throttle and centred steering. Raises nothing, as ``stop``."""
        self._planner.clear_requests()
        return self._put(self._planner.plan_neutral(0.0, _NOT_ARMED))

    def _watch_pulse(self) -> None:
        """Start or end the pulse of the spare channel while there is a cut-off. Raises BusError.

        It rises with the ESC's pulse and is longer than any of them. The Nano reads it, so that it
        switches only between two pulses.
        """
        if self.watched != self._watching:
            self.clock_pulse(WATCH_PULSE_US if self.watched else None)
            self._watching = self.watched

    def renew_watch_pulse(self) -> None:
        """Write the pulse of the spare channel again with the next frame: the guard ended it."""
        self._watching = False

    def clock_pulse(self, pulse_us: float | None) -> None:
        """Write a pulse to the spare clock channel, None = off. Raises BusError."""
        counts = None if pulse_us is None else Quantiser(self.pca.count_us).rest(pulse_us)
        if self._sending:
            self.pca.write_channel(self.car.pwm.clock_channel, counts)

    # -- one frame -------------------------------------------------------

    def frame(self, now: float) -> Applied:
        """Process one PWM frame. Bus errors are kept in ``fault`` and reported by ``trips()``.

        1. Drop expired commands and plan the pulses.
        2. After a bus error, write neutral, and set the chip up again, at most each 100 ms.
        3. Read the chip's settings back, once a second.
        4. Quantise and write both channels, also if nothing has changed.
        """
        if not math.isfinite(now) or now < self._planner.last - TIME_ROUNDING:
            self._trip("TIME_BACKWARD")
            return self.stop()
        self.counters.frames += 1
        self._planner.set_demand(self.demand())
        plan = self._planner.plan(now)
        self._note_expiry(now)
        self._planner.last = now
        if not self._opened:
            return self.applied
        if self.fault is not None:
            self._write_rest()
            self._revive(now)
            return self.applied
        if self._sending and now - self._checked_at >= READ_BACK_INTERVAL \
                and not self._read_back(now):
            return self.applied
        return self._put(plan)

    def trips(self) -> tuple[str, ...]:
        """Return the causes that must disarm the car since the last call, each once.

        COMMAND_INVALID, COMMAND_EXPIRED, TIME_BACKWARD, PCA_WRITE_FAILED, PCA_READBACK, and those
        of ``gate``.
        """
        names = tuple(dict.fromkeys(self._trips))
        self._trips = []
        return names

    # -- counts and writes -------------------------------------------------

    def _put(self, plan: FramePlan) -> Applied:
        """Write the pulses of a plan if state and ``gate`` allow it; return what was written."""
        if not self._opened or self._planner.demand.throttle == "untouched":
            return self.applied
        cause = self.gate() if self.gate is not None and plan.moving else None
        if cause is not None:
            self._trip(cause)
            plan = self._planner.plan_neutral(self._planner.angle, (*plan.limited, *_NOT_ARMED))
        off = self._planner.demand.throttle == "off"
        counts = _NO_PULSES if off else self._step(plan)
        try:
            self._send(counts)
            self._watch_pulse()
        except BusError as error:
            self._note_bus_error(error, "PCA_WRITE_FAILED")
            return self.applied
        if not off:
            self._planner.note_written(plan, counts[0] * self.pca.count_us)
        self.moving = plan.moving
        why = (*OFF_DEMAND.why, *plan.limited) if off else plan.limited
        self.applied = self._to_applied(counts, why, plan.moving)
        return self.applied

    def _peek(self, plan: FramePlan) -> tuple[int, int]:
        """Return the counts that the next frame would write."""
        steering, throttle = self._quantisers
        esc = throttle.peek if plan.moving else throttle.rest
        return steering.peek(plan.steering_us), esc(plan.throttle_us) if plan.throttle_us else 0

    def _step(self, plan: FramePlan) -> tuple[int, int]:
        """Return the counts of this frame with error feedback; those of neutral are constant."""
        steering, throttle = self._quantisers
        esc = throttle.step if plan.moving else throttle.settle
        return steering.step(plan.steering_us), esc(plan.throttle_us) if plan.throttle_us else 0

    def _rest_counts(self, angle: float) -> tuple[int, int]:
        """Return the counts of neutral, rounded down so as not to exceed it, and of ``angle``."""
        plan = self._planner.plan_neutral(angle, _NOT_ARMED)
        steering, throttle = self._quantisers
        throttle.error = 0.0
        return steering.settle(plan.steering_us), int(plan.throttle_us / self.pca.count_us)

    def _send(self, counts: tuple[int, int]) -> None:
        if self._sending:
            self.pca.write(counts)
            self.counters.writes += 1
            self.counters.retries = self.pca.retries

    def _to_applied(self, counts: tuple[int, int], why: tuple[str, ...],
                    moving: bool = False) -> Applied:
        """Convert counts to angle, throttle and pulses; neutral is 0.0, though up to 2.4 us off."""
        steering_us, throttle_us = (n * self.pca.count_us for n in counts)
        fraction = (throttle_us - self.neutral_us) / self.car.throttle.span_us
        throttle = fraction if moving and counts[1] else 0.0
        always = [] if self.map.calibrated else [Limit.UNCALIBRATED.value]
        always += [] if self._sending else [Limit.NOT_SENT.value]
        angle = self._planner.wheel_angle(steering_us) if counts[0] else self._planner.angle
        return Applied(angle, throttle, steering_us, throttle_us,
                       tuple(dict.fromkeys((*why, *always))))

    # -- faults ------------------------------------------------------------

    def _bring_up(self, off: bool) -> None:
        """Open the chip at neutral and centre; ``off``: without pulses."""
        rest = self._rest_counts(0.0)
        counts = _NO_PULSES if off else rest
        self.pca.open(counts)
        self.fault = None
        self._watching = self.moving = False
        self._planner.angle = self.map.angle(rest[0] * self.pca.count_us)
        self._planner.throttle = 0.0
        self.applied = self._to_applied(counts, OFF_DEMAND.why if off else _NOT_ARMED)

    def _read_back(self, now: float) -> bool:
        """Read the chip back before the write of a frame; return whether it is as expected.

        After the write, a pulse of another program would be overwritten and not noticed. While the
        guard has tripped, the pulse is the guard's neutral and is not compared.
        """
        self._checked_at = now
        self.counters.read_backs += 1
        guarded = self.gate is not None and self.gate() is not None
        try:
            self.pca.check(pulses=not guarded)
        except PcaFault as error:
            self._note_bus_error(error, "PCA_READBACK")
            self._revive(now)
        except BusError as error:
            self._note_bus_error(error, "PCA_WRITE_FAILED")
            self._write_rest()
        else:
            self.renew_watch_pulse()
            return True
        return False

    def _write_rest(self) -> None:
        """Write neutral by one plain write; a bus that often fails may never set the chip up.

        After a change of its settings the counts may have another length: then no pulse.
        """
        off = self._planner.demand.throttle == "off" or isinstance(self.fault, PcaFault)
        counts = _NO_PULSES if off else self._rest_counts(self._planner.angle)
        try:
            if off:
                self.end_pulses()
            else:
                self._send(counts)
        except BusError:
            self.counters.bus_errors += 1
            return
        self.moving = False
        self._planner.throttle = 0.0
        self.applied = self._to_applied(counts, OFF_DEMAND.why if off else _NOT_ARMED)

    def _revive(self, now: float) -> None:
        """Open the chip again at neutral, at most each 100 ms."""
        if now - self._tried_at < REOPEN_INTERVAL:
            return
        self._tried_at = now
        try:
            self._bring_up(self.demand().throttle == "off")
        except BusError as error:
            if not isinstance(self.fault, PcaFault):
                self.fault = error
            self.counters.bus_errors += 1
            return
        self.counters.reinits += 1
        self._checked_at = now

    def _note_bus_error(self, error: BusError, name: str) -> None:
        """Keep a bus error as ``fault`` and trip with the cause ``name``."""
        self.fault = error
        self.counters.bus_errors += 1
        self._checked_at = -math.inf                    # read back as soon as the chip answers
        self._trip(name)

    def _note_expiry(self, now: float) -> None:
        """Count an expired command, once; trip if its throttle was not neutral."""
        # A program that stops sending at neutral has stopped the car; with throttle, it hangs.
        expired = self._planner.expired_request(now)
        if expired is None or expired is self._expired:
            return
        self._expired = expired
        self.counters.expired += 1
        if expired.throttle != 0.0:
            self._trips.append("COMMAND_EXPIRED")

    def refuse(self) -> None:
        """Trip because of an invalid command, and write neutral at once."""
        self.counters.bad_commands += 1
        self._trip("COMMAND_INVALID")
        self.stop()

    def _trip(self, name: str) -> None:
        """Report a trip; neutral until the supervisor has changed its demand."""
        self._trips.append(name)
        self._planner.latch()
