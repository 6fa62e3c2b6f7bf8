"""The host's supervisor: the state machine of arming, with time as an argument.

It reads no clock, accesses no bus and knows no car. The owner passes in the causes of a trip and
the arming refusals of this moment, and gives ``output`` to the actuator and ``beat`` to the Nano.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection

from dart_hal.core.timing import PWM_FRAME
from dart_hal.devices.actuation.arming import MIN_GOOD_TIME, not_armed_error
from dart_hal.devices.actuation.guard import BEAT_TIMEOUT
from dart_hal.devices.actuation.pca9685 import NEUTRAL_FRAMES
from dart_hal.devices.actuation.plan import OFF_DEMAND, PinDemand
from dart_hal.devices.actuation.states import ENTRY, TABLE, ArmState, Event

# s for which the cause of a trip must be absent before TRIPPED ends.
CLEAR_TIME = 0.5
# So many trips within TRIP_WINDOW [s] lock the car.
TRIPS_TO_LOCK = 3
TRIP_WINDOW = 60.0
# s without a call of ``pulses()`` after which RAW ends.
RAW_IDLE_TIMEOUT = 10.0
# s for which LOCKED holds the steering angle before it centres the steering.
STEERING_HOLD_TIME = 1.0
# s in FAULT after which the pulses end, when the guard ends them too. Its last heartbeat came one
# frame before FAULT. It waits BEAT_TIMEOUT, then writes NEUTRAL_FRAMES of neutral.
FAULT_NEUTRAL_TIME = BEAT_TIMEOUT + (NEUTRAL_FRAMES - 1) * PWM_FRAME
# s, in addition to the ESC's neutral time, that ARMING waits for transient refusals to end.
ARMING_MARGIN = 1.5
# Refusals that end without the user. IMU_STALE is one of them: the offsets of a calibrated BNO055
# at rest are read out once, which takes 70 ms without samples.
TRANSIENT_REFUSALS = frozenset({"NEUTRAL_TOO_SHORT", "LINK_NOT_GOOD_500MS", "CLOCK_NOT_SYNCED",
                                "IMU_STALE", "IMU_DOUBTED", "CUTOFF_UNTESTED",
                                "BEAT_LIMIT_UNKNOWN"})
# Name of a trip in ``Applied.limited``, in addition to NOT_ARMED.
LIMIT_BY_CAUSE = {"LINK_STALE": "STALE_LINK", "COMMAND_EXPIRED": "EXPIRED",
                  "RC_LOST": "RC_LOST"}


def _list_reasons(lasting: Collection[str], refused: Collection[str]) -> tuple[str, ...]:
    """Return the reasons to report: the lasting ones, and a stale IMU although it may recover."""
    return (*lasting, *(n for n in refused if n == "IMU_STALE" and n not in lasting))


class Supervisor:
    """The arming state of one car.

    ``causes``: of the last trip; ``reasons``: why the car did not arm; ``ended_by``: what disarmed
    an armed car, until it is armed or stopped again; ``log``: (time, event, new state, causes) of
    every change, for the recording.

    arm_neutral [s]: time at neutral that the ESC needs before ARMED; follow_disarmed: commands
    move the steering in DISARMED and ARMING too.
    """

    def __init__(self, arm_neutral: float = 2.0, follow_disarmed: bool = False) -> None:
        self.state = ArmState.CLOSED
        self.since = -math.inf
        self.causes: tuple[str, ...] = ()
        self.reasons: tuple[str, ...] = ()
        self.ended_by: tuple[str, ...] = ()
        self.log: deque[tuple[float, Event, ArmState, tuple[str, ...]]] = deque(maxlen=1000)
        self.lifted = False
        """RAW with the wheels off the ground; set by ``open_raw``."""
        self.silent = False
        """No pulse until ``resume``: the car moved at neutral."""
        self._held_off = False
        self._locked = False
        self._arm_neutral = arm_neutral
        self._follow = follow_disarmed
        self._trips: deque[float] = deque(maxlen=TRIPS_TO_LOCK)
        self._neutral_since: float | None = None
        self._good_since: float | None = None
        self._raw_call = -math.inf
        self._now = -math.inf

    # -- outputs of the state ------------------------------------------------

    @property
    def output(self) -> PinDemand:
        """The demand on the pins now."""
        entry = ENTRY[self.state].output
        faulty = self.state is ArmState.FAULT and self._now - self.since >= FAULT_NEUTRAL_TIME
        if (self.silent or self._held_off or faulty) and entry.throttle != "untouched":
            return OFF_DEMAND
        steering = entry.steering
        if self.state is ArmState.LOCKED and self._now - self.since >= STEERING_HOLD_TIME:
            steering = "centre"
        if self._follow and self.state in (ArmState.DISARMED, ArmState.ARMING):
            steering = "command"
        why = entry.why
        if self.state in (ArmState.TRIPPED, ArmState.LOCKED):
            why = (*(LIMIT_BY_CAUSE[c] for c in self.causes if c in LIMIT_BY_CAUSE), *why)
        return PinDemand(entry.throttle, steering, why,
                      full_range=self.lifted and self.state is ArmState.RAW)

    @property
    def beat(self) -> str:
        """Mode of the heartbeat: a name of ``wire.messages.BEAT_MODES``."""
        return ENTRY[self.state].beat

    def silence(self, now: float, cause: str) -> None:
        """Trip, and end the pulses of all channels until ``resume``: neutral moves the car.

        It counts as a trip in every state, so that a program that arms again and again is locked.
        """
        self.silent = True
        self._neutral_since = None
        self._note_trip(now)
        self.event(Event.THIRD_TRIP if self._locked else Event.TRIP, now, (cause,))
        self.causes = (cause,)

    def resume(self, now: float) -> None:
        """Return to neutral pulses after ``silence``."""
        self.silent = False
        self._restart_neutral(now)

    def hold_off(self, now: float, off: bool) -> None:
        """Set whether servo and ESC get no pulse: the motion is unknown, or /OE is tested."""
        if off != self._held_off:
            self._held_off = off
            self._restart_neutral(now)

    def _restart_neutral(self, now: float) -> None:
        self._neutral_since = now if self.output.throttle == "neutral" else None

    def neutral_for(self, now: float) -> float:
        """Return the time [s] for which the throttle has been neutral without a break."""
        return 0.0 if self._neutral_since is None else now - self._neutral_since

    # -- events --------------------------------------------------------------

    def event(self, event: Event, now: float, why: Collection[str] = ()) -> ArmState:
        """Process an event and return the next state; why: causes of it."""
        self._now = max(self._now, now)
        if (event in (Event.TRIP, Event.BUS_LOST) and self.state is ArmState.ARMED
                and not self.silent):
            event = self._count_trip(event, now)
        if event in (Event.ARM, Event.STOP):
            self.ended_by = ()
        if event is Event.UNLOCK:
            self._locked = False
            self._trips.clear()
        if event is Event.OPENED and self._locked:
            event = Event.OPENED_LOCKED
        target = TABLE[self.state][event]
        if target is not self.state:
            self._enter(target, event, now, tuple(why))
        return self.state

    def arm(self, now: float, refused: Collection[str] = ()) -> None:
        """Start arming. Raises NotArmed with every reason that does not end by waiting."""
        lasting = [name for name in refused if name not in TRANSIENT_REFUSALS]
        # The state itself can be a reason, if no refusal names it already.
        if self.state is ArmState.LOCKED and "LATCHED" not in lasting:
            lasting.append("LATCHED")
        if self.state is ArmState.RAW and "RAW_MODE_OPEN" not in lasting:
            lasting.append("RAW_MODE_OPEN")
        if self.state in (ArmState.OPENING, ArmState.CLOSED, ArmState.FAULT) and not lasting:
            lasting.append("PCA_ABSENT")
        if self.state is ArmState.TRIPPED and not lasting:
            lasting += [c for c in self.causes if c in ("COMMAND_INVALID", "PCA_WRITE_FAILED")]
            lasting = lasting or ["LINK_NOT_GOOD_500MS"]
        if lasting:
            self.reasons = _list_reasons(lasting, refused)
            raise not_armed_error(self.reasons)
        self.event(Event.ARM, now)

    def open_raw(self, now: float, lifted: bool) -> None:
        """Enter RAW from DISARMED; ``lifted``: the wheels are off the ground."""
        self.lifted = lifted
        self.event(Event.RAW_OPEN, now)

    def note_raw_call(self, now: float) -> None:
        """Note a call of ``pulses()``: RAW stays open for another 10 s."""
        self._raw_call = now

    def step(self, now: float, *, causes: Collection[str] = (), refused: Collection[str] = (),
             bus_ok: bool = True) -> ArmState:
        """Advance to ``now`` [s] and return the state; call it once per STATE frame.

        ``causes``: trips that are active or happened since the last call;
        ``refused``: arming refusals that are active;
        ``bus_ok``: the PCA9685 answers and keeps its settings.
        """
        self._now = max(self._now, now)
        # Order of precedence: the bus, the end of FAULT, trips, then states that time ends.
        if not bus_ok:
            return self.event(Event.BUS_LOST, now, causes or ("PCA_WRITE_FAILED",))
        if self.state is ArmState.FAULT:
            self.event(Event.BUS_BACK, now)
            return self.event(Event.OPENED, now)
        if causes and self.state is not ArmState.TRIPPED:
            return self.event(Event.TRIP, now, causes)
        if self.state is ArmState.ARMING:
            self._step_arming(now, refused)
        elif self.state is ArmState.TRIPPED and self._has_lasted(not causes, now, CLEAR_TIME):
            self.event(Event.CLEARED, now)
        elif (self.state is ArmState.RAW
                and now - max(self._raw_call, self.since) > RAW_IDLE_TIMEOUT):
            self.event(Event.RAW_TIMEOUT, now)
        return self.state

    # -- transitions -----------------------------------------------------------

    def _step_arming(self, now: float, refused: Collection[str]) -> None:
        """Leave ARMING when the checks have passed for long enough, or a refusal lasts."""
        neutral = self.neutral_for(now) >= self._arm_neutral - 1e-9
        timed_out = now - self.since > self._arm_neutral + MIN_GOOD_TIME + ARMING_MARGIN
        lasting = [name for name in refused if timed_out or name not in TRANSIENT_REFUSALS]
        if lasting:
            self.event(Event.REFUSED, now, _list_reasons(lasting, refused))
        elif self._has_lasted(not refused, now, MIN_GOOD_TIME) and neutral:
            self.event(Event.CHECKED, now)

    def _has_lasted(self, good: bool, now: float, seconds: float) -> bool:
        """Return whether ``good`` has been true at every step for ``seconds``."""
        if not good:
            self._good_since = None
            return False
        if self._good_since is None:
            self._good_since = now
        return now - self._good_since >= seconds - 1e-9

    def _note_trip(self, now: float) -> bool:
        """Count a trip; return whether it is the third within a minute, which locks the car."""
        self._trips.append(now)
        third = len(self._trips) == TRIPS_TO_LOCK and now - self._trips[0] <= TRIP_WINDOW
        self._locked = self._locked or third
        return third

    def _count_trip(self, event: Event, now: float) -> Event:
        """Count the trip that an event is; return THIRD_TRIP for the third one."""
        third = self._note_trip(now)
        # A lost bus takes precedence, since the pulses at the pins are unknown. LOCKED follows it.
        return Event.THIRD_TRIP if third and event is Event.TRIP else event

    def _enter(self, target: ArmState, event: Event, now: float, why: tuple[str, ...]) -> None:
        """Change the state, and note the causes, the reasons and the start of neutral."""
        if event in (Event.TRIP, Event.THIRD_TRIP, Event.BUS_LOST) or (
                why and self.state is ArmState.RAW):
            self.causes = why
        if self.state is ArmState.ARMED and event not in (Event.STOP, Event.CLOSE):
            self.ended_by = why
        if self.state is ArmState.ARMING:
            self.reasons = (*why, *(["LATCHED"] if target is ArmState.LOCKED else [])) \
                if target in (ArmState.DISARMED, ArmState.LOCKED) else ()
        if target is not ArmState.RAW:
            self.lifted = False
        self.state = target
        self.since = now
        self._good_since = None
        if self.output.throttle != "neutral":
            self._neutral_since = None
        elif self._neutral_since is None:
            self._neutral_since = now
        self.log.append((now, event, target, why))
