"""``dart-hal accept``: guided measurements on a new car, each compared with the emulated car."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Sequence
from datetime import datetime, timezone
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

import click
from click.core import ParameterSource

from dart_hal import __version__
from dart_hal.calibration.acceptance import (
    STEP_NAMES,
    STEPS,
    AcceptanceBench,
    AcceptanceOutcome,
    AcceptanceStep,
    Inspector,
    run_step,
    skip_step,
)
from dart_hal.car import Car
from dart_hal.car.car import DEFAULT_URL
from dart_hal.cli.common.bench import TerminalOperator
from dart_hal.cli.common.options import (
    car_options,
    full_option,
    html_option_with_default,
    json_option,
    out_option,
)
from dart_hal.cli.common.output import (
    console,
    count_notices,
    print_json,
    print_line,
    print_verdict,
    progress_bar,
    show_notices,
)
from dart_hal.core.errors import CalibrationFailed, UsageError
from dart_hal.core.plain_json import plain
from dart_hal.core.url import Url
from dart_hal.devices.links.base import open_backend
from dart_lab.pages.accept_page import (
    DIFFERS,
    INTERRUPTED,
    AcceptanceReport,
    write_page,
)
from dart_lab.report.page import write as write_page_text

EMULATED_CAR = "sim://"


class AcceptanceOperator(TerminalOperator):
    """The owner at a real car, who also turns the car and reads instruments."""

    def wheel_turns(self) -> float:
        """Ask for turns by the mark on the tyre."""
        return self._ask("turns of the driven wheel since the car was lifted, by the mark on its "
                         "tyre (two and a quarter: 2.25)")

    def rotate(self, turns: int) -> None:
        """Wait until the car was turned."""
        side = "left" if turns > 0 else "right"
        self._wait(f"turn the car by hand by {abs(turns)} full turns to the {side}, flat on the "
                   "floor, in 10 to 20 s, and let go")

    def read_instrument(self, key: str, question: str) -> float | None:
        """Ask for a reading; an empty answer is none."""
        self._pause()
        value = _ask_reading(question)
        self._resume()
        return value


def _ask_reading(question: str) -> float | None:
    while True:
        text: str = click.prompt(f"{question}; Enter = not measured", default="", err=True,
                                 show_default=False)
        if not text.strip():
            return None
        try:
            value = float(text.replace(",", "."))
        except ValueError:
            value = math.nan
        if math.isfinite(value):
            return value
        console.print(f"{text} is no number")


@click.command("accept")
@car_options
@click.option("--port", default=None, metavar="PORT",
              help="serial port of the Nano, such as /dev/ttyUSB0; the I2C bus is found by itself "
                   "(in place of --url)")
@click.option("--emulator", default=EMULATED_CAR, show_default=True, metavar="URL",
              help="the emulated car that predicts each value")
@click.option("--skip", multiple=True, type=click.Choice(STEP_NAMES),
              help="leave this step out; the report states it")
@click.option("--yes", is_flag=True, help="start every step without a question; on a simulated "
              "car only")
@html_option_with_default(Path("accept.html"))
@out_option(".json", content="the values of the report", replaces=True,
            default=Path("accept.json"))
@full_option
@json_option
def command(url: str | None, car_name: str, cars: Path | None, port: str | None, emulator: str,
            skip: tuple[str, ...], yes: bool, html: Path, out: Path, full: bool,
            as_json: bool) -> int:
    """Check a new car in 15 minutes, each value next to what the emulated car gives.

    The emulated car runs the same steps. Throttle is used only while the wheels are off the ground.
    Nothing is written to the car's files. Send both files to compare your car with others. Exit
    status 1: a step failed.
    """
    text = _choose_url(url, port)
    simulated = Url.parse(text).scheme == "sim"
    _check_urls(text, emulator, simulated, yes)
    steps = [step for step in STEPS if step.name not in skip]
    _check_car(text, car_name, cars)
    # 1. The prediction first: an interrupted check can then be compared, too.
    show_notices((f"predicting each value with {emulator}",))
    with TemporaryDirectory() as folder:
        # A folder of its own: the emulated car is not calibrated by files of the real one.
        predicted, _ = _run_steps(emulator, None, Path(folder), steps, lambda step: "start")
    if any(outcome.reason == INTERRUPTED for outcome in predicted):
        raise click.Abort
    # 2. The car itself. After Ctrl-C what was measured is reported, too.
    measured, about = _run_steps(text, car_name, cars, steps, _announce if yes else _ask_start)
    outcomes = {outcome.step.name: outcome for outcome in measured}
    report = AcceptanceReport(
        tuple(outcomes.get(step.name) or skip_step(step, "--skip") for step in STEPS),
        tuple(predicted),
        {**about, "emulator": emulator, "dart_hal": __version__,
         "when": datetime.now(timezone.utc).isoformat(timespec="seconds")})
    # 3. The report.
    answer = report.to_json()
    write_page(report, html, answer)
    write_page_text(out, json.dumps(plain(answer), indent=1, allow_nan=False) + "\n")
    if as_json:
        print_json({**answer, "page": str(html), "file": str(out)})
    else:
        _print_report(report, full)
        console.print(f"report: {html}, {out}", markup=False, highlight=False)
    if report.is_interrupted:
        raise click.Abort
    return 1 if report.has_failed else 0


def _choose_url(url: str | None, port: str | None) -> str:
    """Return the URL of the car. Raises UsageError for a port and a URL."""
    if port is None:
        return url or DEFAULT_URL
    source = click.get_current_context().get_parameter_source("url")
    if source is ParameterSource.COMMANDLINE:
        raise UsageError("--port and --url both name the car", found=f"{port} and {url}",
                         expected="one of them", remedy=f"dart-hal accept --port {port}")
    return f"serial://{port}?i2c=auto"


def _check_urls(car: str, emulator: str, simulated: bool, yes: bool) -> None:
    """Raise UsageError for a recording, for a real car with --yes, and for a real emulator."""
    if Url.parse(car).scheme == "replay":
        raise UsageError("a recording cannot be measured again", found=car,
                         expected="a car with its I2C bus",
                         remedy="dart-hal accept --port /dev/ttyUSB0")
    if yes and not simulated:
        raise UsageError("--yes starts steps without a question, and a real car spins its wheels",
                         found=f"--yes with {car}", expected="--yes with sim://",
                         remedy="the same command without --yes")
    if Url.parse(emulator).scheme != "sim":
        raise UsageError("--emulator names no emulated car", found=emulator,
                         expected="sim:// or sim://?seed=7", remedy="leave --emulator out")


def _check_car(url: str, car_name: str | None, cars: Path | None) -> None:
    """Open the car once, so that a wrong port is reported before the prediction takes its time.

    Raises UsageError for a car without actuators, and what opening a car raises.
    """
    with Car.over(open_backend(url), car=car_name, cars=cars) as car:
        if not car.drives:
            raise UsageError(f"{url} has no actuators", expected="a car with its I2C bus",
                             remedy="dart-hal accept --port /dev/ttyUSB0")


def _run_steps(url: str, car_name: str | None, cars: Path | None,
               steps: Sequence[AcceptanceStep], start: Callable[[AcceptanceStep], str]
               ) -> tuple[list[AcceptanceOutcome], dict[str, Any]]:
    """Run the steps on a car; return outcomes and what the car reports about itself.

    start: returns "start", "skip" or "quit". After Ctrl-C or "quit" the other steps are skipped;
    the throttle is neutral.
    """
    backend = open_backend(url)
    outcomes: list[AcceptanceOutcome] = []
    with Car.over(backend, car=car_name, cars=cars) as car, progress_bar() as bar:
        task = bar.add_task("", total=1.0)

        def progress(fraction: float, text: str) -> None:
            bar.update(task, completed=fraction, description=text)

        # A simulated car has a workshop that answers; a person answers for a real one.
        inspector = cast("Inspector | None", backend.workshop) or AcceptanceOperator(
            bar.stop, bar.start)
        bench = AcceptanceBench(car, inspector, progress)
        about = {"url": url, "car": car.files.config.name, "board": f"{car.hello.board_id:08x}",
                 "firmware": ".".join(map(str, car.hello.version)), "mock": car.hello.mock,
                 "notices": list(car.notices)}
        try:
            for step in steps:
                bar.stop()
                answer = start(step)
                bar.start()
                # "quit" ends the check as Ctrl-C does: what was measured is still written.
                if answer == "quit":
                    raise KeyboardInterrupt
                outcomes.append(run_step(step, bench) if answer == "start" else
                                skip_step(step, "skipped by the operator"))
        except (KeyboardInterrupt, click.Abort):
            car.stop()
            outcomes += [skip_step(step, INTERRUPTED) for step in steps[len(outcomes):]]
    return outcomes, about


def _announce(step: AcceptanceStep) -> str:
    """Show a step; start it."""
    console.print(f"{step.title}: {step.task}", markup=False, highlight=False)
    return "start"


def _ask_start(step: AcceptanceStep) -> str:
    """Show a step and ask whether it starts. Raises CalibrationFailed without a terminal."""
    _announce(step)
    # Without a terminal there is no operator to confirm that the wheels are free.
    if not sys.stdin.isatty():
        raise CalibrationFailed("not started: not confirmed", found="no terminal",
                                expected="an operator at the car",
                                remedy="run it in a terminal; for a simulated car: --yes")
    answer: str = click.prompt("start this step", type=click.Choice(["start", "skip", "quit"]),
                               default="start", err=True)
    return answer


def _print_report(report: AcceptanceReport, full: bool) -> None:
    """Print verdict, steps and first step in three lines, then a line for each step.

    Below a step are the values that differ from the prediction; full: every value and notice.
    """
    agreement = report.describe_agreement()
    print_verdict(f"{agreement[:1].upper()}{agreement[1:]}.", report.describe_steps(),
                  report.first_step(), "bold red" if report.has_failed else "bold")
    for outcome in report.outcomes:
        print_line(f"  {outcome.step.title}: {report.describe_status(outcome)}")
        for row in report.rows(outcome):
            if full or row[-1] == DIFFERS:
                print_line(f"    {row[0]:<60} {row[1]:>22} {row[2]:>22}  {row[3]}")
    count_notices(tuple(report.about["notices"]), full)
