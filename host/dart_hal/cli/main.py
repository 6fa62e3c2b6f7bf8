"""The command ``dart-hal``: one file per verb, loaded when it is called."""

from __future__ import annotations

import logging
import os
import sys
import traceback
from difflib import get_close_matches
from importlib import import_module

import click
from click.shell_completion import CompletionItem

from dart_hal import __version__
from dart_hal.cli.common.output import CTRL_C_STATUS, console, print_json, show_notices
from dart_hal.core.errors import DartHalError, FileTrouble, InternalError, UsageError
from dart_hal.core.plugins import list_plugins, load_entry
from dart_hal.core.process.extras import missing_module_error

VERBS = {
    "find": "list serial ports and I2C buses, and identify the port of the car",
    "doctor": "check port, firmware, stream, I2C, PCA9685, IMU and encoder; suggest the fix",
    "car": "describe a new car by its sizes; writes car.toml",
    "calibrate": "measure this car and write calibration.toml",
    "drive": "drive with the keyboard, a gamepad or a script",
    "follow": "follow a path: a CSV file, or a track by its name",
    "lane": "drive in the middle of a lane between boards, by the lidar alone",
    "map": "map a room by the lidar: driven by hand, along its walls, or from a recording",
    "localize": "locate the car in a map by its lidar: pose, covariance, health",
    "stop": "end the pulses of ESC and servo, also of another program; needs only the I2C bus",
    "fleet": "list the cars of a fleet room, watch them, stop them all",
    "standby": "service on the car: neutral throttle whenever no program drives",
    "record": "record a run, raw bytes included, to an MCAP file",
    "replay": "decode a recording again with the same code",
    "export": "convert a recording for other programs: table, ROS bag, LeRobot",
    "top": "live view of a car in the terminal",
    "flash": "write the firmware to a Nano and wait for its HELLO",
    "parameter": "store a parameter in the Nano, for example what hardware is fitted",
}
VERB_GROUPS = {
    "start": ("find", "doctor", "flash", "car"),
    "measure": ("calibrate", "record"),
    "model": (),
    "drive": ("drive", "follow", "lane", "map", "localize", "stop", "fleet"),
    "look": ("top",),
    "data": ("replay", "export"),
    "service": ("standby", "parameter"),
}
# Group of the entry points. Each is a mapping like VERBS of another package.
VERB_ENTRY_POINTS = "dart_hal.verbs"


def list_verbs() -> dict[str, tuple[str, str]]:
    """Return by verb what it does and the package of its module, with verbs of other packages.

    An entry point of ``dart_hal.verbs`` is a mapping like ``VERBS`` in the ``__init__`` of a
    package that has one module per verb, each with a click command named ``command``.
    """
    verbs = {name: (text, "dart_hal.cli") for name, text in VERBS.items()}
    for entry in list_plugins(VERB_ENTRY_POINTS).values():
        for name, text in load_entry(entry).items():
            # Verbs of this package win: another package cannot replace ``stop``.
            verbs.setdefault(name, (text, entry.module))
    return verbs


def group_verbs() -> dict[str, dict[str, str]]:
    """Return the verbs and what they do, by the groups of ``dart-hal --help``.

    Another package may put its verbs into groups by a mapping ``VERB_GROUPS`` next to ``VERBS``.
    Verbs without a group are in the last one, "other".
    """
    verbs = {name: text for name, (text, _) in list_verbs().items()}
    others = [import_module(entry.module) for entry in list_plugins(VERB_ENTRY_POINTS).values()]
    tables = [VERB_GROUPS, *(getattr(module, "VERB_GROUPS", {}) for module in others)]
    # The first table that has a verb decides, as in list_verbs.
    group_of: dict[str, str] = {}
    for table in tables:
        for group, names in table.items():
            for name in names:
                group_of.setdefault(name, group if group in VERB_GROUPS else "other")
    return {group: listed for group in (*VERB_GROUPS, "other")
            if (listed := {name: text for name, text in verbs.items()
                           if group_of.get(name, "other") == group})}


def load_command(name: str) -> click.Command | None:
    """Import the command of a verb; None if there is no such verb."""
    package = "dart_hal.cli" if name in VERBS else list_verbs().get(name, ("", ""))[1]
    if not package:
        return None
    command: click.Command = import_module(f"{package}.{name}").command
    return command


