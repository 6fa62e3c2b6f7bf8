"""``dart-hal doctor``: every link of the chain, in the order in which one debugs."""

from __future__ import annotations

from pathlib import Path

import click
from rich.markup import escape

from dart_hal.cli.common.checks import Check, examine
from dart_hal.cli.common.options import (
    Number,
    camera_option,
    car_options,
    json_option,
    poses_option,
)
from dart_hal.cli.common.output import print_json, results

COLOURS = {"ok": "green", "warn": "yellow", "fail": "red", "skip": "dim"}


@click.command("doctor")
@car_options
@click.option("--seconds", type=Number(min=1.0), default=3.0, show_default=True,
              help="how long to listen to the stream")
@poses_option
@camera_option
@json_option
def command(url: str | None, car_name: str, cars: Path | None, seconds: float,
            poses: str | None, camera: str | None, as_json: bool) -> int:
    """Check port, firmware, stream, I2C, PCA9685, IMU and encoder; exit 1 if it would not drive.

    The wheels are not driven; the pins go to neutral.
    """
    text = url or "sim://"
    checks = examine(text, car_name, cars, seconds, poses, camera)
    verdicts = {c.verdict for c in checks}
    verdict = "fail" if "fail" in verdicts else "warn" if "warn" in verdicts else "ok"
    if as_json:
        print_json({"url": text, "checks": [c.as_json() for c in checks], "verdict": verdict})
    else:
        for check in checks:
            show(check)
        results.print(closing(checks, verdict))
    return 0 if ready(checks, verdict) else 1


def ready(checks: list[Check], verdict: str) -> bool:
    """Whether the car would drive."""
    arms = any(c.id == "arming" and c.verdict == "ok" for c in checks)
    return verdict == "ok" or (verdict == "warn" and arms)


def closing(checks: list[Check], verdict: str) -> str:
    """The last line: whether the car would drive."""
    if verdict == "ok":
        return "all well"
    if ready(checks, verdict):
        return "it will drive; see the warnings"
    return "not ready to drive; see above what to type"


def show(check: Check) -> None:
    """One line, and for a fault what was expected and what to type."""
    results.print(f"[{COLOURS[check.verdict]}]{check.verdict:>4}[/]  {check.title:<22} "
                  f"{escape(check.found)}", highlight=False)
    if check.verdict in ("warn", "fail"):
        for name, value in (("expected", check.expected), ("cause", check.cause),
                            ("try", check.remedy)):
            if value:
                results.print(f"        {name:<8} : {value}", markup=False, highlight=False)
