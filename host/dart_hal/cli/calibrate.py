"""``dart-hal calibrate``: measure this car and write calibration.toml."""

from __future__ import annotations

from pathlib import Path

import click

from dart_hal.calibration import order
from dart_hal.cli.common.bench import confirm
from dart_hal.cli.common.calibrate_all import everything
from dart_hal.cli.common.options import car_options, json_option
from dart_hal.cli.common.output import print_json, results
from dart_hal.cli.common.procedures import command_of
from dart_hal.cli.common.session import open_car
from dart_hal.core.config import accept_board


class _Calibrations(click.Group):
    """Our procedures, and those of other packages as far as they are asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted({*self.commands, *order.list_names()})

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name in self.commands or name not in order.list_names():
            return self.commands.get(name)
        return command_of(order.load_procedure(name))


@click.group("calibrate", cls=_Calibrations)
def command() -> None:
    """Measure this car and write calibration.toml."""


command.add_command(everything)
for verb in order.PROCEDURE_NAMES:
    command.add_command(command_of(order.load_procedure(verb)))


@command.command("accept-board")
@car_options
@click.option("--yes", is_flag=True, help="do not ask (for scripts)")
@json_option
def accept(url: str | None, car_name: str, cars: Path | None, yes: bool, as_json: bool) -> None:
    """Use the car's calibration with the Nano that answers now, after that was exchanged.

    A car with another Nano than that of calibration.toml does not arm. Accept it if servo, ESC and
    their board are unchanged.
    """
    with open_car(url, car_name, cars) as car:
        files = car.files
    question = (f"Board {files.board} gets the calibration of {files.config.name}. Servo, ESC and "
                "PCA9685 must be those that were measured.")
    if not (car.url.startswith("sim:") or confirm(question, yes, "accept")):
        raise click.Abort
    before, written = accept_board(files)
    if as_json:
        print_json({"car": files.config.name, "board": files.board, "before": before,
                    "written": str(written)})
        return
    results.print(f"{written}: board {files.board} (was {before or 'not recorded'})", markup=False)
