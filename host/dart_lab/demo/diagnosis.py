"""Chapter of the demo on the diagnosis: two hidden changes of the car, which it has to find.

It uses what the owner of a car has: a drive from before and one from after the change, the paper's
model, and the data sheet of the servo. The changes are in the URL, which only the simulator reads.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import msgspec
import numpy as np

from dart_hal.car import Car
from dart_hal.car.runs import read_run
from dart_hal.cli.common.output import progress_bar
from dart_hal.cli.common.session import with_progress
from dart_hal.core.config import save_model
from dart_hal.core.process import jobs
from dart_hal.core.url import Url
from dart_hal.vehicle.effect import ActiveEffect
from dart_hal.vehicle.effects import apply, parse_effects
from dart_hal.vehicle.file import model_of
from dart_hal.vehicle.load import find_model
from dart_lab.diagnosis import diagnose
from dart_lab.diagnosis.inputs import check_inputs
from dart_lab.diagnosis.report import write_page
from dart_lab.diagnosis.report.words import quantity
from dart_lab.diagnosis.result import Diagnosis, ParameterEstimate
from dart_lab.diagnosis.write import extended_model

# Effect that the model lacks: smallest and largest size in its own unit, and whether it has either
# sign. All show in encoder and gyro: a simulated car has no motion capture.
MISSING_EFFECTS: Mapping[str, tuple[float, float, bool]] = {
    "steering_backlash": (0.05, 0.08, False), "throttle_lag": (0.08, 0.16, False),
    "steering_lag": (0.08, 0.12, False)}
# Parameter of the model that has changed: as in ``MISSING_EFFECTS``.
WRONG_PARAMETERS: Mapping[str, tuple[float, float, bool]] = {
    "steering_trim": (0.02, 0.03, True), "motor_gain": (0.08, 0.12, True),
    "front_grip": (-0.25, -0.15, False)}
STANDSTILL_S = 3.0
# The car as it was; changed, to find the cause; changed, to measure the gain.
FIRST_DRIVE_S = 80.0
SECOND_DRIVE_S = 60.0
THIRD_DRIVE_S = 60.0
MAX_STEERING = 0.9  # command
STEERING_INTERVAL_S = (0.4, 2.0)  # between steps of the steering
THROTTLE_RANGE = (0.2, 0.3)  # command
THROTTLE_INTERVAL_S = 1.5  # between steps of the throttle
COASTING_SHARE = 0.12  # of the throttle steps are to zero
# Mean time from a command to the pulse: half a PWM frame, and the pulse itself.
FRAME_WAIT_S = 0.0115
# Causes: limits the time of the demo. ``dart-hal diagnose`` on its files searches for more.
MAX_CAUSES = 3
# s from the middle to full lock: 375 us at the 6 rad/s of the servo's data sheet.
SERVO_S = 0.1


@dataclass(frozen=True, slots=True)
class DiagnosisChapter:
    """What was hidden, the diagnosis, and the files by name."""

    hidden: tuple[ActiveEffect, ...]
    diagnosis: Diagnosis
    files: Mapping[str, Path]

    @property
    def found(self) -> bool:
        """Check that every hidden effect is accepted, or confounded with an accepted one."""
        names = {n for c in self.diagnosis.causes for n in (c.effect, *c.cannot_be_told_from)}
        return all(a.name in names for a in self.hidden)

    def to_json(self) -> dict[str, Any]:
        """{"hidden": [..], "verdict", "causes": as diagnose prints them, "named": bool}."""
        return {"hidden": [{"effect": a.name,
                            "parameters": {q.name: {"value": v, "unit": q.unit} for q, v in
                                           zip(a.effect.parameters, a.values, strict=True)}}
                           for a in self.hidden],
                "verdict": self.diagnosis.verdict, "named": self.found,
                "causes": [c.to_json() for c in self.diagnosis.causes]}


def remove_hidden_effects(url: Url) -> str:
    """URL of the same car without changes."""
    return _format_url(url, {k: v for k, v in url.options.items() if k != "effect"})


def choose_hidden_effects(url: Url, seed: int) -> tuple[str, tuple[ActiveEffect, ...]]:
    """Return the URL of the changed car and its changes: of the URL, otherwise drawn from its seed.

    Errors: UsageError, ConfigError for an unknown effect in the URL.
    """
    given = url.options.get("effect", "")
    if not given:
        rng = np.random.default_rng([seed, 2])
        given = ",".join(_draw_effect(rng, table) for table in (MISSING_EFFECTS, WRONG_PARAMETERS))
    return _format_url(url, {**url.options, "effect": given}), parse_effects(given)


def _draw_effect(rng: np.random.Generator, table: Mapping[str, tuple[float, float, bool]]) -> str:
    """Draw an effect of the table and a size within its bounds: "steering_lag:0.1"."""
    name = list(table)[int(rng.integers(len(table)))]
    low, high, signed = table[name]
    size = float(rng.uniform(low, high)) * (-1.0 if signed and rng.random() < 0.5 else 1.0)
    return f"{name}:{size:.3g}"


def _format_url(url: Url, options: Mapping[str, str]) -> str:
    """Format a URL with other options."""
    tail = urlencode(options, safe=":,=/")
    return f"{url.scheme}://{url.target}" + (f"?{tail}" if tail else "")


def run_chapter(url: Url, seed: int, out: Path) -> DiagnosisChapter:
    """Drive, change the car, drive again, and diagnose; the report is written to ``out``."""
    files = {"first_drive": out / "before.mcap", "second_drive": out / "after.mcap",
             "third_drive": out / "unseen.mcap",
             "healthy_model": out / "healthy.toml", "diagnosis": out / "diagnosis.html"}
    changed, hidden = choose_hidden_effects(url, seed)
    cars = out / "cars"
    second = files["second_drive"]
    third = files["third_drive"]
    record_drive(remove_hidden_effects(url), cars, files["first_drive"], FIRST_DRIVE_S, 1)
    # The model is fitted in another process during the next two drives.
    fit = jobs.start_in_background(fit_healthy_model, files["first_drive"], files["healthy_model"])
    record_drive(changed, cars, second, SECOND_DRIVE_S, 2)
    record_drive(changed, cars, third, THIRD_DRIVE_S, 3)
    with progress_bar() as bar:
        bar.add_task("fitting the model to drive 1", total=None)
        next(fit)
    found = diagnose_drive(second, third, files["healthy_model"])
    write_page(found, files["diagnosis"],
               command=f"dart-hal diagnose --model {files['healthy_model']} --no-refit "
                       f"--max-causes {MAX_CAUSES} --train {second} --test {third} "
                       f"--html {files['diagnosis']}")
    return DiagnosisChapter(hidden, found, files)


def record_drive(url: str, cars: Path, run: Path, seconds: float, draw: int) -> None:
    """Record steps of steering and throttle at random times; draw: seed of the steps."""
    rng = np.random.default_rng([draw, 3])
    title = f"drive {draw} of 3, {run.stem}"
    with Car.open(url, cars=cars, record=run) as car:
        for _ in car.states(duration=STANDSTILL_S):  # offsets of the sensors at rest
            pass
        car.arm()
        next_steering = next_throttle = steering = throttle = 0.0
        for i, _ in enumerate(with_progress(car.states(duration=seconds), seconds, title)):
            t = 0.01 * i
            if t >= next_throttle:
                throttle = rng.uniform(*THROTTLE_RANGE) * (rng.random() > COASTING_SHARE)
                next_throttle = t + THROTTLE_INTERVAL_S
            if t >= next_steering:
                steering = rng.uniform(-MAX_STEERING, MAX_STEERING)
                next_steering = t + rng.uniform(*STEERING_INTERVAL_S)
            car.drive(steering=steering, throttle=throttle)


def fit_healthy_model(run: Path, target: Path) -> None:
    """Fit the paper's model, with the data sheet of the servo, to a drive of the unchanged car."""
    file, p = find_model("paper")
    timing = replace(p.delay, steering_s=FRAME_WAIT_S, throttle_s=FRAME_WAIT_S)
    p = apply(replace(p, delay=timing), "steering_rate_limit", k=SERVO_S)
    sheet = model_of(p, file)
    sides = check_inputs([read_run(run)], [], p)
    fitted = diagnose(sheet, p, sides.train, sides.test, max_causes=0)
    model = extended_model(fitted, sheet, sides.train, "dart-hal demo")
    save_model(msgspec.structs.replace(model, name=target.stem), target)


def diagnose_drive(run: Path, test_run: Path, model: Path) -> Diagnosis:
    """Diagnose a drive; the gain is measured on another one."""
    file, p = find_model(model)
    with progress_bar() as bar:
        task = bar.add_task("looking for the cause", total=1.0)
        sides = check_inputs([read_run(run)], [read_run(test_run)], p)
        found = diagnose(file, p, sides.train, sides.test, refit=False, max_causes=MAX_CAUSES,
                         jobs=jobs.cores(),
                         progress=lambda share, _: bar.update(task, completed=share))
    return replace(found, model=model.name, notes=(*sides.notes, *found.notes))


def describe_effect(a: ActiveEffect) -> str:
    """Describe an effect: "steering_lag, k 0.06 s"."""
    return f"{a.name}, {describe_values(a)}"


def describe_values(a: ActiveEffect) -> str:
    """Describe the parameters of an effect that are not at their null: "k 0.06 s"."""
    return ", ".join(f"{q.name} {quantity(ParameterEstimate(v, 0.0, q.unit))}"
                     for q, v in zip(a.effect.parameters, a.values, strict=True) if v != q.null)


