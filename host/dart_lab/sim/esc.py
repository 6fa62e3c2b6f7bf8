"""The electronic speed controller: pulse widths in, throttle and brake out.

Its inner behaviour is assumed (no source for DART's ESC); every figure is a
parameter of the car: dead band, saturation, brake before reverse, two seconds
of neutral after power-on, coasting when the pulses stop.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from dart_hal.vehicle.delay import DelayQueue
from dart_lab.sim.pwm_output import Pulse


@dataclass(frozen=True, slots=True)
class EscParams:
    """Pulse widths [us] from neutral, times [s]; ``arm_time`` of neutral at power-on.

    A pulse acts ``delay`` after its fall (``LateEsc``), the force of the motor
    follows with a first-order ``lag`` (``injected``).
    """

    neutral_us: float = 1500.0
    deadband_forward_us: float = 25.0
    deadband_reverse_us: float = 25.0
    saturation_us: float = 450.0
    arm_time: float = 2.0
    reverse_gap: float = 0.1
    signal_loss: float = 0.5
    delay: float = 0.0
    lag: float = 0.0


class Mode(Enum):
    """UNARMED wants neutral first; BRAKING was entered by a pull after FORWARD."""

    UNARMED = "unarmed"
    READY = "ready"
    FORWARD = "forward"
    BRAKING = "braking"
    REVERSE = "reverse"


class Esc:
    """State of one ESC. ``throttle`` -1..1 (0 while braking), ``brake`` 0..1."""

    def __init__(self, params: EscParams | None = None) -> None:
        self.params = params or EscParams()
        self.mode = Mode.UNARMED
        self.throttle = 0.0
        self.brake = 0.0
        self.width_us = 0.0
        self._last_pulse = float("-inf")
        self._neutral_since: float | None = None
        self._needed = self.params.arm_time

    def pulse(self, pulse: Pulse) -> None:
        """One complete pulse (rise, fall) [s]; acts at its fall."""
        rise, t = pulse
        if t - self._last_pulse > self.params.signal_loss:
            self._neutral_since = None
        self._last_pulse = t
        self.width_us = width = (t - rise) * 1e6
        p = self.params
        pull = width - p.neutral_us
        if -p.deadband_reverse_us <= pull <= p.deadband_forward_us:
            self._neutral(t)
        elif self.mode is Mode.UNARMED:
            self._neutral_since = None
        elif pull > 0:
            self._set(Mode.FORWARD, min(1.0, pull / p.saturation_us))
        else:
            self._pull_back(min(1.0, -pull / p.saturation_us))

    def check(self, t: float) -> None:
        """Coast when no pulse came for ``signal_loss`` s; then neutral is needed first."""
        if t - self._last_pulse > self.params.signal_loss and self.mode is not Mode.UNARMED:
            self._set(Mode.UNARMED, 0.0)
            self._neutral_since, self._needed = None, 0.0

    def power_on(self) -> None:
        """Power was off: neutral for ``arm_time`` s again."""
        self._set(Mode.UNARMED, 0.0)
        self._last_pulse, self._neutral_since = float("-inf"), None
        self._needed = self.params.arm_time

    def _neutral(self, t: float) -> None:
        self.throttle = self.brake = 0.0
        if self._neutral_since is None:
            self._neutral_since = t
        rested = t - self._neutral_since
        armed = self.mode is Mode.UNARMED and rested >= self._needed
        released = self.mode is Mode.BRAKING and rested >= self.params.reverse_gap
        if armed or released or self.mode is Mode.REVERSE:
            self.mode = Mode.READY

    def _pull_back(self, level: float) -> None:
        """Below neutral: brake after forward, reverse only from rest."""
        if self.mode in (Mode.FORWARD, Mode.BRAKING):
            self._set(Mode.BRAKING, 0.0, level)
        else:
            self._set(Mode.REVERSE, -level)

    def _set(self, mode: Mode, throttle: float, brake: float = 0.0) -> None:
        self.mode, self.throttle, self.brake = mode, throttle, brake
        self._neutral_since = None


class LateEsc(Esc):
    """One that takes ``delay`` s to believe a pulse."""

    def __init__(self, params: EscParams) -> None:
        super().__init__(params)
        self._waiting = DelayQueue[Pulse]()

    def pulse(self, pulse: Pulse) -> None:
        late = self.params.delay
        self._waiting.put(pulse[1] + late, (pulse[0] + late, pulse[1] + late))

    def check(self, t: float) -> None:
        for pulse in self._waiting.take(t):
            super().pulse(pulse)
        super().check(t)
