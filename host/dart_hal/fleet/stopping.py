"""Both sides of a stop, with time as an argument: the caller, and the car that obeys.

    STOP each 10 ms  ->  every car: RUN_STOP, neutral at once  ->  STOPPED to each STOP
    until all known cars have answered, or for 2 s

A car obeys every STOP that it receives, also a repeated one; in a room with a key only those that
``dart_hal.fleet.peers`` accepts. It may arm again 0.5 s after the last one, by the program that
drives it: no message of a room arms or drives.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import inf

from dart_hal.core.errors import UsageError
from dart_hal.core.numbers import is_number
from dart_hal.fleet.sender import Session

# s between two STOPs, the polling interval of a car. At a loss of 50 % half the cars receive the
# first, and within 50 ms, after six of them, 98 %.
STOP_INTERVAL = 0.01
# s for which STOP is repeated without all answers: longer than WLAN takes to roam.
MAX_STOP_TIME = 2.0
# s for which it is repeated in any case: for cars not received yet.
MIN_STOP_TIME = 0.2
# s after an answer from which a HEALTH counts: an earlier one may still be in transit.
HEALTH_DELAY = 0.1
ARMED_MODES = ("ARMED", "RAW")
# s after a STOP in which no car arms: 50 of them.
STOP_HOLD_TIME = 0.5


class StopCall:
    """One stop, called at ``now`` [s] for the known sessions ``cars``.

    number: identifies it, not 0; at_least [s]: for which it is repeated in any case. A car has
    answered when its own session sent STOPPED with this number, and its newest HEALTH from
    ``HEALTH_DELAY`` later on does not report that it is armed.
    """

    def __init__(self, number: int, why: str, cars: Iterable[Session], now: float,
                 at_least: float = MIN_STOP_TIME) -> None:
        self.number = number
        self.why = why
        self.cars = set(cars)
        self._at_least = at_least
        self._answers: dict[Session, float] = {}
        self._driving: set[Session] = set()
        self._since = now
        self._next = now

    def answer(self, number: int, session: Session, now: float) -> None:
        """Add a received STOPPED."""
        if number == self.number:
            self._answers.setdefault(session, now)

    def health(self, session: Session, mode: str, now: float) -> None:
        """Add a received HEALTH: a car that is armed after its answer has not obeyed."""
        if self.is_over(now) or now - self._answers.get(session, inf) < HEALTH_DELAY:
            return
        if mode in ARMED_MODES:
            self._driving.add(session)
        else:
            self._driving.discard(session)

    def add_cars(self, cars: Iterable[Session], now: float) -> None:
        """Require the answer of these cars, too: they were received during the stop."""
        if not self.is_over(now):
            self.cars.update(cars)

    @property
    def confirmed_cars(self) -> set[str]:
        """Names of the cars of which each session has answered."""
        return {session.name for session in self._answers} - self.silent

    @property
    def silent(self) -> set[str]:
        """Names of known cars of which a session has not answered, or is armed nevertheless."""
        missing = (self.cars - self._answers.keys()) | self._driving
        return {session.name for session in missing}

    def is_over(self, now: float) -> bool:
        """Whether the repetition has ended."""
        passed = now - self._since
        return passed > MAX_STOP_TIME or (passed > self._at_least and not self.silent)

    def is_due(self, now: float) -> bool:
        """Whether to send a STOP now."""
        if self.is_over(now) or now < self._next:
            return False
        self._next = now + STOP_INTERVAL
        return True


class StopRule:
    """Conditions under which one car must not drive.

    beat_within [s]: largest age of the last beat; inf: no beat is required. Raises UsageError
    for what is no time above 0.
    """

    def __init__(self, beat_within: float = inf) -> None:
        if not is_number(beat_within) or beat_within <= 0.0:
            raise UsageError("beat_within is no time", found=repr(beat_within),
                             expected="seconds, above 0", remedy="beat_within=0.5")
        self.beat_within = beat_within
        self.number = 0
        self._by = ""
        self._until = -inf
        self._beat = -inf

    def stop(self, number: int, who: str, why: str, now: float) -> None:
        """Add a received STOP."""
        self.number = number
        self._by = f"{who}: {why}" if why else who
        self._until = now + STOP_HOLD_TIME

    def beat(self, since: float) -> None:
        """Add a BEAT that counts from this time."""
        self._beat = max(self._beat, since)

    def drive_block(self, now: float) -> str:
        """Return the reason why the car must not drive; "" if it may."""
        if now < self._until:
            return f"stopped by {self._by}"
        if now - self._beat > self.beat_within:
            return f"the room was not watched for {self.beat_within:g} s"
        return ""
