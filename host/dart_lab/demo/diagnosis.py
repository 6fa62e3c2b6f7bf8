"""The demo's last chapter: two things are changed in the car, and the diagnosis has to name them.

What it may use is what the owner of a car has: a drive from before, one from
after, the paper's model and the servo's data sheet. What was changed stands in
the URL, which only the simulator reads.
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
from dart_hal.vehicle.effects import apply, parse
from dart_hal.vehicle.file import model_of
from dart_hal.vehicle.load import find_model
from dart_lab.diagnosis import diagnose
from dart_lab.diagnosis.inputs import check_inputs
from dart_lab.diagnosis.report import write_page
from dart_lab.diagnosis.report.words import quantity
from dart_lab.diagnosis.result import Diagnosis, ParameterEstimate
from dart_lab.diagnosis.write import extended_model

MISSING: Mapping[str, tuple[float, float, bool]] = {
    "steering_backlash": (0.05, 0.08, False), "throttle_lag": (0.08, 0.16, False),
    "steering_lag": (0.08, 0.12, False)}
"""Effect that the model has not: least and largest size in its own unit, and whether it has
either sign. All show in what encoder and gyro read: a simulated car has no motion capture."""
WRONG: Mapping[str, tuple[float, float, bool]] = {
    "steering_trim": (0.02, 0.03, True), "motor_gain": (0.08, 0.12, True),
    "front_grip": (-0.25, -0.15, False)}
"""Parameter that the model has and that is another one now: as in ``MISSING``."""
STANDING = 3.0  # s
BEFORE, AFTER, UNSEEN = 80.0, 60.0, 60.0
"""s of driving: the car as it was; changed, to find the cause in; changed, to measure the gain."""
TURNS, TURN_SECONDS = 0.9, (0.4, 2.0)  # steering command, s that one is held
PULLS, PULL_SECONDS, ROLLING = (0.2, 0.3), 1.5, 0.12  # throttle, s, share of them without any
FRAME_WAIT = 0.0115
"""s from a command to the pulse, on average: half a frame of the PWM, and the pulse itself."""
MAX_CAUSES = 3
"""Causes: the demo has to end; ``dart-hal diagnose`` on its files looks for more."""
SERVO_S = 0.1
"""s from the middle to full lock: 375 us at the 6 rad/s of the servo's data sheet."""


@dataclass(frozen=True, slots=True)
class Chapter:
    """What was hidden, what the diagnosis made of it, and the files on the way, by name."""

    hidden: tuple[ActiveEffect, ...]
    diagnosis: Diagnosis
    files: Mapping[str, Path]

    @property
    def found(self) -> bool:
        """Whether everything hidden is named, or stands beside a named one that is like it."""
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


def without_effect(url: Url) -> str:
    """The same car before anything was changed in it."""
    return _text(url, {k: v for k, v in url.options.items() if k != "effect"})


def hide(url: Url, seed: int) -> tuple[str, tuple[ActiveEffect, ...]]:
    """(URL of the changed car, what was changed): as the URL says, else drawn from its seed.

    Errors: UsageError, ConfigError for an effect of the URL that there is not.
    """
    given = url.options.get("effect", "")
    if not given:
        rng = np.random.default_rng([seed, 2])
        given = ",".join(_drawn(rng, table) for table in (MISSING, WRONG))
    return _text(url, {**url.options, "effect": given}), parse(given)


def _drawn(rng: np.random.Generator, table: Mapping[str, tuple[float, float, bool]]) -> str:
    """"steering_lag:0.1": one of the table at a size within its bounds."""
    name = list(table)[int(rng.integers(len(table)))]
    low, high, signed = table[name]
    size = float(rng.uniform(low, high)) * (-1.0 if signed and rng.random() < 0.5 else 1.0)
    return f"{name}:{size:.3g}"


def _text(url: Url, options: Mapping[str, str]) -> str:
    tail = urlencode(options, safe=":,=/")
    return f"{url.scheme}://{url.target}" + (f"?{tail}" if tail else "")


