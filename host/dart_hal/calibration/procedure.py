"""Interface of a calibration: requirements, plan and measurement.

Each ``Procedure`` has its own module. ``order`` lists the built-in ones and finds those of other
packages (entry points ``dart_hal.procedures``). ``calibrate all``, the commands
``dart-hal calibrate NAME`` and the write-back into calibration.toml use only this interface.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from dart_hal.core.config import CarFiles
from dart_hal.core.errors import CalibrationFailed, UsageError
from dart_hal.core.ports import Workshop
from dart_hal.vehicle.sets import PAPER

from .result import Result

if TYPE_CHECKING:
    from dart_hal.car import Car
    from dart_hal.estimation.localisation.field import Map

R = TypeVar("R", bound=Result)
Progress = Callable[[float, str], None]
"""Receives the share that is done, 0..1, and what is being done."""
Ask = Callable[[str], bool]
"""Shows a question before the car moves and returns whether the user agrees."""


def silent(fraction: float, text: str) -> None:
    """Ignore the progress."""


def agree(question: str) -> bool:
    """Agree to every question, for callers that have checked the conditions before."""
    return True


class Condition(Enum):
    """Required state of the car before a procedure starts. The user confirms the value."""

    FREE_FLOOR = "the floor is free"
    """The car drives on a floor of the size ``ProcedurePlan.floor``."""
    LIFTED = "the stand is there"
    """The car spins its wheels in the air."""
    WIRED = "the wire is there"
    """The car is at rest, with a wire from the spare channel to D8 of the Nano."""
    AT_REST = "the car is at rest"


@dataclass(frozen=True, slots=True)
class Option:
    """One number of a procedure: an option of its command and a keyword of plan and measure.

    The type is that of ``default``: int, float, or a tuple of several float. None: a float that
    need not be given. ``low`` and ``high`` are limits in ``unit`` and are allowed themselves,
    ``low`` not if ``above_low``. ``metavar`` is the name of the value in the help.
    """

    name: str
    help: str
    default: float | tuple[float, ...] | None
    unit: str
    low: float
    high: float
    metavar: str | None = None
    above_low: bool = False

    def check(self, value: float | Sequence[float] | None) -> None:
        """Raise UsageError for a value outside the limits; None, not given, is none."""
        if value is None and self.default is None:
            return
        numbers = value if isinstance(value, Sequence) else (value,)
        if not all(isinstance(number, int | float) and self.low <= number <= self.high
                   and not (self.above_low and number == self.low) for number in numbers):
            unit = f" {self.unit}" if self.unit else ""
            raise UsageError(f"{self.name} is outside its limits", found=repr(value),
                             expected=f"{'more than ' if self.above_low else ''}{self.low:g} to "
                                      f"{self.high:g}{unit}")


@dataclass(frozen=True, slots=True)
class ProcedurePlan:
    """Plan of a procedure for one car, shown before anything moves.

    text: one sentence without its subject, with purpose, time, space and tools. duration [s].
    floor: (length, width) [m] that must be free; (0, 0) for none.
    """

    text: str
    duration: float
    floor: tuple[float, float] = (0.0, 0.0)

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, slots=True)
class Bench:
    """An open car on which a procedure measures, and its operator.

    person: operator who moves the car and reads tapes; None: no operator. chart: map of the room,
    for a procedure with ``lidar``. source: origin of the result, such as the car's URL.
    """

    car: Car
    person: Workshop | None = None
    progress: Progress = silent
    chart: Map | None = None
    source: str = ""

    @property
    def files(self) -> CarFiles:
        """The car's files."""
        return self.car.files

    @property
    def workshop(self) -> Workshop:
        """The operator at the car. Raises CalibrationFailed without one."""
        if self.person is None:
            raise CalibrationFailed("this procedure needs an operator", found="no workshop",
                                    remedy="pass a workshop to the procedure")
        return self.person


@dataclass(frozen=True, kw_only=True)
class Procedure(Generic[R]):
    """One calibration. A call shows the plan, requests consent, and measures; it writes nothing.

    name: of the command ``dart-hal calibrate NAME`` and of the entry point; help: of the command.
    plan: ``plan(files, **options)``; None if nothing happens at the car.
    measure: ``measure(bench, **options)``. It leaves the car stopped, also on Ctrl-C.
    condition: state of the car. poses, lidar: it needs external poses; a lidar and a map.
    keys: names in calibration.toml that exist once it is done. Without them ``calibrate all``
    omits the procedure. after: procedures whose result it uses. optional: others do not need it.
    adapt: options for a floor of (length, width) [m]. check: raises UsageError for options that
    do not fit together. plot: ``plot(result, files, path)`` draws a picture, which ``plot_help``
    describes; files are None for recordings. fit: ``fit(paths, car=NAME)`` makes a result from
    recordings, and ``fit_help`` describes that.
    confirm: the user confirms the result before it is written.
    """

    name: str
    help: str
    plan: Callable[..., ProcedurePlan | None]
    measure: Callable[..., R]
    condition: Condition = Condition.FREE_FLOOR
    poses: bool = False
    lidar: bool = False
    options: tuple[Option, ...] = ()
    keys: tuple[str, ...] = ()
    after: tuple[str, ...] = ()
    optional: bool = False
    adapt: Callable[[tuple[float, float]], Mapping[str, Any]] = field(default=lambda floor: {})
    check: Callable[..., None] = field(default=lambda **options: None)
    plot: Callable[[R, Any, Path], object] | None = None
    plot_help: str = ""
    fit: Callable[..., R] | None = None
    fit_help: str = ""
    confirm: bool = True

    def __call__(self, car: Car, workshop: Workshop | None = None, *, progress: Progress = silent,
                 ask: Ask = agree, source: str = "", chart: Map | None = None,
                 **options: Any) -> R:
        """Measure on an open car and return the result; it is written by ``measured.write``.

        Raises CalibrationFailed (with the likely cause), UsageError for an option outside its
        limits, LinkLost, NotArmed.
        """
        options = {**self.defaults, **options}
        for option in self.options:
            option.check(options[option.name])
        self.check(**{option.name: options[option.name] for option in self.options})
        plan = self.plan(car.files, **options)
        if plan is not None:
            begin(ask, plan, self.condition.value)
        source = source or car.files.config.name
        return self.measure(Bench(car, workshop, progress, chart, source), **options)

    @property
    def defaults(self) -> dict[str, Any]:
        """The options with their default values."""
        return {option.name: option.default for option in self.options}


def scale_floor(floor: tuple[float, float], files: CarFiles) -> tuple[float, float]:
    """Return the floor [m] that a car needs where a car of the paper's wheelbase needs ``floor``.

    Radii of circles grow with the wheelbase.
    """
    ratio = max(files.config.geometry.wheelbase / PAPER.body.wheelbase, 1.0)
    return (math.ceil(10.0 * ratio * floor[0] - 1e-6) / 10.0,
            math.ceil(10.0 * ratio * floor[1] - 1e-6) / 10.0)


def begin(ask: Ask, plan: object, ready: str = Condition.FREE_FLOOR.value) -> None:
    """Show the plan and ask whether all is ready: "SUBJECT is STATE". Raises CalibrationFailed."""
    subject, _, state = ready.partition(" is ")
    if not ask(f"This {plan}. Is {subject} {state}?"):
        raise CalibrationFailed("not started: it was not agreed to",
                                remedy=f"agree once {ready}; in a script: --yes")
