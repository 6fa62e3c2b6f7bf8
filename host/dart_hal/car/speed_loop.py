"""The built-in speed loop of ``drive_speed``: feed-forward and PI, or feed-forward alone."""

from __future__ import annotations

from dart_hal.config import CarFiles
from dart_hal.types import State
from dart_hal.vehicle.load import vehicle_of
from dart_hal.vehicle.speed_law import SpeedLaw


class SpeedLoop:
    """One per open car; called once per State that is answered.

    ``open_loop``: the last throttle was made without the measured speed.
    """

    def __init__(self, files: CarFiles) -> None:
        self._limits = files.config.limits
        self._law = SpeedLaw(vehicle_of(files.model))
        self._t: float | None = None
        self.open_loop = False

    def reset(self) -> None:
        """Forget the integral: at a stop, and when nobody drove for a while."""
        self._law.reset()

    def throttle(self, speed: float, state: State | None, *, armed: bool, window: float) -> float:
        """Throttle for a speed [m/s]; ``window`` [s]: a longer pause forgets the integral.

        A doubted speed is not fed back: the feed-forward alone drives, at most
        with [limits] encoder_lost_throttle.
        """
        limits = self._limits
        measured, t = (state.speed, state.t) if state else (0.0, 0.0)
        dt = t - self._t if self._t is not None else 0.0
        self._t = t
        wanted = min(max(speed, -limits.max_speed), limits.max_speed)
        self.open_loop = state is not None and state.health.speed_doubted
        if self.open_loop or dt > window or not armed:
            self.reset()
            dt = 0.0
        if self.open_loop:
            cap = limits.encoder_lost_throttle
            return min(max(self._law.feed_forward(wanted), -cap), cap)
        return self._law.throttle(wanted, measured, dt)
