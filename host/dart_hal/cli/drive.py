"""``dart-hal drive``: drive with the keyboard, a gamepad or a script."""

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
    FiniteNumber,
    car_options,
    foxglove_options,
    guard_option,
    json_option,
    poses_option,
    waive_option,
)
from dart_hal.cli.common.output import console, print_json, results
from dart_hal.cli.common.outputs import OutputFile
from dart_hal.cli.common.session import (
    limit_to_real_time,
    open_car,
    real_time_url,
    serve_foxglove,
    with_progress,
)
from dart_hal.cli.common.summary import RunSummary
from dart_hal.control.gamepad import JOYSTICK, Gamepad, Manual
from dart_hal.control.gamepad_map import ask_layout, open_gamepad, save_layout
from dart_hal.control.keyboard import Keyboard
from dart_hal.core.errors import DartHalError, ScriptFailed, UsageError
from dart_hal.core.types import State

Control = Callable[[State], tuple[float, float] | None]
GAMEPAD_HELP = ("gamepad; hold the right bumper to drive. Its layout: that of --map, else that of "
                "SDL's database (extra gamepad), else Xbox-like at /dev/input/js0")
KEYBOARD_HELP = "arrows or WASD steer and drive, space stops, q ends; release the keys to stop"


@click.command("drive")
@car_options
@click.argument("script", required=False, type=click.Path(path_type=Path, dir_okay=False))
@click.option("--keyboard", is_flag=True, help="arrow keys or WASD of this terminal")
@click.option("--gamepad", is_flag=True, help=GAMEPAD_HELP)
@click.option("--map", "ask", is_flag=True,
              help="with --gamepad: ask for each control of the pad, save its layout and end")
@click.option("--duration", type=FiniteNumber(min=0.1), default=None,
              help="seconds of car time (default: 10 for a script, else no limit)")
@click.option("--max-throttle", type=FiniteNumber(0.0, 1.0), default=0.35, show_default=True,
              help="throttle of a key or of a stick pushed to its end")
@click.option("--view", is_flag=True, help="serve a live page that shows the car and can stop it; "
              "sim:// then runs in real time")
@waive_option
@click.option("--record", type=OutputFile(replaces=False), default=None,
              help="write the run to this MCAP file")
@poses_option
@guard_option
@foxglove_options
@json_option
def command(url: str | None, car_name: str, cars: Path | None, script: Path | None,
            keyboard: bool, gamepad: bool, ask: bool, duration: float | None, max_throttle: float,
            waive: tuple[str, ...], record: Path | None, poses: str | None,
            guard_distance: float | None, foxglove: bool, port: int, view: bool, as_json: bool
            ) -> None:
    """Drive the car. SCRIPT defines control(state) -> (steering rad, throttle); None ends."""
    if keyboard + gamepad + (script is not None) != 1:
        raise UsageError("exactly one way to drive is required",
                         expected="one of --keyboard, --gamepad, SCRIPT.py",
                         remedy="dart-hal drive --keyboard")
    if ask:
        map_gamepad(gamepad, as_json)
        return
    control = load_control(script) if script else None
    manual = open_gamepad() if gamepad else Keyboard() if keyboard else None
    with (closing(manual) if manual else nullcontext(),
          open_car(real_time_url(url) if view else url, car_name, cars, record, poses,
                   guard_distance=guard_distance) as car,
          car.view() if view else nullcontext() as page):
        if page is not None:
            console.print(page.urls[-1], markup=False, highlight=False, soft_wrap=True)
        summary = RunSummary(car)
        if not car.drives:
            raise UsageError(f"{car.url} has no actuators", expected="a car with its I2C bus",
                             remedy="sim://, or serial:///dev/ttyUSB0?i2c=1; for a recording: "
                             "dart-hal replay")
        with serve_foxglove(car, foxglove, port):
            car.arm(waive=waive)
            if control is not None:
                run_script(car, control, duration or 10.0, real_time=foxglove)
            elif manual is not None:
                run_manual(car, manual, max_throttle, duration or float("inf"))
        car.stop()
        result = summary.as_json({"recording": record} if record else {})
    if as_json:
        print_json(result)
    else:
        results.print(f"{summary.distance:.2f} m in {summary.duration:.1f} s"
                      + (f", recorded in {record}" if record else ""), markup=False)


