"""``dart-hal doctor``: check every part of a car, in the order in which one debugs."""

from __future__ import annotations

from pathlib import Path

import click
from rich.markup import escape

from dart_hal.cli.common.checks import DoctorCheck, run_checks
from dart_hal.cli.common.options import (
    FiniteNumber,
    camera_option,
    car_options,
    json_option,
    poses_option,
)
from dart_hal.cli.common.output import print_json, results

COLOURS = {"ok": "green", "warn": "yellow", "fail": "red", "skip": "dim"}


@click.command("doctor")
@car_options
@click.option("--seconds", type=FiniteNumber(min=1.0), default=3.0, show_default=True,
              help="seconds of the stream that are checked")
@poses_option
@camera_option
@json_option
def command(url: str | None, car_name: str, cars: Path | None, seconds: float,
            poses: str | None, camera: str | None, as_json: bool) -> int:
    """Check port, firmware, stream, I2C, PCA9685, IMU and encoder; exit 1 if the car cannot drive.

    The car does not move: the pins go to neutral.
    """
    text = url or "sim://"
    checks = run_checks(text, car_name, cars, seconds, poses, camera)
    verdicts = {c.verdict for c in checks}
    verdict = "fail" if "fail" in verdicts else "warn" if "warn" in verdicts else "ok"
    if as_json:
        print_json({"url": text, "checks": [c.as_json() for c in checks], "verdict": verdict})
    else:
        for check in checks:
            print_check(check)
        results.print(verdict_line(checks, verdict))
    return 0 if is_ready(checks, verdict) else 1


def is_ready(checks: list[DoctorCheck], verdict: str) -> bool:
    """Return whether the car would drive."""
    # A warning does not prevent driving, unless arm() would refuse.
    arms = any(c.id == "arming" and c.verdict == "ok" for c in checks)
    return verdict == "ok" or (verdict == "warn" and arms)


def verdict_line(checks: list[DoctorCheck], verdict: str) -> str:
    """Return the last line of the report: whether the car would drive."""
    if verdict == "ok":
        return "no problem found"
    if is_ready(checks, verdict):
        return "the car will drive; see the warnings"
    return "not ready to drive; follow the lines that begin with try"


def print_check(check: DoctorCheck) -> None:
    """Print one line, and for a fault the expected value, the cause and the remedy."""
    results.print(f"[{COLOURS[check.verdict]}]{check.verdict:>4}[/]  {check.title:<22} "
                  f"{escape(check.found)}", highlight=False)
    if check.verdict in ("warn", "fail"):
        for name, value in (("expected", check.expected), ("cause", check.cause),
                            ("try", check.remedy)):
            if value:
                results.print(f"        {name:<8} : {value}", markup=False, highlight=False)