def chapter(url: Url, seed: int, out: Path) -> Chapter:
    """Drive, change the car, drive again, diagnose; the report goes to ``out``."""
    files = {"first_drive": out / "before.mcap", "second_drive": out / "after.mcap",
             "third_drive": out / "unseen.mcap",
             "healthy_model": out / "healthy.toml", "diagnosis": out / "diagnosis.html"}
    changed, hidden = hide(url, seed)
    cars, second, third = out / "cars", files["second_drive"], files["third_drive"]
    weave(without_effect(url), cars, files["first_drive"], BEFORE, 1)
    fit = jobs.beside(healthy_model, files["first_drive"], files["healthy_model"])
    weave(changed, cars, second, AFTER, 2)
    weave(changed, cars, third, UNSEEN, 3)
    with progress_bar() as bar:
        bar.add_task("fitting the model to drive 1", total=None)
        next(fit)
    found = told(second, third, files["healthy_model"])
    write_page(found, files["diagnosis"],
               command=f"dart-hal diagnose --model {files['healthy_model']} --no-refit "
                       f"--max-causes {MAX_CAUSES} --train {second} --test {third} "
                       f"--html {files['diagnosis']}")
    return Chapter(hidden, found, files)


def weave(url: str, cars: Path, run: Path, seconds: float, draw: int) -> None:
    """Steps of steering and throttle at random times, recorded; draw: which ones."""
    rng = np.random.default_rng([draw, 3])
    title = f"drive {draw} of 3, {run.stem}"
    with Car.open(url, cars=cars, record=run) as car:
        for _ in car.states(duration=STANDING):  # what sensors read at rest
            pass
        car.arm()
        turn = pull = steering = throttle = 0.0
        for i, _ in enumerate(with_progress(car.states(duration=seconds), seconds, title)):
            t = 0.01 * i
            if t >= pull:
                throttle = rng.uniform(*PULLS) * (rng.random() > ROLLING)
                pull = t + PULL_SECONDS
            if t >= turn:
                steering = rng.uniform(-TURNS, TURNS)
                turn = t + rng.uniform(*TURN_SECONDS)
            car.drive(steering=steering, throttle=throttle)


def healthy_model(run: Path, target: Path) -> None:
    """The paper's model with the servo's data sheet, fitted to a drive of the car as it was."""
    file, p = find_model("paper")
    timing = replace(p.delay, steering_s=FRAME_WAIT, throttle_s=FRAME_WAIT)
    p = apply(replace(p, delay=timing), "steering_rate_limit", k=SERVO_S)
    sheet = model_of(p, file)
    sides = check_inputs([read_run(run)], [], p)
    fitted = diagnose(sheet, p, sides.train, sides.test, max_causes=0)
    model = extended_model(fitted, sheet, sides.train, "dart-hal demo")
    save_model(msgspec.structs.replace(model, name=target.stem), target)


def told(run: Path, unseen: Path, model: Path) -> Diagnosis:
    """The diagnosis of a drive; the gain is measured on another one."""
    file, p = find_model(model)
    with progress_bar() as bar:
        task = bar.add_task("looking for the cause", total=1.0)
        sides = check_inputs([read_run(run)], [read_run(unseen)], p)
        found = diagnose(file, p, sides.train, sides.test, refit=False, max_causes=MAX_CAUSES,
                         jobs=jobs.cores(),
                         progress=lambda share, _: bar.update(task, completed=share))
    return replace(found, model=model.name, notes=(*sides.notes, *found.notes))


def as_hidden(a: ActiveEffect) -> str:
    """"steering_lag, k 0.06 s"."""
    return f"{a.name}, {values_of(a)}"


def values_of(a: ActiveEffect) -> str:
    """"k 0.06 s": every parameter that is not at its null."""
    return ", ".join(f"{q.name} {quantity(ParameterEstimate(v, 0.0, q.unit))}"
                     for q, v in zip(a.effect.parameters, a.values, strict=True) if v != q.null)


