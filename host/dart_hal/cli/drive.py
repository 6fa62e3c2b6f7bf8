"""``dart-hal drive``: by keyboard, gamepad or a script."""

from __future__ import annotations

import ast
import runpy
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, nullcontext, redirect_stdout
from pathlib import Path
from typing import Any

import click

from dart_hal.car import Car
from dart_hal.cli.common.options import (
    Number,
    car_options,
    foxglove_options,
    json_option,
    poses_option,
    waive_option,
)
from dart_hal.cli.common.output import console, print_json, results
from dart_hal.cli.common.outputs import OutputFile
from dart_hal.cli.common.session import in_real_time, opened, paced, shown_live, with_progress
from dart_hal.cli.common.summary import Summary
from dart_hal.control.gamepad import Gamepad, Manual
from dart_hal.control.keyboard import Keyboard
from dart_hal.core.errors import DartHalError, ScriptFailed, UsageError
from dart_hal.core.types import State

Control = Callable[[State], tuple[float, float] | None]
HELP = "arrows or WASD steer and drive, space stops, q ends; letting go stops the car"


@click.command("drive")
@car_options
@click.argument("script", required=False, type=click.Path(path_type=Path, dir_okay=False))
@click.option("--keyboard", is_flag=True, help="arrow keys or WASD of this terminal")
@click.option("--gamepad", is_flag=True, help="/dev/input/js0, right bumper held")
@click.option("--duration", type=Number(min=0.1), default=None,
              help="seconds of the car's time (a script: 10)")
@click.option("--max-throttle", type=Number(0.0, 1.0), default=0.35, show_default=True,
              help="scale of keyboard and gamepad")
@click.option("--view", is_flag=True, help="serve a live page that watches the car, and stops it; "
              "sim:// runs in real time then")
@waive_option
@click.option("--record", type=OutputFile(replaces=False), default=None,
              help="write the run to this MCAP file")
@poses_option
@foxglove_options
@json_option
def command(url: str | None, car_name: str, cars: Path | None, script: Path | None,
            keyboard: bool, gamepad: bool, duration: float | None, max_throttle: float,
            waive: tuple[str, ...], record: Path | None, poses: str | None, foxglove: bool,
            port: int, view: bool, as_json: bool) -> None:
    """Drive the car. SCRIPT defines control(state) -> (steering rad, throttle); None ends."""
    if keyboard + gamepad + (script is not None) != 1:
        raise UsageError("say how to drive",
                         expected="one of --keyboard, --gamepad, SCRIPT.py",
                         remedy="dart-hal drive --keyboard")
    control = load(script) if script else None
    manual = Gamepad() if gamepad else Keyboard() if keyboard else None
    with (closing(manual) if manual else nullcontext(),
          opened(paced(url) if view else url, car_name, cars, record, poses) as car,
          car.view() if view else nullcontext() as page):
        if page is not None:
            console.print(page.urls[-1], markup=False, highlight=False, soft_wrap=True)
        summary = Summary(car)
        if not car.drives:
            raise UsageError(f"{car.url} has nothing to drive", expected="a car with its I2C bus",
                             remedy="sim://, or serial:///dev/ttyUSB0?i2c=1; "
                             "dart-hal replay runs a recording")
        with shown_live(car, foxglove, port):
            car.arm(waive=waive)
            if control is not None:
                run_script(car, control, duration or 10.0, in_time=foxglove)
            elif manual is not None:
                run_manual(car, manual, max_throttle, duration or float("inf"))
        car.stop()
        result = summary.as_json({"recording": record} if record else {})
    if as_json:
        print_json(result)
    else:
        results.print(f"{summary.distance:.2f} m in {summary.duration:.1f} s"
                      + (f", recorded in {record}" if record else ""), markup=False)


def load(path: Path) -> Control:
    """The function ``control`` of a script. Raises UsageError, ScriptFailed."""
    if not path.is_file():
        raise UsageError(f"there is no script {path}", expected="a Python file")
    with blamed(path):
        names = defined(path.read_bytes())
    if "control" not in names:  # looked at before anything of it runs and moves a car
        raise UsageError(f"{path} defines no control(state)", found=", ".join(names),
                         expected="def control(state): return steering_rad, throttle",
                         remedy=f"a program of its own is run by: python {path}")
    with blamed(path), redirect_stdout(sys.stderr):
        space: dict[str, Any] = runpy.run_path(str(path))
    control = space["control"]
    if not callable(control):
        raise UsageError(f"{path}: control is not a function", found=repr(control),
                         expected="def control(state): return steering_rad, throttle")

    def checked(state: State) -> tuple[float, float] | None:
        with blamed(path), redirect_stdout(sys.stderr):
            wanted = control(state)
            return None if wanted is None else (float(wanted[0]), float(wanted[1]))

    return checked


def defined(source: str | bytes) -> list[str]:
    """Names that a module binds at its top level. Raises SyntaxError."""
    names: list[str] = []
    for node in ast.parse(source).body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            names.append(node.name)
        elif isinstance(node, (ast.Import, ast.ImportFrom)):
            names += [alias.asname or alias.name for alias in node.names]
        elif isinstance(node, ast.Assign):
            names += [t.id for t in node.targets if isinstance(t, ast.Name)]
    return names


@contextmanager
def blamed(path: Path) -> Iterator[None]:
    """What goes wrong inside is the script's: raised as ScriptFailed with its line."""
    try:
        yield
    except DartHalError:
        raise
    except (Exception, SystemExit) as error:
        lines = [f.lineno for f in traceback.extract_tb(error.__traceback__)
                 if f.filename == str(path)]
        line = getattr(error, "lineno", None) if isinstance(error, SyntaxError) else None
        at = line or (lines[-1] if lines else None)
        where = f"{path}, line {at}" if at else f"{path}: what control(state) returned"
        raise ScriptFailed(f"the script raised {type(error).__name__}: {error}", found=where,
                           expected="def control(state): return steering_rad, throttle"
                           ) from error


def run_script(car: Car, control: Control, duration: float, *, in_time: bool = False) -> None:
    """Ask ``control`` at every State; in_time: no faster than a person can watch."""
    states = car.states(duration=duration)
    for state in with_progress(in_real_time(states) if in_time else states, duration, "driving"):
        wanted = control(state)
        if wanted is None:
            return
        car.drive(steering=wanted[0], throttle=wanted[1], source="script")


def run_manual(car: Car, source: Manual, max_throttle: float, duration: float) -> None:
    """A person drives; full deflection is the car's full lock and ``max_throttle``."""
    lock = car.files.config.limits.max_steering
    name = type(source).__name__.lower()
    console.print(HELP if name == "keyboard" else "hold the right bumper to drive, B ends")
    notice = ""
    for n, state in enumerate(in_real_time(car.states(duration=duration))):
        steering, throttle, ended = source.read()
        if ended:
            break
        if source.notice and source.notice != notice:
            console.print(f"\n{name}: {source.notice}", style="yellow", markup=False,
                          highlight=False)
        notice = source.notice
        car.drive(steering=lock * steering, throttle=max_throttle * throttle, source=name)
        if n % 10 == 0:
            console.print(f"{state.speed:5.2f} m/s  steering {state.applied.steering:+.2f} rad"
                          f"  x {state.pose.x:6.2f} y {state.pose.y:6.2f} m", end="\r")
    console.print()
