"""Mutants that no test can notice, each with the reason; they are listed and not counted."""

from __future__ import annotations

from dataclasses import dataclass

from mutant import CHECKOUT, Mutant

SRC = "firmware/src/"
HOST_FOLDER = "host/dart_hal/"
EFFECTS_FOLDER = HOST_FOLDER + "vehicle/effects/"


@dataclass(frozen=True, slots=True)
class Equivalent:
    """``before``: the whole line in ``file``, which occurs once; ``after``: what becomes of it."""

    file: str
    before: str
    after: str
    reason: str

    def matches(self, mutant: Mutant) -> bool:
        """Whether it is this mutant."""
        return (self.file, self.before, self.after) == (mutant.file, mutant.before, mutant.after)

    def occurrences(self) -> int:
        """How many lines of the file read as ``before``."""
        lines = (CHECKOUT / self.file).read_text(encoding="utf-8").splitlines()
        return sum(line.strip() == self.before for line in lines)


EQUIVALENTS = (
    Equivalent(
        SRC + "core/frame.cpp", "return false;", "return true;",
        "store() has set dropped_ by then: feed() ignores all bytes up to the delimiter, and "
        "end_of_block() returns kTooLong before it looks at left_"),
    Equivalent(
        SRC + "board/twi.cpp", "TWCR = kOn;", "",
        "each transfer begins with kStart, which contains TWEN; until then the lines are inputs"),
    Equivalent(
        HOST_FOLDER + "car/facts.py",
        "loss = (self._lost[-1] - self._lost[0]) / len(self._lost) if self._lost else 0.0",
        "loss = (self._lost[-1] - self._lost[0]) / len(self._lost) if self._lost else -1.0",
        "without a frame; the loss is compared with 2 % alone, and LINK_NOT_GOOD_500MS holds"),
    Equivalent(
        HOST_FOLDER + "devices/actuation/arming.py", "guard_age: float | None = 0.0",
        "guard_age: float | None = -1.0",
        "the age is compared by > MAX_GUARD_AGE, <= STALE and is None alone: 0 and -1 give the "
        "same"),
    Equivalent(
        HOST_FOLDER + "devices/actuation/guard.py", "if mode1[0] & ALIASES:",
        "if mode1[ -1] & ALIASES:",
        "the buffer has one byte"),
    Equivalent(
        HOST_FOLDER + "devices/actuation/guard.py", "if newest >= 0:", "if newest >= -1:",
        "data without b and o are a, which sets the same fields, or q, which ends the guard"),
    Equivalent(
        EFFECTS_FOLDER + "encoder_axle.py", "return v + k * (front - f.fabs(now.v_x))",
        "return v + k * (front - (now.v_x))",
        "forwards v_x is its own absolute value; there is no law for this effect in reverse"),
    Equivalent(
        EFFECTS_FOLDER + "pwm_quantisation.py",
        "MIN_STEP = 1e-9  # avoids a division by zero at k = 0",
        "MIN_STEP = 1.25e-09  # avoids a division by zero at k = 0",
        "keeps a quotient finite at k = 0; a step of 1e-9 of the command is none"),
    Equivalent(
        EFFECTS_FOLDER + "steering_compliance.py", "SLIP_OFFSET = 1e-8", "SLIP_OFFSET = 1.25e-08",
        "keeps a quotient finite; changes slip below 1e-4 rad alone, where the force is 4 mN"),
    Equivalent(
        EFFECTS_FOLDER + "steering_compliance.py", "STEP_OFFSET = 1e-16",
        "STEP_OFFSET = 1.25e-16",
        "keeps a quotient finite where two approximations agree to 1e-8 rad"),
    Equivalent(
        EFFECTS_FOLDER + "steering_compliance.py",
        "ratio = f.fmax(-0.5, f.fmin(0.5, last * step / (step * step + STEP_OFFSET)))",
        "ratio = f.fmax(-0.5, f.fmin(0.5, last * step / (step * step - STEP_OFFSET)))",
        "where two approximations agree to 1e-8 rad; the ratio is limited to a half either way"),
)


def equivalence(mutant: Mutant) -> str:
    """Why no test can notice it; "" = a test can."""
    return next((known.reason for known in EQUIVALENTS if known.matches(mutant)), "")
