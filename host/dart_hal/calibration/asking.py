"""What a procedure tells and asks while it runs: how far it is, and whether it may begin."""

from __future__ import annotations

from collections.abc import Callable

from dart_hal.core.errors import CalibrationFailed

Progress = Callable[[float, str], None]
Ask = Callable[[str], bool]


def silent(fraction: float, text: str) -> None:
    """The progress callback of a caller who does not want one."""


def agree(question: str) -> bool:
    """The ask callback of a caller who has agreed beforehand."""
    return True


def begin(ask: Ask, what: object, ready: str = "the floor free", once: str = "the floor is free"
          ) -> None:
    """Say what is coming and ask whether all is ready. Errors: CalibrationFailed if it is not."""
    if not ask(f"This {what}. Is {ready}?"):
        raise CalibrationFailed("not started: it was not agreed to",
                                remedy=f"agree once {once}; in a script: --yes")
