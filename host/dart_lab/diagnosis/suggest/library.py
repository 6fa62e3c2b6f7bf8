"""Library of drives that can be suggested: experiments, once or twice, as command series.

The experiments command a duty cycle. For a car with a speed loop they are rehearsed with a motor of
duty on the same body; the commanded speed is then the speed of that drive, and 0 where it coasts.
So the path needs the same floor.

Floor, speeds and times of the experiments are those of a car of 1:10. For a car of another size a
similar car of that size is rehearsed (``dart_hal.vehicle.scale``), and its commands are stretched
in time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from dart_hal.core.config import CarFiles, ModelFile, parse_car
from dart_hal.core.errors import ExperimentFailed
from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.file import model_of
from dart_hal.vehicle.flat import unit, values, with_values
from dart_hal.vehicle.load import vehicle_of
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.scale import REFERENCE_SCALE, Scale, SizedBody, find_scale
from dart_hal.vehicle.sets import PAPER
from dart_lab.identification.experiment.floor import Floor

from .virtual import VirtualCommands

# [m] Side of the floor for a car of 1:10, if none is given.
FLOOR_SIDE = 10.0
Progress = Callable[[float, str], None]
REST_S = 0.5  # standstill before and after
QUARTER_TURN = 0.5 * np.pi  # rad


@dataclass(frozen=True, slots=True)
class Part:
    """One experiment of a drive. yaw [rad]: heading of the car relative to the first part.

    battery: medium sizes by which a level that may differ between recordings is lower.
    """

    experiment: str
    yaw: float = 0.0
    battery: float = 0.0


@dataclass(frozen=True, slots=True)
class Choice:
    """A drive: its name, description and parts."""

    name: str
    description: str
    parts: tuple[Part, ...]


@dataclass(frozen=True, slots=True)
class RehearsedDrive:
    """A choice on a floor: commands of each part, shell commands, and duration.

    shell_commands: empty for a car with a speed loop or of another size than 1:10, which `dart-hal
    experiment` does not drive.
    """

    choice: Choice
    commands: tuple[VirtualCommands, ...]
    shell_commands: tuple[str, ...]
    seconds: float


CIRCLES = Part("circles")
LAUNCH = Part("launch")
ROLLOUTS = Part("rollouts")
# The shortest first, on a floor of 10 m x 10 m.
CHOICES: tuple[Choice, ...] = (
    Choice("standstill", "standing still for ten seconds", (Part("standstill"),)),
    Choice("rollouts", "accelerating and coasting on circles of two radii to both sides",
           (ROLLOUTS,)),
    Choice("weave", "a chirp of the steering at speed", (Part("weave"),)),
    Choice("staircase", "the steering up and down in steps at constant low speed",
           (Part("staircase"),)),
    Choice("rollouts-battery", "the roll-outs twice, with a full and a half empty battery",
           (ROLLOUTS, replace(ROLLOUTS, battery=1.0))),
    Choice("laps", "laps of an oval at constant speed", (Part("laps"),)),
    Choice("circles", "circles of two radii to the left and to the right, slow and fast",
           (CIRCLES,)),
    Choice("tyres", "slow throttle ramps on a circle to each side", (Part("tyres"),)),
    Choice("crawl", "rolling slowly and steadily, round to both sides", (Part("crawl"),)),
    Choice("launch", "hard throttle from standstill at rising levels, coasting down, on a straight",
           (LAUNCH,)),
    Choice("steps", "small and large steps of the steering at two speeds", (Part("steps"),)),
    Choice("circles-turned", "the circles twice, the car turned by 90 degrees between",
           (CIRCLES, replace(CIRCLES, yaw=QUARTER_TURN))),
    Choice("launch-turned", "the launch twice, the car turned by 90 degrees between",
           (LAUNCH, replace(LAUNCH, yaw=QUARTER_TURN))),
    Choice("friction", "throttle to several speeds and coasting down, on a straight",
           (Part("friction"),)),
    Choice("motor", "throttle steps of many levels and coasting down, on a straight",
           (Part("motor"),)),
    Choice("delay", "throttle steps; sine, chirp and steps of the steering", (Part("delay"),)))


def default_floor(body: SizedBody) -> Floor:
    """Return the floor of a car of that size: 10 m x 10 m at 1:10.

    >>> from dart_hal.vehicle import PAPER
    >>> str(default_floor(PAPER.body))
    '10 m x 10 m'
    """
    side = FLOOR_SIDE * find_scale(body).length
    return Floor(side, side)


def rehearse_choices(floor: Floor, model: ModelFile | None = None,
                     choices: tuple[Choice, ...] = CHOICES) -> Iterator[RehearsedDrive]:
    """Iterate over the choices that fit on the floor.

    model: of the car that drives; None = the paper's.
    """
    car = None if model is None else vehicle_of(model)
    scale = REFERENCE_SCALE if car is None else find_scale(car.body)
    is_speed = car is not None and car.drive == "speed"
    if car is not None and (is_speed or scale != REFERENCE_SCALE):
        duty = _with_duty_motor(car) if is_speed else car
        files = _files(model_of(_similar_car(duty, scale)))
    else:
        files = _files(model)
    similar_floor = Floor(floor.length / scale.length, floor.width / scale.length)
    commands_by_name: dict[str, VirtualCommands | None] = {}
    for choice in choices:
        for part in choice.parts:
            if part.experiment not in commands_by_name:
                commands_by_name[part.experiment] = (
                    _paper_commands(part.experiment, floor) if model is None
                    else _commands(part.experiment, files, similar_floor, is_speed, scale))
        commands = [c for part in choice.parts
                    if (c := commands_by_name[part.experiment]) is not None]
        if len(commands) == len(choice.parts):
            yield RehearsedDrive(choice, tuple(commands),
                                 () if is_speed or scale.length != 1.0
                                 else shell_commands(choice, floor),
                                 sum(c.seconds for c in commands))


def _similar_car(p: Vehicle, scale: Scale) -> Vehicle:
    """Return the car of 1:10 whose motion is similar to that of a car of that scale."""
    if scale == REFERENCE_SCALE:
        return p
    return with_values(p, {name: number / scale.factor(unit(p, name))
                           for name, number in values(p).items()})


def _with_duty_motor(p: Vehicle) -> Vehicle:
    """Return the car with the paper's motor and friction, scaled to its mass."""
    scale = p.body.mass / PAPER.body.mass
    motor = replace(PAPER.duty_motor, d=scale * PAPER.duty_motor.d, e=scale * PAPER.duty_motor.e)
    friction = replace(PAPER.friction, a=scale * PAPER.friction.a, c=scale * PAPER.friction.c)
    return replace(p, motor=motor, friction=friction)


