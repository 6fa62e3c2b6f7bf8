"""Questions to the person at a real car: to agree, to chalk and to measure."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable

import click

from dart_hal.cli.common.output import console, show_notices
from dart_hal.core.errors import CalibrationFailed
from dart_hal.core.ports.workshop import SCALE_STD

AskNumber = Callable[[str], float]


def confirm(question: str, yes: bool, prompt: str = "start") -> bool:
    """Show what is coming once, then ask for a yes.

    Errors: CalibrationFailed without a terminal.
    """
    console.print(f"{question}{' yes (--yes)' if yes else ''}", markup=False, highlight=False)
    if yes:
        return True
    if not sys.stdin.isatty():
        raise CalibrationFailed("not started: not confirmed", found="no terminal",
                                remedy="if the floor is free: the same command with --yes")
    return click.confirm(prompt, err=True)


def ask_number(question: str) -> float:
    """A number that the user types. Errors: CalibrationFailed without a terminal."""
    if not sys.stdin.isatty():
        raise CalibrationFailed("a measurement by hand is missing", found="no terminal",
                                expected=question, remedy="run it in a terminal")
    while True:
        # float() accepts nan and inf, which no measurement gives.
        value: float = click.prompt(question, type=float, err=True)
        if math.isfinite(value):
            return value


class TerminalOperator:
    """``ports.Workshop`` on a real car: each answer is typed, in the units of its question.

    ``pause`` is called before and ``resume`` after each question, for a progress bar.
    """

    def __init__(self, pause: Callable[[], None] = lambda: None,
                 resume: Callable[[], None] = lambda: None, ask: AskNumber = ask_number) -> None:
        self._pause, self._resume, self._typed = pause, resume, ask

    def mark(self) -> None:
        """Where the car stands now is chalked."""
        self._wait("put the car at the start, straight along the free floor; chalk where its "
                   "rear axle stands and along its side")

    def distance(self) -> float:
        """[m] along the floor."""
        return self._ask("distance of the rear axle from the chalk mark [m], to the millimetre")

    def turns(self) -> float:
        """[rad]; the question is for degrees, as a protractor has them."""
        return math.radians(self._ask(
            "turned since the chalk line [deg], left positive, full turns included "
            "(three turns and a quarter: 1170)"))

    def lift(self) -> None:
        """On a stand."""
        self._wait("put the car on a stand: all four wheels off the ground and free; keep fingers, "
                   "hair and cables away from them")

    def set_down(self) -> None:
        """Off the stand; nothing waits for it."""
        show_notices(("the car may come off its stand",))

    def push(self) -> bool:
        """By hand."""
        return self._choose("turn the wheels by hand, about one turn (on the floor: push the car "
                            "forward by a hand's breadth). Do they turn freely?",
                            {"yes": 1, "no": 0}) == 1

    def wheels_turned(self) -> int:
        """By eye."""
        return self._choose("which way did the wheels turn just now?",
                            {"forward": 1, "backward": -1, "not": 0})

    def mass(self) -> tuple[float, float]:
        """[kg]."""
        return self._ask("the car on the scale, ready to drive [kg]"), SCALE_STD

    def _wait(self, act: str) -> None:
        self._pause()
        if not sys.stdin.isatty():
            raise CalibrationFailed("this step needs an operator", found="no terminal",
                                    expected=act, remedy="run it in a terminal")
        click.prompt(f"{act}; Enter", default="", err=True, show_default=False)
        self._resume()

    def _choose(self, question: str, answers: dict[str, int]) -> int:
        self._pause()
        if not sys.stdin.isatty():
            raise CalibrationFailed("this step needs an operator", found="no terminal",
                                    expected=question, remedy="run it in a terminal")
        chosen: str = click.prompt(question, type=click.Choice([*answers]), err=True)
        self._resume()
        return answers[chosen]

    def _ask(self, question: str) -> float:
        self._pause()
        value = self._typed(question)
        self._resume()
        return value
