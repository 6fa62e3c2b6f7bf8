"""Who drives by a page, and for how long a command of it holds. Pure: times come in.

A page tells with each command the newest time of this computer that it has heard. What has passed
since is at least the age of the command, whatever the two clocks say: it is taken off how long the
command holds. When that is over without the next one, driving has ended, and the car is armed
again by hand alone.

A page sends commands in a loop, also while its hand reports nothing: a gamepad out of range, a
mouse or a keyboard that hangs. So it also sends the time since the last report of the hand. Beyond
``MAX_UNCHANGED_S`` the throttle is neutral until the hand has let go.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

from dart_hal.control.input_age import MAX_UNCHANGED_S, InputAge
from dart_lab.live.view.access import Access

HOLD = 0.2
"""s from what the page had heard to the end of its command. With a PWM frame and a pulse, 22 ms,
behind it the motor's pulse is neutral within 250 ms of a page that fell silent. A page that hears
30 times a second and answers as often needs 67 ms of it, the rest is the network's."""
TRIES = 5
"""Wrong tokens of one page until it is sent away."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """steering, throttle -1..1; left [s]: how long they hold yet."""

    steering: float
    throttle: float
    left: float


class Refused(Exception):
    """Why a page may not; ``away``: it is sent away."""

    def __init__(self, why: str, away: bool = False) -> None:
        super().__init__(why)
        self.away = away


class Operator:
    """At most one page drives."""

    def __init__(self, access: Access) -> None:
        self._access = access
        self.page: Hashable | None = None
        self._wrong: dict[Hashable, int] = {}
        self._command: tuple[float, float] | None = None
        self._until = 0.0
        self._over = ""
        self._let_go = True
        self._hand = InputAge(MAX_UNCHANGED_S)
        self._hand_is_still = False
        self._reason = ""

    def take(self, page: Hashable, token: str) -> None:
        """Raises Refused: another drives, or the token is wrong."""
        if not self._access.may_drive(token):
            self._wrong[page] = wrong = self._wrong.get(page, 0) + 1
            raise Refused("wrong token: open the address that was printed, with what is behind "
                          "its #", away=wrong >= TRIES)
        if self.page not in (None, page):
            raise Refused("another page has the wheel: it has to let go of it first")
        self.page, self._let_go = page, True
        self._hand_is_still = False

    def check(self, page: Hashable) -> None:
        """Raises Refused for all but the page that drives."""
        if page != self.page:
            raise Refused("this page does not drive: take the wheel first")

    def drive(self, page: Hashable, steering: float, throttle: float, heard: float,
              now: float, unchanged: float = 0.0) -> None:
        """Hold this command; unchanged [s]: since the hand last reported.

        Raises Refused: not the driver, or the command is too old, or of the future.
        """
        self.check(page)
        if not self._let_go:
            return
        if not 0.0 <= now - heard < HOLD:
            raise Refused(f"a command {1e3 * (now - heard):.0f} ms old, at most "
                          f"{1e3 * HOLD:.0f} are obeyed")
        self._hand.report(heard - max(unchanged, 0.0))
        if throttle != 0.0 and self._hand.is_over(now) and not self._hand_is_still:
            self._hand_is_still = True
            self._reason = (f"the stick, keys or gamepad did not change for {MAX_UNCHANGED_S} s: "
                            "the throttle is neutral; let go, arm and hold again")
        if self._hand_is_still:
            throttle = 0.0
        self._command = (min(1.0, max(-1.0, steering)), min(1.0, max(-1.0, throttle)))
        self._until = heard + HOLD

    def release(self, page: Hashable) -> None:
        """The stick was let go: the drive is over, the page stays the one that drives."""
        if page == self.page:
            self._let_go = True
            self._hand_is_still = False
            self._end("released")

    def gone(self, page: Hashable) -> None:
        """Left, or its socket closed."""
        self._wrong.pop(page, None)
        if page == self.page:
            self.page = None
            self._end("gone")

    def stop(self) -> None:
        """The car was stopped: a stick that is held moves nothing until it was let go."""
        self._command, self._let_go = None, False

    def armed(self) -> None:
        """The car has just been armed: a stick that was held all along moves nothing either."""
        if self._command is not None:
            self.stop()

    def wanted(self, now: float) -> Wanted | None:
        """What is asked for now; None: nothing."""
        if self._command is None:
            return None
        if now >= self._until:
            self._end("silent")
            return None
        return Wanted(*self._command, self._until - now)

    def ended(self) -> str:
        """Why a drive ended since the last call: released, gone, silent; "": none did."""
        over, self._over = self._over, ""
        return over

    def refusal(self) -> str:
        """Why the throttle became neutral since the last call although a hand holds it; or ""."""
        reason, self._reason = self._reason, ""
        return reason

    def _end(self, why: str) -> None:
        if self._command is not None:
            self._command, self._over = None, why