def shell_commands(choice: Choice, floor: Floor) -> tuple[str, ...]:
    """Shell commands that drive and record a choice; a real car needs --url in addition."""
    lines = []
    for i, part in enumerate(choice.parts):
        run = f"runs/{choice.name}{f'-{i + 1}' if len(choice.parts) > 1 else ''}.mcap"
        lines.append(f"dart-hal experiment {part.experiment} --space {floor.length:g}x"
                     f"{floor.width:g} --no-fit --out {run}")
    return tuple(lines)


@lru_cache(maxsize=64)
def _paper_commands(name: str, floor: Floor) -> VirtualCommands | None:
    return _commands(name, _files(None), floor)


def _files(model: ModelFile | None) -> CarFiles:
    """Files of the simulated car with public parameters: the same on every computer."""
    from dart_lab.sim.car_file import typical_car_toml

    files = parse_car(typical_car_toml(), "the simulated car")
    return replace(files, calibration=None, model=model)


def _commands(name: str, files: CarFiles, floor: Floor, is_speed: bool = False,
              scale: Scale = REFERENCE_SCALE) -> VirtualCommands | None:
    """Rehearse an experiment and return its commands; None if it does not fit.

    is_speed: commanded speeds [m/s] in place of throttles. scale: of the car that drives; the
    rehearsal is that of the similar car of 1:10.
    """
    # Imported here because it takes 0.3 s, and every diagnosis loads this module.
    from dart_lab.identification.experiment.make import make_plan
    from dart_lab.identification.experiment.rehearsal import rehearse_plan

    try:
        _, drive = rehearse_plan(make_plan(name, files, floor, None), files)
    except ExperimentFailed:
        return None
    t = np.array([f.t for f in drive.frames]) * scale.time
    grid = np.arange(0.0, t[-1], SAMPLE)
    index = np.clip(np.searchsorted(t, grid, side="right") - 1, 0, len(t) - 1)

    def series(values: list[float]) -> FloatArray:
        rest = np.zeros(round(REST_S / SAMPLE))
        return np.concatenate([rest, np.array(values)[index], rest])

    throttle = [(f.speed * scale.speed if f.throttle > 0.0 else 0.0) if is_speed else f.throttle
                for f in drive.frames]
    return VirtualCommands(series(throttle), series([f.steering for f in drive.frames]))