def map_gamepad(gamepad: bool, as_json: bool) -> None:
    """Ask for the controls of the gamepad and save its layout. Raises UsageError, PortMissing."""
    if not gamepad:
        raise UsageError("--map is for the controls of a gamepad", found="--map",
                         expected="--gamepad --map")
    layout, name = ask_layout(JOYSTICK, lambda text: console.print(text, markup=False))
    path = save_layout(layout, name)
    if as_json:
        print_json({"gamepad": name, "layout": path})
    else:
        results.print(f"{name}: {path}", markup=False, soft_wrap=True)


def load_control(path: Path) -> Control:
    """Return the function ``control`` of a script. Raises UsageError, ScriptFailed."""
    if not path.is_file():
        raise UsageError(f"there is no script {path}", expected="a Python file")
    with report_script_errors(path):
        names = list_bound_names(path.read_bytes())
    # Checked in the source, before the script runs: a program of its own would move a car.
    if "control" not in names:
        raise UsageError(f"{path} defines no control(state)", found=", ".join(names),
                         expected="def control(state): return steering_rad, throttle",
                         remedy=f"to run a program of its own: python {path}")
    with report_script_errors(path), redirect_stdout(sys.stderr):
        space: dict[str, Any] = runpy.run_path(str(path))
    control = space["control"]
    if not callable(control):
        raise UsageError(f"{path}: control is not a function", found=repr(control),
                         expected="def control(state): return steering_rad, throttle")

    def call_control(state: State) -> tuple[float, float] | None:
        with report_script_errors(path), redirect_stdout(sys.stderr):
            command = control(state)
            return None if command is None else (float(command[0]), float(command[1]))

    return call_control


def list_bound_names(source: str | bytes) -> list[str]:
    """List the names that a module binds at its top level. Raises SyntaxError."""
    names: list[str] = []
    # Statements at the top level that bind a name; the script is not executed for this.
    for node in ast.parse(source).body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            names.append(node.name)
        elif isinstance(node, (ast.Import, ast.ImportFrom)):
            names += [alias.asname or alias.name for alias in node.names]
        elif isinstance(node, ast.Assign):
            names += [t.id for t in node.targets if isinstance(t, ast.Name)]
    return names


@contextmanager
def report_script_errors(path: Path) -> Iterator[None]:
    """Raise exceptions of the script as ScriptFailed, with the line of the script."""
    try:
        yield
    except DartHalError:
        raise
    except (Exception, SystemExit) as error:
        # The innermost frame in the script itself: below it are functions that it called.
        lines = [f.lineno for f in traceback.extract_tb(error.__traceback__)
                 if f.filename == str(path)]
        line = getattr(error, "lineno", None) if isinstance(error, SyntaxError) else None
        line = line or (lines[-1] if lines else None)
        where = f"{path}, line {line}" if line else f"{path}: what control(state) returned"
        raise ScriptFailed(f"the script raised {type(error).__name__}: {error}", found=where,
                           expected="def control(state): return steering_rad, throttle"
                           ) from error


def run_script(car: Car, control: Control, duration: float, *, real_time: bool = False) -> None:
    """Drive with ``control``, called at every State; real_time: no faster than the wall clock."""
    states = car.states(duration=duration)
    states = limit_to_real_time(states) if real_time else states
    for state in with_progress(states, duration, "driving"):
        command = control(state)
        if command is None:
            return
        car.drive(steering=command[0], throttle=command[1], source="script")


def run_manual(car: Car, source: Manual, max_throttle: float, duration: float) -> None:
    """Drive by keyboard or gamepad.

    Full deflection is the largest steering angle of the car, and ``max_throttle``.
    """
    # Full deflection of a key or a stick, in the units of ``Car.drive``.
    lock = car.files.config.limits.max_steering
    name = "gamepad" if isinstance(source, Gamepad) else "keyboard"
    console.print(KEYBOARD_HELP if name == "keyboard" else
                  "hold the right bumper to drive, B ends (or the buttons of --map)")
    notice = ""
    for n, state in enumerate(limit_to_real_time(car.states(duration=duration))):
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
