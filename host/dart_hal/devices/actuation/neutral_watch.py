"""Detection of a car that speeds up while the ESC gets neutral, from the wheel speed alone.

Every other layer stops the car by the neutral pulse of the car's files. If that pulse is not
neutral (a wrong number, the clock of another board, an ESC on the steering's channel), all of them
would drive the car. This layer uses no pulse width: it compares the wheel speed under neutral
with its minimum.

    neutral on the pins, 0.3 s since the last other pulse
    lowest = smallest speed since then              [m/s]
    speed > 1.15 lowest + 0.1 m/s in 3 States       it speeds up
    path since lowest > 0.1 m + 1 s x lowest        it does not slow down

Coasting lowers the minimum all the time and satisfies neither condition. A car that is pushed or
rolls downhill satisfies one of them; its pulses go off, which is harmless. A speed that rises
faster than any wheel can is noise of the encoder and satisfies none.
"""

from __future__ import annotations

import math

# s after the last other pulse in which the speed may still rise: delay of the ESC (up to 0.1 s),
# lag of the motor (up to 0.1 s), and the age of the speed at low speeds.
SETTLE_S = 0.3
# m/s: twice the noise of the speed at walking pace.
MIN_RISE = 0.1
# Of the speed: a missing mark of the ring changes it by a thirteenth at 2 m/s over 15 ms.
RELATIVE_RISE = 0.15
# m: four edges. A single edge of a wheel that rocks at rest is no rise.
MIN_RISE_PATH = 0.008
# States in a row above the limit: 30 ms. The speed after a rest may be one interval old.
CONFIRM_STATES = 3
# m/s2: a lifted wheel at full throttle reaches 50.
MAX_RISE_RATE = 60.0
# m/s by which a speed must be below the last minimum to count as slowing down.
LOWER = 0.02
# m that a wheel may turn under neutral without slowing down: a car put down by hand.
MIN_PATH = 0.1
# s of its speed added to MIN_PATH: it must lose 0.02 m/s in a second, a tenth of the deceleration
# by the smallest measured friction.
COAST_S = 1.0


class NeutralWatch:
    """Watches the wheel speed while neutral is written; ``update`` once per State."""

    def __init__(self) -> None:
        self.speed = 0.0
        """Newest wheel speed [m/s], without sign."""
        self._driven_at = -math.inf
        self._t: float | None = None
        self.restart()

    def restart(self) -> None:
        """Reset the minimum: neutral is written again from now on."""
        self._lowest = self._marked = math.inf
        self._lowest_at = -math.inf
        self._path = 0.0
        self._above = 0
        self._noise = False

    def note_driven(self, t: float) -> None:
        """Note that a pulse other than neutral may be on the pins at t [s]."""
        self._driven_at = t
        self.restart()

    def update(self, t: float, speed: float, neutral: bool, doubted: bool = False) -> bool:
        """Return whether the wheels speed up, or do not slow down, under neutral.

        t [s] of the State; speed [m/s] of the wheels, either sign; neutral: the last pulse written
        is neutral; doubted: the speed may be noise, so a constant one is no evidence.
        """
        dt = 0.0 if self._t is None else max(t - self._t, 0.0)
        self._t = t
        self.speed = abs(speed)
        if not neutral:
            self.restart()
            return False
        if t - self._driven_at < SETTLE_S:
            return False
        return self._rises(t, self.speed, dt, doubted)

    def _rises(self, t: float, speed: float, dt: float, doubted: bool) -> bool:
        """Evaluate the two conditions at the top of this file for one State."""
        if speed <= self._lowest:
            self._lowest = speed
            self._lowest_at = t
        above = speed > (1.0 + RELATIVE_RISE) * self._lowest + MIN_RISE
        possible = self._lowest + MIN_RISE + MAX_RISE_RATE * (t - self._lowest_at)
        self._noise = above and (self._noise or speed > possible)
        if self._noise:
            self._above = 0
            return False
        if speed == 0.0 or speed < self._marked - LOWER:
            self._marked = speed
            self._path = 0.0
        self._path += speed * dt
        self._above = self._above + 1 if above else 0
        speeds_up = self._above >= CONFIRM_STATES and self._path >= MIN_RISE_PATH
        goes_on = self._path > MIN_PATH + COAST_S * self._marked
        return speeds_up or (goes_on and not doubted)
