"""``dart-hal car``: describe a car by its sizes and write car.toml."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import Any, TypeVar

import click

from dart_hal.cli.common.options import cars_option, json_option
from dart_hal.cli.common.output import console, print_json, print_line, show_notices
from dart_hal.core.config import Quantity, check_writable, measured_folder
from dart_hal.core.config.plausible import check_name
from dart_hal.core.errors import UsageError
from dart_hal.vehicle.new_car import (
    MeasuredSizes,
    add_loads,
    check_loads,
    estimate_yaw_inertia,
    locate_centre_of_mass,
    write_car,
)

CommandT = TypeVar("CommandT", bound=Callable[..., Any])
CENTRE_OF_MASS = "--front-load and --rear-load, or --l-f, or --l-r"
SIZE_HELP = {
    "wheelbase": "axle to axle [m]",
    "mass": "the car ready to drive [kg] (default: the sum of the axle loads)",
    "front_load": "front axle alone on the scale, the car level [kg]",
    "rear_load": "rear axle alone on the scale, the car level [kg]",
    "l_f": "centre of mass to the front axle [m], in place of the axle loads",
    "l_r": "centre of mass to the rear axle [m], in place of the axle loads",
    "yaw_inertia": "yaw inertia [kg m2] (default: estimated from mass and axles)",
    "max_steering": "largest angle of the road wheels, mean of both sides [rad]",
}
# Share of the wheel force at the front axle.
FRONT_SHARES = {"all": 0.5, "front": 1.0, "rear": 0.0}
UNITS = {"wheelbase": "m", "l_f": "m", "l_r": "m", "mass": "kg", "yaw_inertia": "kg m2"}
WITH_ERROR = re.compile(r"(?P<value>.+?)\s*(\+-|\+/-|±)\s*(?P<std>.+)")


class MeasuredNumber(click.ParamType):  # type: ignore[type-arg]
    """VALUE+-STD: a positive number and its standard error, in the same unit."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None,
                ctx: click.Context | None) -> Quantity:
        if isinstance(value, Quantity):
            return value
        parts = WITH_ERROR.fullmatch(str(value).strip())
        try:
            size, std = (float(parts[key]) for key in ("value", "std")) if parts else (0.0, 0.0)
        except ValueError:
            parts = None
        if parts is None:
            self.fail(f"{value!r} is not VALUE+-STD, such as 0.325+-0.002; STD is half of what the "
                      "value may be off by", param, ctx)
        if not (isfinite(size) and isfinite(std) and size > 0.0 and std > 0.0):
            self.fail(f"{value!r}: value and standard error must be finite and above 0", param, ctx)
        return Quantity(size, std)


MEASURED_NUMBER = MeasuredNumber()


@click.group("car")
def command() -> None:
    """The description of a car: its file car.toml."""


def size_options(command: CommandT) -> CommandT:
    """Add an option for each size of a car."""
    for key, text in reversed(SIZE_HELP.items()):
        # The last decorator is the first option of the help: hence the reversed order.
        command = click.option(f"--{key.replace('_', '-')}", type=MEASURED_NUMBER, default=None,
                               metavar="VALUE+-STD", help=text)(command)
    return command


@command.command("new")
@click.argument("name")
@size_options
@click.option("--drive", type=click.Choice(tuple(FRONT_SHARES)), default=None,
              help="driven axle; all: both drive with half of the force (a terminal prompts for "
              "it; without it fits assume all, with a caution)")
@cars_option
@json_option
def new(name: str, drive: str | None, cars: Path | None, as_json: bool,
        **given: Quantity | None) -> None:
    """Write the car.toml of a car NAME from its sizes, each with its standard error.

    Sizes have the form VALUE+-STD, such as 0.325+-0.002, in SI units. A terminal prompts for
    missing ones. The centre of mass follows from the loads of both axles, or is --l-f or --l-r. An
    existing car.toml keeps its other keys; its older version goes to history/. Fits move sizes
    within their standard errors.
    """
    check_name(name, "NAME")
    path = measured_folder(name, [cars] if cars else None) / "car.toml"
    check_writable(path.parent)
    sizes = {key: size for key, size in given.items() if size is not None}
    _check_choice(sizes)
    measured = _complete(sizes)
    drive = drive or _ask_drive(guided="wheelbase" not in sizes)
    if drive is not None:
        measured = replace(measured, front_share=FRONT_SHARES[drive])
    _show(name, path, measured, write_car(path, name, measured), as_json)


def _complete(given: Mapping[str, Quantity]) -> MeasuredSizes:
    """Return all sizes of a car; ask for those that are missing, or derive them."""
    # The wheelbase comes first: it turns axle loads into the centre of mass.
    wheelbase = given.get("wheelbase") or _ask("--wheelbase", "wheelbase, axle to axle [m]")
    mass, distance = _weigh(given, wheelbase)
    _check_inside(wheelbase, distance)
    # Standard errors of the sizes propagate into the estimate, so it is made last.
    inertia = given.get("yaw_inertia")
    if inertia is None and "wheelbase" not in given:  # a guided description, not a script
        inertia = _ask_optional("yaw inertia [kg m2]; Enter: estimate it")
    estimated = () if inertia else ("yaw_inertia",)
    (size,) = distance.values()
    inertia = inertia or estimate_yaw_inertia(wheelbase, size, mass)
    lock = given.get("max_steering") or _ask(
        "--max-steering", "largest angle of the road wheels, mean of both sides [rad]")
    return MeasuredSizes({"wheelbase": wheelbase, **distance, "mass": mass,
                          "yaw_inertia": inertia}, lock, estimated)


