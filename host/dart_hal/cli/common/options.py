"""Options of several verbs, and types of their values."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from pathlib import Path
from typing import Any, TypeVar

import click

from dart_hal.car.files import DEFAULT_CAR
from dart_hal.car.misuse import check_url
from dart_hal.cli.common.output import show_notices
from dart_hal.cli.common.outputs import (
    OutputFile,
    OutputFolder,
    PlotFile,
    PlotFileOrFolder,
    PlotFolder,
)
from dart_hal.control.mpc.obstacles import Disc
from dart_hal.recording.dart import Reference

CommandT = TypeVar("CommandT", bound=Callable[..., Any])


def url_option(command: CommandT) -> CommandT:
    """Add ``--url``: the car; default $DART_HAL_URL, then the emulated car."""
    return click.option("--url", default=None, envvar="DART_HAL_URL", metavar="URL",
                        callback=lambda _context, _option, url: check_url(url),
                        help="sim://?seed=7, serial:///dev/ttyUSB0?i2c=1, replay://run.mcap "
                             "(default: $DART_HAL_URL, then sim://)")(command)


def car_options(command: CommandT) -> CommandT:
    """Add ``--url``, ``--car`` and ``--cars``: the car and its files."""
    command = click.option("--car", "car_name", default=DEFAULT_CAR, envvar="DART_HAL_CAR",
                           show_default=True, help="name of the car whose files are used "
                           "(also: $DART_HAL_CAR)")(command)
    return url_option(cars_option(command))


def cars_option(command: CommandT) -> CommandT:
    """Add ``--cars``: the folder with the files of the cars."""
    return click.option("--cars", type=click.Path(path_type=Path, file_okay=False),
                        default=None, help="folder with the cars' files (default: $DART_CARS, "
                        "./cars, ~/.local/share/dart-hal/cars)")(command)


def poses_option(command: CommandT) -> CommandT:
    """Add ``--poses``: source of external poses; a recording includes the poses."""
    return click.option("--poses", default=None, metavar="URL",
                        help="source of external poses: natnet://HOST?body=car, "
                        "vrpn://car@HOST, udp://:5005, file://poses.csv, lidar:map.yaml, or lidar "
                        "in sim:// (default: $DART_HAL_POSES)"
                        )(command)


def lidar_option(command: CommandT) -> CommandT:
    """Add ``--lidar``: the port of the car's lidar."""
    return click.option("--lidar", default=None, metavar="URL",
                        help="the car's lidar: serial:///dev/dart-lidar or hwgrep://10C4:EA60 "
                        "(default: $DART_HAL_LIDAR; sim:// and recordings have their own)"
                        )(command)


def guard_option(command: CommandT) -> CommandT:
    """Add ``--guard-distance``: the lidar withholds forward throttle before obstacles."""
    return click.option("--guard-distance", type=float, default=None, metavar="M",
                        help="m before an obstacle on the car's arc at which its lidar withholds "
                        "forward throttle; without a fresh scan as well")(command)


def camera_option(command: CommandT) -> CommandT:
    """Add ``--camera``: a camera on the car or above it; a recording includes its images."""
    return click.option("--camera", default=None, metavar="URL",
                        help="camera: usb:0, usb:/dev/video0?width=640&height=480&fps=15, csi:0; "
                             "top in "
                        "sim:// (default: $DART_HAL_CAMERA; recordings have their own)")(command)


def map_option(command: CommandT) -> CommandT:
    """Add ``--map``: the map of the room of the lidar."""
    return click.option("--map", "chart", type=click.Path(path_type=Path, dir_okay=False),
                        default=None, help="map of the room: YAML file of ROS's map_server "
                        "(default for sim://: the simulated room)")(command)


def room_key_option(command: CommandT) -> CommandT:
    """Add ``--room-key``: the file with the key of a fleet room."""
    return click.option("--room-key", type=click.Path(path_type=Path, dir_okay=False),
                        default=None, metavar="FILE", help="file with the key of the room, the "
                        "same for all members; unsigned messages are ignored (default: "
                        "$DART_ROOM_KEY)")(command)


# Refusals of arm() that a user may waive.
WAIVE = ("CALIBRATION_MISSING", "PWM_CLOCK_UNCALIBRATED")


def waive_option(command: CommandT) -> CommandT:
    """Add ``--waive``: refusals of arm() that are accepted."""
    return click.option("--waive", multiple=True, type=click.Choice(WAIVE),
                        help="arm although this measurement is missing; repeat for several"
                        )(command)


