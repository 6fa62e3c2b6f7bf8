"""The command ``dart-hal``: one file per verb, loaded when it is called."""

from __future__ import annotations

import logging
import os
import sys
import traceback
from difflib import get_close_matches
from importlib import import_module

import click

from dart_hal import __version__
from dart_hal.cli.common.output import console, notices, print_json
from dart_hal.core.errors import DartHalError, FileTrouble, InternalError, UsageError
from dart_hal.core.plugins import list_plugins, load_entry
from dart_hal.core.process.extras import install_command

VERBS = {
    "find": "list serial ports and I2C buses, and say behind which is a car",
    "doctor": "check port, firmware, stream, I2C, PCA9685, IMU and encoder; suggest the fix",
    "calibrate": "measure this car and write calibration.toml",
    "drive": "drive by keyboard, gamepad or a script",
    "follow": "follow a path: a CSV file, or a track by its name",
    "lane": "drive in the middle of a lane between boards, by the lidar alone",
    "map": "map the room by the lidar: driven by hand, along its walls, or a recording",
    "localize": "where the car is in a map, by its lidar: pose, covariance, health",
    "stop": "set the throttle to neutral, whichever program drives; needs only the I2C bus",
    "fleet": "list the cars of a room, watch them, stop them all",
    "standby": "service on the car: neutral throttle whenever no program drives",
    "record": "record a run, raw bytes included, to an MCAP file",
    "replay": "decode a recording again with the same code",
    "export": "write a run for other programs: table, ROS bag, LeRobot",
    "top": "live view of a car in the terminal",
    "flash": "write the firmware to a Nano and wait for its HELLO",
}
GROUP = "dart_hal.verbs"  # entry points: mappings like VERBS of other packages


def list_verbs() -> dict[str, tuple[str, str]]:
    """List what each verb does and the package of its module, those of other packages too.

    An entry point of ``dart_hal.verbs`` is a mapping like ``VERBS`` in the ``__init__`` of a
    package that has one module per verb, each with a click command named ``command``.
    """
    verbs = {name: (text, "dart_hal.cli") for name, text in VERBS.items()}
    for entry in list_plugins(GROUP).values():
        for name, text in load_entry(entry).items():
            verbs.setdefault(name, (text, entry.module))  # ``stop`` is ours, whoever adds one
    return verbs


def load_command(name: str) -> click.Command | None:
    """Import the command of a verb; None if there is no such verb."""
    package = "dart_hal.cli" if name in VERBS else list_verbs().get(name, ("", ""))[1]
    if not package:
        return None
    command: click.Command = import_module(f"{package}.{name}").command
    return command


class _Verbs(click.Group):
    """Imports a verb's module only when it is needed: `dart-hal --help` stays quick."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(list_verbs())

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        return load_command(name)

    def resolve_command(self, ctx: click.Context, args: list[str]
                        ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and not args[0].startswith("-") and self.get_command(ctx, args[0]) is None:
            known = list_verbs()
            near = get_close_matches(args[0], known, n=1)
            raise UsageError(f"there is no verb {args[0]!r}", found=args[0],
                             expected=", ".join(known),
                             remedy=f"dart-hal {near[0]}" if near else "dart-hal --help")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Verbs"):
            formatter.write_dl([(name, text) for name, (text, _) in list_verbs().items()])


@click.command(cls=_Verbs, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="dart-hal")
def cli() -> None:
    """Drive, calibrate, record and check DART cars: real, emulated or recorded."""


def main(args: list[str] | None = None) -> None:
    """Entry point: 0 done, 1 the answer is no, 2 usage or input error, 130 Ctrl-C."""
    argv = sys.argv[1:] if args is None else args
    as_json = "--json" in argv
    verb = next((word for word in argv if not word.startswith("-")), "")
    logger = logging.getLogger("dart_hal")
    logger.handlers = [h for h in logger.handlers if not isinstance(h, _Notices)]
    logger.addHandler(_Notices(verb))
    try:
        sys.exit(cli.main(argv, prog_name="dart-hal", standalone_mode=False) or 0)
    except DartHalError as error:
        if verb and error.remedy == UsageError.remedy_default:
            error.remedy = f"dart-hal {verb} --help"
        _fail(error, as_json)
    except click.ClickException as error:
        _refuse(error, argv, as_json)
    except (KeyboardInterrupt, click.Abort):
        console.print("stopped")
        sys.exit(130)
    except OSError as error:
        _fail(_file_trouble(error), as_json)
    except MemoryError:
        _fail(UsageError("the memory of this computer does not hold this input",
                         found="no memory left", expected="a file or a range that fits",
                         remedy="give it less at a time"), as_json)
    except ModuleNotFoundError as error:
        _fail(_missing_package(error), as_json)
    except Exception as error:  # noqa: BLE001 - the user gets a sentence, not our stack
        if os.environ.get("DART_HAL_DEBUG"):
            traceback.print_exc()
        _fail(_internal(error), as_json)


class _Notices(logging.Handler):
    """What the library warns of, such as at arm(), as every other notice."""

    def __init__(self, verb: str) -> None:
        super().__init__()
        self._verb = verb

    def filter(self, record: logging.LogRecord) -> bool:
        """That a simulated car waited for the loop is news to who wrote the loop alone."""
        return self._verb == "drive" or not getattr(record, "waits", False)

    def emit(self, record: logging.LogRecord) -> None:
        notices((record.getMessage(),))


def _refuse(error: click.ClickException, argv: list[str], as_json: bool) -> None:
    """A usage error of click."""
    if as_json:
        _fail(UsageError(error.format_message(), found=" ".join(argv),
                         remedy="dart-hal --help"), as_json)
    error.show()
    sys.exit(2)


def _missing_package(error: ModuleNotFoundError) -> DartHalError:
    """Return the error for a package that an optional part of a verb imports."""
    package = (error.name or "").partition(".")[0]
    if package in ("", "dart_hal"):
        return _internal(error)
    return UsageError(f"this needs the Python package {package}",
                      found=f"{package} is not installed for {sys.executable}",
                      remedy=install_command(package))


def _file_trouble(error: OSError) -> FileTrouble:
    name = error.filename if isinstance(error.filename, str) else ""
    reason = error.strerror or str(error)
    return FileTrouble(f"{name}: {reason}" if name else reason,
                       found=f"{type(error).__name__} {error.errno or ''}".strip(), read=name)


def _internal(error: Exception) -> InternalError:
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return InternalError(f"{type(error).__name__}: {error}",
                         found=f"{os.path.basename(frame.filename)}, line {frame.lineno}")


def _fail(error: DartHalError, as_json: bool) -> None:
    if as_json:
        print_json({"error": error.as_json()})
    console.print(str(error), style="red", markup=False, highlight=False, soft_wrap=True)
    sys.exit(2)


if __name__ == "__main__":
    main()