def _weigh(given: Mapping[str, Quantity], wheelbase: Quantity
           ) -> tuple[Quantity, dict[str, Quantity]]:
    """Return the mass, and the centre of mass as l_f or l_r."""
    # The loads of the axles give both: m = m_f + m_r and l_r = L m_f / m.
    mass = given.get("mass")
    front, rear = (given.get(key) for key in ("front_load", "rear_load"))
    distance = {key: given[key] for key in ("l_f", "l_r") if key in given}
    if not distance and front is None:
        front = _ask_optional("front axle alone on the scale, the car level [kg]; Enter: you know "
                              "the centre of mass")
        rear = front and _ask("--rear-load", "rear axle alone on the scale, the car level [kg]")
    if front is not None and rear is not None:
        if mass is not None:
            check_loads(front, rear, mass)
        return mass or add_loads(front, rear), {"l_f": locate_centre_of_mass(wheelbase, front,
                                                                             rear)}
    mass = mass or _ask("--mass", "mass of the car, ready to drive [kg]")
    return mass, distance or {"l_f": _ask(CENTRE_OF_MASS, "centre of mass to the front axle [m]")}


def _check_choice(given: Mapping[str, Quantity]) -> None:
    """Raise UsageError unless the centre of mass is given in one way at most."""
    # More than one way would give two values for one distance.
    named = [key for key in ("front_load", "rear_load", "l_f", "l_r") if key in given]
    if named not in ([], ["front_load", "rear_load"], ["l_f"], ["l_r"]):
        raise UsageError("the centre of mass needs both axle loads, or one distance",
                         found=" ".join(f"--{key.replace('_', '-')}" for key in named),
                         expected=CENTRE_OF_MASS, remedy="name one of the three")


def _check_inside(wheelbase: Quantity, distance: Mapping[str, Quantity]) -> None:
    """Raise UsageError for a centre of mass that is not between the axles."""
    for key, size in distance.items():
        if size.value >= wheelbase.value:
            raise UsageError("the centre of mass is not between the axles",
                             found=f"{key} = {size.value:g} m",
                             expected=f"less than the wheelbase of {wheelbase.value:g} m",
                             remedy="check the units: all lengths are in metres")


def _ask(option: str, question: str) -> Quantity:
    """Return the answer of the user. Raises UsageError without a terminal."""
    if not sys.stdin.isatty():
        raise UsageError(f"a size is missing: {question}", found="no terminal to ask",
                         expected=f"{option} VALUE+-STD",
                         remedy="dart-hal car new --help lists all sizes")
    answer: Quantity = click.prompt(f"{question}, as VALUE+-STD", type=MEASURED_NUMBER, err=True)
    return answer


def _ask_drive(guided: bool) -> str | None:
    """Return which axle is driven; None for a script."""
    if not (guided and sys.stdin.isatty()):
        return None
    answer: str = click.prompt("driven axle", type=click.Choice(tuple(FRONT_SHARES)), default="all",
                               err=True)
    return answer


def _ask_optional(question: str) -> Quantity | None:
    """Return the answer of the user, None for an empty one or without a terminal."""
    if not sys.stdin.isatty():
        return None
    answer: Quantity | str = click.prompt(question, default="", show_default=False, err=True,
                                          value_proc=_convert_optional)
    return answer if isinstance(answer, Quantity) else None


def _convert_optional(text: str) -> Quantity | str:
    """Convert an answer that may be empty."""
    return MEASURED_NUMBER.convert(text, None, None) if text else ""


def _show(name: str, path: Path, measured: MeasuredSizes, replaced: bool, as_json: bool) -> None:
    """Print the sizes, the file and the next commands."""
    if replaced:
        show_notices((f"{path} was there: its sizes are replaced, its other keys stay; the older "
                      f"version is in {path.parent / 'history'}",))
    rows = {**measured.sizes, "max_steering": measured.max_steering}
    if as_json:
        print_json({"car": name, "path": path, "replaced": replaced,
                    "estimated": list(measured.estimated), "front_share": measured.front_share,
                    "sizes": {key: {"value": size.value, "std": size.std}
                              for key, size in rows.items()}})
        return
    for key, size in rows.items():
        how = ", estimated" if key in measured.estimated else ""
        print_line(f"  {key:<13}{size.value:.4g} +- {size.std:.2g} "
                   f"{UNITS.get(key, 'rad')}{how}")
    share = measured.front_share
    print_line(f"  {'front_share':<13}" + (
        "not stated: all-wheel drive is assumed (--drive)" if share is None else f"{share:g}"))
    print_line(f"written: {path}")
    where = f" --cars {shlex.quote(str(path.parent.parent))}" if path.parent.parent.name != (
        "cars") else ""
    car = f"--car {shlex.quote(name)}{where}"
    out = shlex.quote(str(path.parent / "model.toml"))
    for line in (f"dart-hal data check {car} FILES",
                 f"dart-hal identify all --joint {car} --out {out} FILES"):
        console.print(f"next: {line}", markup=False, highlight=False)
