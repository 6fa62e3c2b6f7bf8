"""Configuration of DartCar-v0, and the parameters that a reset draws."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from dart_hal.control import paths
from dart_hal.core.errors import UsageError
from dart_hal.core.numbers import is_number
from dart_hal.vehicle import Vehicle
from dart_hal.vehicle.flat import names, value, with_values
from dart_lab.sim.light.car import DEFAULT
from dart_lab.sim.light.config import (
    DART_ACTUATORS,
    FIRMWARE,
    Disturbance,
    LightConfig,
    whole_steps,
)

TASKS = ("path", "speed")
MAX_BEAMS = 720
MAX_OPPONENTS = 8
# Sensors as the firmware gives them, servo and PWM, a force of 0.12 N over 0.15 s.
REALISTIC = LightConfig(sensors=FIRMWARE, actuators=DART_ACTUATORS,
                        disturbance=Disturbance(0.12, 0.12, 0.15))

# Half widths relative to the nominal value, of ``options={"randomise": True}``.
SPREAD: dict[str, float] = {
    "body.mass": 0.05, "body.yaw_inertia": 0.15, "friction.a": 0.15, "friction.c": 0.15,
    "motor.d": 0.10, "motor.e": 0.10, "steering.k_left": 0.08, "steering.k_right": 0.08,
    "tyres.front_D": 0.15, "tyres.front_B": 0.15, "tyres.rear_D": 0.15, "tyres.rear_B": 0.15,
    "tyres.rear_cornering_stiffness": 0.15, "delay.steering_lag_s": 0.2,
    "delay.throttle_lag_s": 0.2,
}
# Parameters that cannot be drawn: dependent geometry, and pure delays, whose queues have a fixed
# length.
NOT_DRAWN = ("body.wheelbase", "body.l_f", "body.l_r", "body.front_share", "delay.steering_s",
         "delay.throttle_s")


@dataclass(frozen=True, slots=True)
class GymConfig:
    """Configuration of one environment.

    ``track``: a closed ``control.paths.Path``, a name of
    ``control.tracks.TRACKS`` or the path of a file; ``period`` [s] of one environment
    step; ``episode`` [s] until truncation; ``speed`` [m/s]: the reference on a path, the
    largest one of the speed task; ``half_width`` [m] of the track; ``randomise``: half widths
    by name, see ``SPREAD``; empty = the nominal car at every reset. On a path:
    ``beams`` of a lidar that are observed, ``range_noise`` [m] of each, and
    ``opponents``, other cars on the track.
    """

    vehicle: Vehicle | str | Path = DEFAULT
    task: str = "path"
    track: paths.Path | str = "vicon"
    light: LightConfig = REALISTIC
    period: float = 0.05
    episode: float = 20.0
    speed: float = 1.5
    half_width: float = 0.3
    randomise: Mapping[str, float] = field(default_factory=dict)
    beams: int = 0
    range_noise: float = 0.015
    opponents: int = 0

    def __post_init__(self) -> None:
        for name in ("period", "episode", "speed", "half_width", "range_noise", "beams",
                     "opponents"):
            given = getattr(self, name)
            whole = name in ("beams", "opponents")
            if not is_number(given) or (whole and not float(given).is_integer()):
                raise UsageError(f"{name} of the environment is no number", found=repr(given),
                                 expected="a whole number" if whole else "a number",
                                 remedy="docs/how_to/learning.md has every keyword")
        if not 0.0 < self.period < math.inf:
            raise UsageError("the period of the environment is not positive",
                             found=f"{self.period} s", expected="more than 0 s",
                             remedy="docs/how_to/learning.md has every keyword")
        whole_steps(self.period, self.light.step, "the period of the environment")
        good = self.task in TASKS and self.light.sensors is not None and (
            self.light.dtype == "float64" and min(self.speed, self.half_width) > 0.0
            and self.episode >= self.period)
        if not (0 <= self.beams <= MAX_BEAMS and 0 <= self.opponents <= MAX_OPPONENTS
                and self.range_noise >= 0.0) or (
                    self.task != "path" and self.beams + self.opponents):
            raise UsageError("lidar or opponents are out of range",
                             found=f"task {self.task!r}, beams {self.beams}, range_noise "
                                   f"{self.range_noise}, opponents {self.opponents}",
                             expected=f"task 'path', 0 to {MAX_BEAMS} beams, 0 to "
                                      f"{MAX_OPPONENTS} opponents",
                             remedy="docs/how_to/learning.md has every keyword")
        if not good:
            raise UsageError("the configuration of the environment is not valid",
                             found=f"task {self.task!r}, speed {self.speed}, half width "
                                   f"{self.half_width}, episode {self.episode}",
                             expected=f"a task of {', '.join(TASKS)}, sensors, float64, "
                                      "positive numbers",
                             remedy="docs/how_to/learning.md has every keyword")

    @property
    def frame(self) -> int:
        """Return the steps of the simulation per step of the environment."""
        return whole_steps(self.period, self.light.step, "the period of the environment")

    @property
    def limit(self) -> int:
        """Return the environment steps of a full episode."""
        return round(self.episode / self.period)


def check_spread(randomise: bool | Mapping[str, float], p: Vehicle) -> dict[str, float]:
    """Return the half widths for a vehicle, checked at both ends.

    True = ``SPREAD`` for the parameters that the vehicle has. Raises UsageError for an unknown name
    or one that cannot be drawn, ConfigError if an end is out of the parameter's bounds.
    """
    if randomise is True:
        randomise = {k: v for k, v in SPREAD.items() if k in names(p)}
    if randomise and not isinstance(randomise, Mapping):
        raise UsageError("randomise names no parameters", found=repr(randomise),
                         expected="True, or half widths by name: {'body.mass': 0.1}",
                         remedy="docs/how_to/learning.md, DartCar-v0: randomise")
    spread = dict(randomise or {})
    for name, half in spread.items():
        if name in NOT_DRAWN or not is_number(half) or not 0.0 <= half < 1.0:
            raise UsageError(f"{name} cannot be drawn within +-{half!r}",
                             expected="a share of 0 to 1, of a parameter other than "
                                      + ", ".join(NOT_DRAWN),
                             remedy="docs/how_to/learning.md, DartCar-v0: randomise")
        for side in (1.0 - half, 1.0 + half):
            with_values(p, {name: side * value(p, name)})
    return spread
