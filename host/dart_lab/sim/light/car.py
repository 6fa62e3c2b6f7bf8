"""One simulated car without firmware: the fastest way to try a controller."""

from __future__ import annotations

from math import isfinite
from pathlib import Path

from dart_hal.core.errors import BadCommand
from dart_hal.vehicle import Vehicle
from dart_hal.vehicle.load import find_model
from dart_lab.sim.light.config import LightConfig
from dart_lab.sim.light.history import ScalarHistory
from dart_lab.sim.light.noise import Seed
from dart_lab.sim.light.ops import SCALAR_OPS
from dart_lab.sim.light.plant import Plant
from dart_lab.sim.light.sense import Reading
from dart_lab.sim.light.stepper import State8, make_scalar_stepper

DEFAULT = "upstream-2024"
"""The shipped set with actuator lags and tyres that end: fit for any driving."""


def vehicle_named(vehicle: Vehicle | str | Path) -> Vehicle:
    """The vehicle itself, a shipped set by its name, or that of a ``model.toml``.

    Raises UsageError for a name that is neither, ConfigError for a bad file.
    """
    return vehicle if isinstance(vehicle, Vehicle) else find_model(vehicle)[1]


class LightCar(Plant):
    """One car over ``math``; no thread, no clock but its own.

    ``advance(throttle, steering, steps)`` moves it, ``read()`` asks its sensors.
    ``state``: x, y [m], yaw [rad], v_x, v_y [m/s], yaw rate [rad/s] of the centre
    of mass, throttle and steering as the actuators have them. Same seed, same bytes.
    Raises UsageError for an unknown vehicle, ConfigError for a bad configuration.
    """

    def __init__(self, vehicle: Vehicle | str | Path = DEFAULT,
                 config: LightConfig | None = None, seed: Seed = 0) -> None:
        p = vehicle_named(vehicle)
        super().__init__(p, config or LightConfig(), SCALAR_OPS, make_scalar_stepper, [seed],
                         True, p)
        if self.config.sensors is not None:
            self._past = ScalarHistory(self._depth)
        self.reset()

    @property
    def t(self) -> float:
        """Time since the reset [s]."""
        return float(self.k * self.config.step)

    def reset(self, x: float = 0.0, y: float = 0.0, yaw: float = 0.0, v_x: float = 0.0,
              v_y: float = 0.0, yaw_rate: float = 0.0, throttle: float = 0.0,
              steering: float = 0.0, seed: Seed | None = None) -> State8:
        """Begin anew from a state of the centre of mass [m, rad, m/s, rad/s].

        Noise goes on where it was; with ``seed`` it begins anew as well.
        """
        if seed is not None:
            self.seed([seed])
        self.k = 0
        self.state = tuple(map(float, (x, y, yaw, v_x, v_y, yaw_rate, throttle, steering)))
        self._servo = float(steering)
        self._queue.extend([(float(throttle), float(steering))] * (self._queue.maxlen or 1))
        row = self._starts[0].standard_normal(5).tolist()
        self._bias = self._offsets(row)
        if self._kick is not None:
            self._kick.force = self._kick.start(row[3:])
        self._travel = self._path = 0.0
        self._begin(True)
        if self._past is not None:
            self._past.fill(self._before(self.state))
        self._restarted = True
        return self.state

    def advance(self, throttle: float, steering: float, steps: int = 1) -> State8:
        """State after ``steps`` steps with commands -1..1 held. Raises BadCommand for NaN."""
        if not (isfinite(throttle) and isfinite(steering)):
            raise BadCommand("a command is not a number", found=f"{throttle}, {steering}",
                             expected="-1 to 1")
        return super().advance(throttle, steering, steps)

    def read(self, going: bool = True) -> Reading:
        """What the sensors say now. Raises UsageError for a car without sensors."""
        reading = super().read(going and not self._restarted)
        self._restarted = False
        return reading

    def drive(self, throttle: float, steering: float, steps: int = 1) -> Reading:
        """``advance`` and ``read`` in one."""
        self.advance(throttle, steering, steps)
        return self.read()