def drive_options(command: CommandT) -> CommandT:
    """Add ``--duration`` and ``--record`` of a drive that ends by itself."""
    command = click.option("--record", type=OutputFile(replaces=False), default=None,
                           help="write the run to this MCAP file")(command)
    return click.option("--duration", type=FiniteNumber(min=0.1), default=None,
                        help="s after which the car stops")(command)


def foxglove_options(command: CommandT) -> CommandT:
    """Add ``--foxglove`` and ``--port``: serve the drive live to Foxglove."""
    command = click.option("--port", type=click.IntRange(1, 65535), default=8765,
                           show_default=True, help="TCP port of --foxglove")(command)
    return click.option("--foxglove", is_flag=True, help="serve every channel to Foxglove, "
                        "read-only, at ws://localhost:8765; sim:// then runs in real time"
                        )(command)


def json_option(command: CommandT) -> CommandT:
    """Add ``--json``: one JSON object on standard output."""
    return click.option("--json", "as_json", is_flag=True,
                        help="print one JSON object for machines")(command)


HTML_HELP = "write the report: one page with every figure"


def html_option(command: CommandT) -> CommandT:
    """Add ``--html``: the result as one page, for a person."""
    return html_option_with_default(None)(command)


def html_option_with_default(default: Path | None) -> Callable[[CommandT], CommandT]:
    """Return the decorator that adds ``--html`` with a page that is written in any case."""
    return click.option("--html", type=OutputFile(".html", ".htm"), default=default,
                        callback=_prefer_other_spelling, show_default=default is not None,
                        metavar="FILE", help=HTML_HELP)


def plot_option(picture: str) -> Callable[[CommandT], CommandT]:
    """Return the decorator that adds ``--plot``: one picture; picture: what it shows."""
    return click.option("--plot", type=PlotFile(), default=None, metavar="FILE",
                        help=f"write a picture: {picture}")


def plots_options(picture: str, pictures: str) -> Callable[[CommandT], CommandT]:
    """Return the decorator that adds ``--plot``, one picture, and ``--plots``, a folder of them.

    Both give the parameter ``plot``. A folder after ``--plot`` is the spelling of version 0.1.
    """
    def store(context: click.Context, parameter: click.Parameter, value: Any) -> None:
        if value is not None:
            context.meta["plot"] = value

    def decorate(command: CommandT) -> CommandT:
        command = click.option("--plots", type=PlotFolder(), metavar="FOLDER", default=None,
                               expose_value=False, callback=store,
                               help=f"write pictures into a folder: {pictures}")(command)
        return click.option("--plot", type=PlotFileOrFolder(), metavar="FILE", default=None,
                            callback=_prefer_other_spelling,
                            help=f"write a picture: {picture}")(command)

    return decorate


def out_option(*suffixes: str, content: str, replaces: bool = False, default: Path | None = None
               ) -> Callable[[CommandT], CommandT]:
    """Return the decorator that adds ``--out``: the result as a file for other programs.

    suffixes: allowed ones; none: any. replaces: see OutputFile.
    """
    return click.option("--out", type=OutputFile(*suffixes, replaces=replaces), default=default,
                        callback=_prefer_other_spelling, show_default=default is not None,
                        metavar="FILE", help=f"write the result: {content}")


def out_folder_option(content: str, default: Path) -> Callable[[CommandT], CommandT]:
    """Return the decorator that adds ``--out`` of a verb whose result is several files."""
    return click.option("--out", type=OutputFolder(), default=default, show_default=True,
                        metavar="FOLDER", help=f"write the result: {content}")


def old_spelling(old: str, new: str, kind: click.ParamType[Any]
                 ) -> Callable[[CommandT], CommandT]:
    """Return the decorator that adds the spelling of version 0.1 of an option, with a notice.

    It gives the parameter of the new option, and is not listed in the help.
    """
    def warn(context: click.Context, parameter: click.Parameter, value: Any) -> None:
        if value is not None:
            show_notices((f"{old} is {new} since version 0.2; {old} goes with the next version",))
            context.meta[new.strip("-")] = value

    return click.option(old, type=kind, default=None, hidden=True, expose_value=False,
                        help=f"the spelling of version 0.1 of {new}",
                        callback=warn)


def _prefer_other_spelling(context: click.Context, parameter: click.Parameter, value: Any) -> Any:
    """Return the value of another option for the same parameter, if that was given.

    click calls the options of the command line first, then those with their default values.
    """
    return context.meta.get(str(parameter.name), value)


