"""Both ends of a stop, with time as an argument: who calls for it, and the car that obeys.

    STOP each 10 ms  ->  every car: RUN_STOP, neutral at once  ->  STOPPED to each STOP
    until all that are known have answered, or for 2 s

A car obeys every STOP that it hears, also one that it has obeyed before. It may arm again when
none was heard for 0.5 s, by the program that drives it: nothing from the network arms or drives.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import inf

REPEAT = 0.01
"""s between two STOPs, as often as a car looks. At a loss of 50 % half the cars hear the first,
and in 50 ms, six of them, 98 % have heard one."""
PATIENCE = 2.0
"""s for which STOP is repeated where some do not answer: longer than WLAN takes to roam."""
AT_LEAST = 0.2
"""s for which it is repeated in any case: for cars that nobody has heard yet."""
HOLD = 0.5
"""s after a STOP in which no car arms: 50 of them."""


class StopCall:
    """One stop, called at ``now`` [s] for ``cars``, those that are known.

    number: names it, not 0; answered: who has.
    """

    def __init__(self, number: int, why: str, cars: Iterable[str], now: float) -> None:
        self.number, self.why = number, why
        self.cars, self.answered = set(cars), set[str]()
        self._since, self._next = now, now

    def answer(self, number: int, who: str) -> None:
        """A STOPPED came."""
        if number == self.number:
            self.answered.add(who)

    @property
    def silent(self) -> set[str]:
        """Known cars that have not answered."""
        return self.cars - self.answered

    def over(self, now: float) -> bool:
        """Whether it need not be repeated any more."""
        passed = now - self._since
        return passed > PATIENCE or (passed > AT_LEAST and not self.silent)

    def due(self, now: float) -> bool:
        """Whether to send it now."""
        if self.over(now) or now < self._next:
            return False
        self._next = now + REPEAT
        return True


class StopRule:
    """Why one car must stand. beat_within [s]: the longest silence of whoever watches the room
    in which it may drive; inf: nobody need watch."""

    def __init__(self, beat_within: float = inf) -> None:
        self.beat_within = beat_within
        self.number = 0
        self._by, self._until, self._beat = "", -inf, -inf

    def stop(self, number: int, who: str, why: str, now: float) -> None:
        """A STOP came."""
        self.number = number
        self._by = f"{who}: {why}" if why else who
        self._until = now + HOLD

    def beat(self, now: float) -> None:
        """A BEAT came."""
        self._beat = max(self._beat, now)

    def held(self, now: float) -> str:
        """Who or what keeps the car from driving; "": nothing does."""
        if now < self._until:
            return f"stopped by {self._by}"
        if now - self._beat > self.beat_within:
            return f"nobody has watched the room for {self.beat_within:g} s"
        return ""
