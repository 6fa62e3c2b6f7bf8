"""Both ends of a stop, with time as an argument: who calls for it, and the car that obeys.

    STOP each 10 ms  ->  every car: RUN_STOP, neutral at once  ->  STOPPED to each STOP
    until all that are known have answered, or for 2 s

A car obeys every STOP that it hears, also one that it has obeyed before; in a room with a key
those of ``dart_hal.fleet.peers`` alone. It may arm again when none was heard for 0.5 s, by the
program that drives it: no message of a room arms or drives.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import inf

from dart_hal.fleet.sender import Session

REPEAT = 0.01
"""s between two STOPs, as often as a car looks. At a loss of 50 % half the cars hear the first,
and in 50 ms, six of them, 98 % have heard one."""
PATIENCE = 2.0
"""s for which STOP is repeated where some do not answer: longer than WLAN takes to roam."""
AT_LEAST = 0.2
"""s for which it is repeated in any case: for cars that nobody has heard yet."""
SETTLED = 0.1
"""s after an answer from which a HEALTH counts: one that left earlier may still be on its way."""
ARMED_MODES = ("ARMED", "RAW")
HOLD = 0.5
"""s after a STOP in which no car arms: 50 of them."""


class StopCall:
    """One stop, called at ``now`` [s] for the sessions ``cars``, those that are known.

    number: names it, not 0; at_least [s]: for which it is repeated in any case. A car has
    answered when its own session sent STOPPED with this number, and its latest HEALTH from
    ``SETTLED`` later on does not report that it is armed.
    """

    def __init__(self, number: int, why: str, cars: Iterable[Session], now: float,
                 at_least: float = AT_LEAST) -> None:
        self.number, self.why = number, why
        self.cars = set(cars)
        self._at_least = at_least
        self._answers: dict[Session, float] = {}
        self._driving: set[Session] = set()
        self._since, self._next = now, now

    def answer(self, number: int, session: Session, now: float) -> None:
        """A STOPPED arrived."""
        if number == self.number:
            self._answers.setdefault(session, now)

    def health(self, session: Session, mode: str, now: float) -> None:
        """A HEALTH arrived: a car that is armed after its answer has not obeyed."""
        if self.over(now) or now - self._answers.get(session, inf) < SETTLED:
            return
        if mode in ARMED_MODES:
            self._driving.add(session)
        else:
            self._driving.discard(session)

    def knows(self, cars: Iterable[Session], now: float) -> None:
        """Wait for these as well: they were received while the stop is repeated."""
        if not self.over(now):
            self.cars.update(cars)

    @property
    def answered(self) -> set[str]:
        """Names of the cars of which each session has answered."""
        return {session.name for session in self._answers} - self.silent

    @property
    def silent(self) -> set[str]:
        """Names of known cars of which a session has not answered, or is armed nevertheless."""
        missing = (self.cars - self._answers.keys()) | self._driving
        return {session.name for session in missing}

    def over(self, now: float) -> bool:
        """Whether it need not be repeated any more."""
        passed = now - self._since
        return passed > PATIENCE or (passed > self._at_least and not self.silent)

    def due(self, now: float) -> bool:
        """Whether to send it now."""
        if self.over(now) or now < self._next:
            return False
        self._next = now + REPEAT
        return True


class StopRule:
    """Why one car must not drive. beat_within [s]: the age of the last beat up to which it may;
    inf: no beat is needed."""

    def __init__(self, beat_within: float = inf) -> None:
        self.beat_within = beat_within
        self.number = 0
        self._by, self._until, self._beat = "", -inf, -inf

    def stop(self, number: int, who: str, why: str, now: float) -> None:
        """A STOP came."""
        self.number = number
        self._by = f"{who}: {why}" if why else who
        self._until = now + HOLD

    def beat(self, since: float) -> None:
        """A BEAT arrived that counts from this time."""
        self._beat = max(self._beat, since)

    def held(self, now: float) -> str:
        """Who or what keeps the car from driving; "": nothing does."""
        if now < self._until:
            return f"stopped by {self._by}"
        if now - self._beat > self.beat_within:
            return f"nobody has watched the room for {self.beat_within:g} s"
        return ""
