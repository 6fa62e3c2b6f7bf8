"""The electronic speed controller: pulse widths in, throttle and brake out.

Its behaviour is assumed, since there is no source for DART's ESC. The parameters of the car are:
dead band, saturation, brake before reverse, two seconds of neutral after power-on, coasting when
the pulses stop.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from dart_hal.vehicle.delay import DelayQueue
from dart_lab.sim.pwm_output import Pulse


@dataclass(frozen=True, slots=True)
class EscParams:
    """Pulse widths [us] from neutral, times [s]; ``arm_time`` of neutral at power-on.

    A pulse acts ``delay`` after its fall (``DelayedEsc``), the force of the motor
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


class EscMode(Enum):
    """State of the ESC; UNARMED needs neutral first, BRAKING follows FORWARD on reverse pulses."""

    UNARMED = "unarmed"
    READY = "ready"
    FORWARD = "forward"
    BRAKING = "braking"
    REVERSE = "reverse"


class Esc:
    """State of one ESC. ``throttle`` -1..1 (0 while braking), ``brake`` 0..1."""

    def __init__(self, params: EscParams | None = None) -> None:
        self.params = params or EscParams()
        self.mode = EscMode.UNARMED
        self.throttle = 0.0
        self.brake = 0.0
        self.width_us = 0.0
        self._last_pulse = float("-inf")
        self._neutral_since: float | None = None
        self._needed = self.params.arm_time

    def pulse(self, pulse: Pulse) -> None:
        """Take over one complete pulse (rise, fall) [s], which acts at its fall."""
        rise, t = pulse
        # Neutral before a loss of the signal does not count.
        if t - self._last_pulse > self.params.signal_loss:
            self._neutral_since = None
        self._last_pulse = t
        self.width_us = width = (t - rise) * 1e6
        p = self.params
        offset = width - p.neutral_us
        if -p.deadband_reverse_us <= offset <= p.deadband_forward_us:
            self._neutral(t)
        elif self.mode is EscMode.UNARMED:
            self._neutral_since = None
        elif offset > 0:
            self._set(EscMode.FORWARD, min(1.0, offset / p.saturation_us))
        else:
            self._reverse(min(1.0, -offset / p.saturation_us))

    def check(self, t: float) -> None:
        """Coast after ``signal_loss`` s without a pulse; neutral is then needed first."""
        if t - self._last_pulse > self.params.signal_loss and self.mode is not EscMode.UNARMED:
            self._set(EscMode.UNARMED, 0.0)
            # The power was on all the time, so a first pulse of neutral is enough.
            self._neutral_since = None
            self._needed = 0.0

    def power_on(self) -> None:
        """Start after power was off: neutral for ``arm_time`` s is needed again."""
        self._set(EscMode.UNARMED, 0.0)
        self._last_pulse = float("-inf")
        self._neutral_since = None
        self._needed = self.params.arm_time

    def _neutral(self, t: float) -> None:
        self.throttle = self.brake = 0.0
        if self._neutral_since is None:
            self._neutral_since = t
        rested = t - self._neutral_since
        # Neutral arms the ESC after arm_time, and releases the brake after reverse_gap, so that the
        # next pulses below neutral drive backward.
        armed = self.mode is EscMode.UNARMED and rested >= self._needed
        released = self.mode is EscMode.BRAKING and rested >= self.params.reverse_gap
        if armed or released or self.mode is EscMode.REVERSE:
            self.mode = EscMode.READY

    def _reverse(self, level: float) -> None:
        """Take over a pulse below neutral: brake after forward, else drive backward."""
        if self.mode in (EscMode.FORWARD, EscMode.BRAKING):
            self._set(EscMode.BRAKING, 0.0, level)
        else:
            self._set(EscMode.REVERSE, -level)

    def _set(self, mode: EscMode, throttle: float, brake: float = 0.0) -> None:
        self.mode = mode
        self.throttle = throttle
        self.brake = brake
        self._neutral_since = None


class DelayedEsc(Esc):
    """An ESC on which a pulse acts ``delay`` s after its fall."""

    def __init__(self, params: EscParams) -> None:
        super().__init__(params)
        self._waiting = DelayQueue[Pulse]()

    def pulse(self, pulse: Pulse) -> None:
        # The width of the pulse is unchanged: both edges are delayed.
        delay = self.params.delay
        self._waiting.put(pulse[1] + delay, (pulse[0] + delay, pulse[1] + delay))

    def check(self, t: float) -> None:
        for pulse in self._waiting.take(t):
            super().pulse(pulse)
        super().check(t)