class PageOption(click.Option):
    """``--html FILE``; without a file, as in version 0.1, it gives ``Path()``, with a notice."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **{**kwargs, "is_flag": False, "flag_value": "", "metavar": "FILE",
                                   "type": PageFile(), "help": HTML_HELP})

    def add_to_parser(self, parser: Any, ctx: click.Context) -> None:
        super().add_to_parser(parser, ctx)
        option = parser._long_opt[self.opts[0]]
        process = option.process

        def process_page(value: Any, state: Any) -> None:
            # What follows --html and is no page is the next argument.
            if isinstance(value, str) and not value.lower().endswith((".html", ".htm")):
                state.rargs.insert(0, value)
                value = ""
            process(value, state)

        option.process = process_page


class PageFile(OutputFile):
    """Path of a page; ``Path()`` for the empty text of ``--html`` without a file."""

    def __init__(self) -> None:
        super().__init__(".html", ".htm")

    def convert(self, value: Any, param: click.Parameter | None,
                ctx: click.Context | None) -> Path:
        if value == "":
            show_notices(("--html takes a file since version 0.2: --html FOLDER/index.html",))
            return Path()
        return super().convert(value, param, ctx)


def full_option(command: CommandT) -> CommandT:
    """Add ``--full``: every table and notice; without it, notices are counted."""
    return click.option("--full", is_flag=True, help="print every sentence, table and notice"
                        )(command)


class FiniteNumber(click.FloatRange):
    """A finite number within bounds; click's own range lets NaN pass."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None,
                ctx: click.Context | None) -> float:
        number: float = super().convert(value, param, ctx)
        if not isfinite(number):
            self.fail(f"{value} is not a finite number", param, ctx)
        return number


class DiscType(click.ParamType):  # type: ignore[type-arg]
    """X,Y,R or X,Y,R,SPEED (m, m/s): a disc-shaped obstacle."""

    name = "disc"

    def convert(self, value: Any, param: click.Parameter | None,
                ctx: click.Context | None) -> Disc:
        # click also converts default values, which are discs already.
        if isinstance(value, Disc):
            return value
        try:
            numbers = [float(part) for part in str(value).split(",")]
        except ValueError:
            numbers = []
        if len(numbers) not in (3, 4) or not all(map(isfinite, numbers)):
            self.fail(f"{value!r} is not X,Y,R or X,Y,R,SPEED (numbers, m and m/s)", param, ctx)
        if numbers[2] <= 0.0:
            self.fail(f"{value!r}: the radius must be above 0 m, not {numbers[2]:g} m", param, ctx)
        return Disc(*numbers)


class ReferenceType(click.ParamType):  # type: ignore[type-arg]
    """LX,THETA,LY (m, rad, m): pose of the mocap markers relative to the rear axle."""

    name = "reference"

    def convert(self, value: Any, param: click.Parameter | None,
                ctx: click.Context | None) -> Reference:
        if isinstance(value, Reference):
            return value
        try:
            lx, theta, ly = (float(part) for part in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r} is not LX,THETA,LY (three numbers: m, rad, m)", param, ctx)
        # Beyond these limits the units are wrong: millimetres, or degrees.
        if not (abs(lx) < 1.0 and abs(theta) < 7.0 and abs(ly) < 1.0):
            self.fail(f"{value!r}: LX and LY are metres (below 1), THETA is radians (below 7)",
                      param, ctx)
        return Reference(lx, theta, ly, "given by --reference")


REFERENCE = ReferenceType()


def format_reference_option(reference: Reference) -> str:
    """Return the option of a marker frame, as one word: its first number may be negative."""
    return f"--reference={reference.lx},{reference.theta},{reference.ly}"


class PathsOption(click.Option):
    """An option that takes every path up to the next option, and may be repeated."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **{**kwargs, "multiple": True, "type": click.Path(path_type=Path)})

    def add_to_parser(self, parser: Any, ctx: click.Context) -> None:
        super().add_to_parser(parser, ctx)
        for name in self.opts:
            # click has no options with a variable number of values: the parser's own option is
            # changed.
            option = parser._long_opt.get(name) or parser._short_opt.get(name)
            if option is not None:
                self._make_greedy(option)

    @staticmethod
    def _make_greedy(option: Any) -> None:
        """Let the parser's option take all values up to the next option."""
        process = option.process

        def greedy(value: Any, state: Any) -> None:
            process(value, state)
            while state.rargs and not state.rargs[0].startswith("-"):
                process(state.rargs.pop(0), state)

        option.process = greedy
