"""The host's supervisor: walks the table of ``states``, with time as an argument.

It reads no clock, touches no bus and knows no car: the owner passes in what
holds now, and gives ``output`` to the actuator and ``beat`` to the Nano.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection

from dart_hal.devices.actuation.arming import GOOD_FOR, not_armed
from dart_hal.devices.actuation.plan import OFF, Output
from dart_hal.devices.actuation.states import ENTRY, TABLE, ArmState, Event

CLEAR_FOR = 0.5
"""s for which the cause must be gone before TRIPPED ends."""
TRIPS_TO_LOCK, TRIP_WINDOW = 3, 60.0
RAW_IDLE = 10.0
"""s without a call after which RAW ends."""
HELD_FOR = 1.0
"""s for which LOCKED holds the steering before it centres it."""
PATIENCE = 1.5
"""s beyond the ESC's neutral time that ARMING waits for what comes by waiting."""

COMES_BY_WAITING = frozenset({"NEUTRAL_TOO_SHORT", "LINK_NOT_GOOD_500MS", "CLOCK_NOT_SYNCED",
                              "IMU_STALE", "IMU_DOUBTED", "CUTOFF_UNTESTED",
                              "BEAT_LIMIT_UNKNOWN"})
"""IMU_STALE too: a calibrated BNO055 at rest has its offsets read out once, 70 ms."""
LIMIT_OF = {"LINK_STALE": "STALE_LINK", "COMMAND_EXPIRED": "EXPIRED"}
"""How a trip reads in ``Applied.limited``, beside NOT_ARMED."""


def _told(lasting: Collection[str], refused: Collection[str]) -> tuple[str, ...]:
    """Reasons as the user is told them: a stale IMU may heal, but not unsaid."""
    return (*lasting, *(n for n in refused if n == "IMU_STALE" and n not in lasting))


