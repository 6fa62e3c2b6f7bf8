"""Which page drives, and for how long its command is valid. No clock: times are arguments.

**Age of a command.** A page sends with each command the newest time of this computer that it has
received. The time since then is an upper bound of the age of the command, independent of the clock
of the page, and it is subtracted from the validity. If the validity ends without a new command,
the drive has ended, and the user has to arm again.

**Stuck input.** A page sends commands in a loop, also while its input reports nothing: a gamepad
out of range, a mouse or a keyboard that hangs. So it also sends the time since the last report of
the input. Beyond MAX_UNCHANGED_S the throttle is neutral until the input was released.

**Released stick.** The throttle is neutral and the drive goes on: the page repeats that its stick
is released, and holding it drives again. After MAX_RELEASED_S the drive has ended. It ends at once
if the page falls silent, is hidden or leaves.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

from dart_hal.control.input_age import MAX_UNCHANGED_S, InputAge
from dart_lab.live.view.access import Access

# Validity of a command, from the newest server time that the page knew. With a PWM frame and a
# pulse (22 ms) the motor's pulse is neutral within 250 ms after a page falls silent. A page that
# receives and answers 30 times a second uses 67 ms; the rest is for the network.
MAX_COMMAND_AGE_S = 0.2
# Time in which the page that drives has to answer that the car is armed: a status message comes
# five times a second, the rest is for the network. The throttle is neutral.
MAX_FIRST_ANSWER_S = 1.0
# Time for which a car stays armed with a released stick.
MAX_RELEASED_S = 10.0
# Wrong tokens of one page until its connection is closed.
MAX_WRONG_TOKENS = 5


@dataclass(frozen=True, slots=True)
class PageCommand:
    """steering, throttle -1..1; remaining_s: their remaining validity."""

    steering: float
    throttle: float
    remaining_s: float


class Refused(Exception):
    """A request of a page is refused; ``away``: the page is disconnected."""

    def __init__(self, why: str, away: bool = False) -> None:
        super().__init__(why)
        self.away = away


class Operator:
    """The page that drives, at most one, and its command."""

    def __init__(self, access: Access) -> None:
        self._access = access
        self.page: Hashable | None = None
        self._wrong_tokens: dict[Hashable, int] = {}
        self._command: tuple[float, float] | None = None
        self._valid_until = 0.0
        self._end_reason = ""
        self._released = True
        # Time of the release of the stick [s]; None while it is held.
        self._released_at: float | None = None
        self._input = InputAge(MAX_UNCHANGED_S)
        self._input_is_stuck = False
        self._refusal = ""

    def take(self, page: Hashable, token: str) -> None:
        """Let a page drive. Raises Refused if another page drives or the token is wrong."""
        if not self._access.may_drive(token):
            self._wrong_tokens[page] = wrong = self._wrong_tokens.get(page, 0) + 1
            raise Refused("wrong token: open the address that was printed, including the part "
                          "after #", away=wrong >= MAX_WRONG_TOKENS)
        if self.page not in (None, page):
            raise Refused("another page drives: it has to leave the wheel first")
        self.page = page
        self._released = True
        self._input_is_stuck = False

    def check(self, page: Hashable) -> None:
        """Raise Refused if this page does not drive."""
        if page != self.page:
            raise Refused("this page does not drive: take the wheel first")

    def drive(self, page: Hashable, steering: float, throttle: float, heard: float,
              now: float, unchanged: float = 0.0) -> None:
        """Accept a command; unchanged [s]: since the input last reported.

        Raises Refused if the page does not drive, or the command is too old or of the future.
        """
        self.check(page)
        if not self._released:
            # A stick held since before the car was armed: the page is there, and that is all.
            if self._command is not None and 0.0 <= now - heard < MAX_COMMAND_AGE_S:
                self._valid_until = heard + MAX_COMMAND_AGE_S
            return
        if not 0.0 <= now - heard < MAX_COMMAND_AGE_S:
            raise Refused(f"the command is {1e3 * (now - heard):.0f} ms old, the limit is "
                          f"{1e3 * MAX_COMMAND_AGE_S:.0f} ms")
        self._input.report(heard - max(unchanged, 0.0))
        if throttle != 0.0 and self._input.is_over(now) and not self._input_is_stuck:
            self._input_is_stuck = True
            self._refusal = (f"the stick, keys or gamepad did not change for {MAX_UNCHANGED_S} s: "
                             "the throttle is neutral; release and hold again")
        if self._input_is_stuck:
            throttle = 0.0
        self._command = (min(1.0, max(-1.0, steering)), min(1.0, max(-1.0, throttle)))
        self._valid_until = heard + MAX_COMMAND_AGE_S
        self._released_at = None

    def release(self, page: Hashable, heard: float | None = None, now: float = 0.0,
                mode: str = "") -> None:
        """Set the throttle of the command to neutral because the stick is released.

        heard: None ends the drive. mode: of the car.
        """
        if page != self.page:
            return
        self._released = True
        self._input_is_stuck = False
        if heard is None:
            self._end("released", always=mode == "ARMED")
            return
        # A drive that has just ended is not continued.
        if mode != "ARMED" or self._end_reason:
            self._command = None
            self._released_at = None
            return
        if self._released_at is None:
            self._released_at = now
        steering = self._command[0] if self._command is not None else 0.0
        self._command = (steering, 0.0)
        self._valid_until = min(heard, now) + MAX_COMMAND_AGE_S

    def remove_page(self, page: Hashable, mode: str = "") -> bool:
        """Remove a page that left or whose socket closed; return whether it drove.

        mode: of the car. One that is armed is stopped, with or without a command.
        """
        self._wrong_tokens.pop(page, None)
        drove = page == self.page
        if drove:
            self.page = None
            self._end("gone", always=mode == "ARMED")
        return drove

    def stop(self) -> None:
        """Drop the command; a stick that is held has no effect until it was released."""
        self._command = None
        self._released = False
        self._released_at = None

    def require_release(self) -> None:
        """Require that a stick held during arming is released before it has an effect."""
        if self._command is not None:
            self.stop()

    def begin(self, now: float) -> None:
        """Begin a drive at neutral: the car has been armed for the page that drives.

        It ends unless the page answers. A stick held during arming has no effect until released.
        """
        self.require_release()
        self._command = (0.0, 0.0)
        self._valid_until = now + MAX_FIRST_ANSWER_S
        self._released_at = now
        self._end_reason = ""

    def current_command(self, now: float) -> PageCommand | None:
        """Return the valid command, None if there is none."""
        if self._command is None:
            return None
        if now >= self._valid_until:
            self._end("silent")
            return None
        if self._released_at is not None and now - self._released_at >= MAX_RELEASED_S:
            self._end("idle")
            return None
        return PageCommand(*self._command, self._valid_until - now)

    def take_end_reason(self) -> str:
        """Return and clear why a drive ended: released, gone, silent, idle; "" if none did."""
        reason = self._end_reason
        self._end_reason = ""
        return reason

    def take_refusal(self) -> str:
        """Return and clear why the throttle of a held stick became neutral; "" if it did not."""
        reason = self._refusal
        self._refusal = ""
        return reason

    def _end(self, why: str, always: bool = False) -> None:
        if self._command is not None or always:
            self._command = None
            self._released_at = None
            self._end_reason = why
