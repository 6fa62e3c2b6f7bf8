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
from dart_lab.sim.light.plant import LightPlant
from dart_lab.sim.light.sense import Reading
from dart_lab.sim.light.stepper import State8, make_scalar_stepper

# The shipped set with actuator lags and a limit of the tyre forces: valid for any driving.
DEFAULT = "upstream-2024"


def vehicle_named(vehicle: Vehicle | str | Path) -> Vehicle:
    """Return the vehicle itself, a shipped set by its name, or that of a ``model.toml``.

    Raises UsageError for a name that is neither, ConfigError for a bad file.
    """
    return vehicle if isinstance(vehicle, Vehicle) else find_model(vehicle)[1]


class LightCar(LightPlant):
    """One car computed with ``math``, without threads and with its own clock.

    ``advance(throttle, steering, steps)`` moves it, ``read()`` reads its sensors. ``state``: x, y
    [m], yaw [rad], v_x, v_y [m/s], yaw rate [rad/s] of the centre of mass, throttle and steering of
    the actuators. The same seed gives identical results. Raises UsageError for an unknown vehicle,
    ConfigError for a bad configuration.
    """

    def __init__(self, vehicle: Vehicle | str | Path = DEFAULT,
                 config: LightConfig | None = None, seed: Seed = 0) -> None:
        p = vehicle_named(vehicle)
        super().__init__(p, config or LightConfig(), SCALAR_OPS, make_scalar_stepper, [seed],
                         True, p)
        if self.config.sensors is not None:
            self._history = ScalarHistory(self._depth)
        self.reset()

    @property
    def t(self) -> float:
        """Return the time since the reset [s]."""
        return float(self.k * self.config.step)

    def reset(self, x: float = 0.0, y: float = 0.0, yaw: float = 0.0, v_x: float = 0.0,
              v_y: float = 0.0, yaw_rate: float = 0.0, throttle: float = 0.0,
              steering: float = 0.0, seed: Seed | None = None) -> State8:
        """Reset to a state of the centre of mass [m, rad, m/s, rad/s].

        Noise continues; with ``seed`` it starts again.
        """
        if seed is not None:
            self.seed([seed])
        self.begin(tuple(map(float, (x, y, yaw, v_x, v_y, yaw_rate, throttle, steering))),
                   self._starts[0].standard_normal(5).tolist())
        self._just_reset = True
        return self.state

    def advance(self, throttle: float, steering: float, steps: int = 1) -> State8:
        """Return the state after steps with constant commands -1..1. Raises BadCommand for NaN."""
        if not (isfinite(throttle) and isfinite(steering)):
            raise BadCommand("a command is not a number", found=f"{throttle}, {steering}",
                             expected="-1 to 1")
        return super().advance(throttle, steering, steps)

    def read(self, going: bool = True) -> Reading:
        """Return the sensor readings now. Raises UsageError for a car without sensors."""
        reading = super().read(going and not self._just_reset)
        self._just_reset = False
        return reading

    def drive(self, throttle: float, steering: float, steps: int = 1) -> Reading:
        """``advance`` and ``read`` in one."""
        self.advance(throttle, steering, steps)
        return self.read()