class Supervisor:
    """One car's state. ``causes``: what tripped it last; ``reasons``: why it did not arm.

    ``ended_by``: what disarmed an armed car, until it is armed or stopped again.

    ``log``: (time, event, state entered, why) of every change, for the recording.
    """

    def __init__(self, arm_neutral: float = 2.0, follow_disarmed: bool = False) -> None:
        self.state, self.since = ArmState.CLOSED, -math.inf
        self.causes: tuple[str, ...] = ()
        self.reasons: tuple[str, ...] = ()
        self.ended_by: tuple[str, ...] = ()
        self.log: deque[tuple[float, Event, ArmState, tuple[str, ...]]] = deque(maxlen=1000)
        self.lifted = False
        """RAW with the wheels off the ground; asked for at its opening."""
        self.silent = False
        """No pulse until ``arm`` or ``raw``: the car moved at neutral."""
        self._blind = False
        self._locked = False
        self._arm_neutral, self._follow = arm_neutral, follow_disarmed
        self._trips: deque[float] = deque(maxlen=TRIPS_TO_LOCK)
        self._neutral_since: float | None = None
        self._good_since: float | None = None
        self._raw_call = -math.inf
        self._now = -math.inf

    # -- what the state means ----------------------------------------------

    @property
    def output(self) -> Output:
        """What the pins may carry now."""
        entry = ENTRY[self.state].output
        if (self.silent or self._blind) and entry.throttle != "untouched":
            return OFF
        steering = entry.steering
        if self.state is ArmState.LOCKED and self._now - self.since >= HELD_FOR:
            steering = "centre"
        if self._follow and self.state in (ArmState.DISARMED, ArmState.ARMING):
            steering = "command"
        why = entry.why
        if self.state in (ArmState.TRIPPED, ArmState.LOCKED):
            why = (*(LIMIT_OF[c] for c in self.causes if c in LIMIT_OF), *why)
        return Output(entry.throttle, steering, why,
                      full_range=self.lifted and self.state is ArmState.RAW)

    @property
    def beat(self) -> str:
        """Mode of the heartbeat: a name of ``wire.messages.BEAT_MODES``."""
        return ENTRY[self.state].beat

    def silence(self, now: float, cause: str) -> None:
        """Trip, and no pulse on any channel until ``resume``: neutral moves the car.

        Counts as a trip in every state, so that a program that arms again and again is locked.
        """
        self.silent = True
        self._neutral_since = None
        self._note_trip(now)
        self.event(Event.THIRD_TRIP if self._locked else Event.TRIP, now, (cause,))
        self.causes = (cause,)

    def resume(self, now: float) -> None:
        """Neutral instead of no pulse, from now on."""
        self.silent = False
        self._restart_neutral(now)

    def see(self, now: float, blind: bool) -> None:
        """``blind``: no State shows whether the car moves; then servo and ESC get no pulse."""
        if blind != self._blind:
            self._blind = blind
            self._restart_neutral(now)

    def _restart_neutral(self, now: float) -> None:
        self._neutral_since = now if self.output.throttle == "neutral" else None

    def neutral_for(self, now: float) -> float:
        """s for which the throttle has been neutral without a break."""
        return 0.0 if self._neutral_since is None else now - self._neutral_since

    # -- what happens --------------------------------------------------------

    def event(self, event: Event, now: float, why: Collection[str] = ()) -> ArmState:
        """Something happened; returns the state after it."""
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
        to = TABLE[self.state][event]
        if to is not self.state:
            self._enter(to, event, now, tuple(why))
        return self.state

    def arm(self, now: float, refused: Collection[str] = ()) -> None:
        """Start arming. Raises NotArmed with every reason that waiting will not cure."""
        lasting = [name for name in refused if name not in COMES_BY_WAITING]
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
            self.reasons = _told(lasting, refused)
            raise not_armed(self.reasons)
        self.event(Event.ARM, now)

    def open_raw(self, now: float, lifted: bool) -> None:
        """Enter RAW from DISARMED; ``lifted``: the wheels are off the ground."""
        self.lifted = lifted
        self.event(Event.RAW_OPEN, now)

    def raw_called(self, now: float) -> None:
        """``pulses()`` was called: RAW stays open for another 10 s."""
        self._raw_call = now

    def step(self, now: float, *, causes: Collection[str] = (), refused: Collection[str] = (),
             bus_ok: bool = True) -> ArmState:
        """Let time pass to ``now``; call it once per STATE frame.

        ``causes``: trips that hold now or happened since the last call;
        ``refused``: arming refusals that hold now; ``bus_ok``: the PCA9685 obeys.
        """
        self._now = max(self._now, now)
        if not bus_ok:
            return self.event(Event.BUS_LOST, now, causes or ("PCA_WRITE_FAILED",))
        if self.state is ArmState.FAULT:
            self.event(Event.BUS_BACK, now)
            return self.event(Event.OPENED, now)
        if causes and self.state is not ArmState.TRIPPED:
            return self.event(Event.TRIP, now, causes)
        if self.state is ArmState.ARMING:
            self._arming(now, refused)
        elif self.state is ArmState.TRIPPED and self._held(not causes, now, CLEAR_FOR):
            self.event(Event.CLEARED, now)
        elif self.state is ArmState.RAW and now - max(self._raw_call, self.since) > RAW_IDLE:
            self.event(Event.RAW_TIMEOUT, now)
        return self.state

    # -- inside ---------------------------------------------------------------

    def _arming(self, now: float, refused: Collection[str]) -> None:
        neutral = self.neutral_for(now) >= self._arm_neutral - 1e-9
        late = now - self.since > self._arm_neutral + GOOD_FOR + PATIENCE
        lasting = [name for name in refused if late or name not in COMES_BY_WAITING]
        if lasting:
            self.event(Event.REFUSED, now, _told(lasting, refused))
        elif self._held(not refused, now, GOOD_FOR) and neutral:
            self.event(Event.CHECKED, now)

    def _held(self, good: bool, now: float, seconds: float) -> bool:
        """Whether ``good`` has been true at every step for ``seconds``."""
        if not good:
            self._good_since = None
            return False
        if self._good_since is None:
            self._good_since = now
        return now - self._good_since >= seconds - 1e-9

    def _note_trip(self, now: float) -> bool:
        """Count a trip; whether it is the third within a minute, which locks."""
        self._trips.append(now)
        third = len(self._trips) == TRIPS_TO_LOCK and now - self._trips[0] <= TRIP_WINDOW
        self._locked = self._locked or third
        return third

    def _count_trip(self, event: Event, now: float) -> Event:
        third = self._note_trip(now)
        # A lost bus is said first: nobody knows what the pins carry. LOCKED comes after it.
        return Event.THIRD_TRIP if third and event is Event.TRIP else event

    def _enter(self, to: ArmState, event: Event, now: float, why: tuple[str, ...]) -> None:
        if event in (Event.TRIP, Event.THIRD_TRIP, Event.BUS_LOST) or (
                why and self.state is ArmState.RAW):
            self.causes = why
        if self.state is ArmState.ARMED and event not in (Event.STOP, Event.CLOSE):
            self.ended_by = why
        if self.state is ArmState.ARMING:
            self.reasons = (*why, *(["LATCHED"] if to is ArmState.LOCKED else [])) \
                if to in (ArmState.DISARMED, ArmState.LOCKED) else ()
        if to is not ArmState.RAW:
            self.lifted = False
        self.state, self.since, self._good_since = to, now, None
        if self.output.throttle != "neutral":
            self._neutral_since = None
        elif self._neutral_since is None:
            self._neutral_since = now
        self.log.append((now, event, to, why))