class VerbGroup(click.Group):
    """The command ``dart-hal``. Imports a verb's module only when it is run: help stays quick."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(list_verbs())

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        return load_command(name)

    def resolve_command(self, ctx: click.Context, args: list[str]
                        ) -> tuple[str | None, click.Command | None, list[str]]:
        # While the shell completes a line, an unknown verb is no error: it has no completions.
        if (args and not args[0].startswith("-") and not ctx.resilient_parsing
                and self.get_command(ctx, args[0]) is None):
            known = list_verbs()
            close = get_close_matches(args[0], known, n=1)
            raise UsageError(f"there is no verb {args[0]!r}", found=args[0],
                             expected=", ".join(known),
                             remedy=f"dart-hal {close[0]}" if close else "dart-hal --help")
        return super().resolve_command(ctx, args)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Complete a verb from the list, without importing the modules of all verbs."""
        options = click.Command.shell_complete(self, ctx, incomplete)
        return [*(CompletionItem(name, help=text) for name, (text, _) in list_verbs().items()
                  if name.startswith(incomplete)), *options]

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        for group, verbs in group_verbs().items():
            with formatter.section(group.capitalize()):
                formatter.write_dl(list(verbs.items()))


@click.command(cls=VerbGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="dart-hal")
def cli() -> None:
    """Drive, calibrate, record and check DART cars: real, emulated or recorded."""


def main(args: list[str] | None = None) -> None:
    """Run the command line and exit.

    Exit status: 0 done, 1 negative result, 2 usage or input error, 130 Ctrl-C.
    """
    argv = sys.argv[1:] if args is None else args
    # Read here as well: an error of the command line itself has to be JSON, too.
    as_json = "--json" in argv
    verb = next((word for word in argv if not word.startswith("-")), "")
    logger = logging.getLogger("dart_hal")
    # ``main`` may run several times in one process, as in tests: one handler, of this verb.
    logger.handlers = [h for h in logger.handlers if not isinstance(h, NoticeHandler)]
    logger.addHandler(NoticeHandler(verb))
    try:
        sys.exit(cli.main(argv, prog_name="dart-hal", standalone_mode=False) or 0)
    except DartHalError as error:
        # The general remedy of a usage error is made specific.
        if verb and error.remedy == UsageError.remedy_default:
            error.remedy = f"dart-hal {verb} --help"
        _exit_with_error(error, as_json)
    except click.ClickException as error:
        _exit_with_usage_error(error, argv, as_json)
    except (KeyboardInterrupt, click.Abort):
        console.print("stopped")
        sys.exit(CTRL_C_STATUS)
    except OSError as error:
        _exit_with_error(_file_error(error), as_json)
    except MemoryError:
        _exit_with_error(UsageError("not enough memory for this input", found="no memory left",
                                    expected="a file or a range that fits into memory",
                                    remedy="pass fewer files or a shorter range"), as_json)
    except ModuleNotFoundError as error:
        _exit_with_error(_missing_package_error(error), as_json)
    except Exception as error:  # noqa: BLE001 - the user gets one message, no stack trace
        if os.environ.get("DART_HAL_DEBUG"):
            traceback.print_exc()
        _exit_with_error(_internal_error(error), as_json)


class NoticeHandler(logging.Handler):
    """Shows warnings of the library, such as those of arm(), as notices on standard error."""

    def __init__(self, verb: str) -> None:
        super().__init__()
        self._verb = verb

    def filter(self, record: logging.LogRecord) -> bool:
        """Pass all records, but that a simulated car waited for the loop only of ``drive``.

        The waiting concerns the author of a control loop. Only ``drive`` runs a user's loop.
        """
        return self._verb == "drive" or not getattr(record, "waits", False)

    def emit(self, record: logging.LogRecord) -> None:
        show_notices((record.getMessage(),))


def _exit_with_usage_error(error: click.ClickException, argv: list[str], as_json: bool) -> None:
    """Report a usage error that click found, and exit."""
    if as_json:
        _exit_with_error(UsageError(error.format_message(), found=" ".join(argv),
                         remedy="dart-hal --help"), as_json)
    error.show()
    sys.exit(2)


def _missing_package_error(error: ModuleNotFoundError) -> DartHalError:
    """Return the error for a package that an optional part of a verb imports."""
    # A missing module of DART-HAL itself is a mistake here; any other one is an extra.
    package = (error.name or "").partition(".")[0]
    if package in ("", "dart_hal"):
        return _internal_error(error)
    return missing_module_error(package, "this")


def _file_error(error: OSError) -> FileTrouble:
    """Return the error for a file or device that the system refused."""
    name = error.filename if isinstance(error.filename, str) else ""
    reason = error.strerror or str(error)
    return FileTrouble(f"{name}: {reason}" if name else reason,
                       found=f"{type(error).__name__} {error.errno or ''}".strip(), read=name)


def _internal_error(error: Exception) -> InternalError:
    """Return the error for a mistake in DART-HAL, with the line that raised it."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return InternalError(f"{type(error).__name__}: {error}",
                         found=f"{os.path.basename(frame.filename)}, line {frame.lineno}")


def _exit_with_error(error: DartHalError, as_json: bool) -> None:
    """Print an error, as JSON too if requested, and exit with status 2."""
    if as_json:
        print_json({"error": error.as_json()})
    console.print(str(error), style="red", markup=False, highlight=False, soft_wrap=True)
    sys.exit(2)


if __name__ == "__main__":
    main()
