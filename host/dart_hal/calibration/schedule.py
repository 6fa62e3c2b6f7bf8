"""Which pulses are driven in which order, and how much floor and time that takes."""

from __future__ import annotations

import math
from dataclasses import dataclass

from dart_hal.vehicle.sets import PAPER
from dart_hal.vehicle.steering import make_steering

SPEEDS = (0.35, 0.55)  # m/s; slow, and apart enough to tell the slip
LEVELS = 13
SETTLE = 0.8  # s; delay 0.15, five servo lags, the PI's answer to the new drag
MEASURE = 0.7  # s; about 5 revolutions of the ring
STANDSTILL = 3.0  # s for the gyro bias
START = 3.0  # s to reach the first speed
MARGIN = 0.6  # m of free floor around the path


@dataclass(frozen=True, slots=True)
class Step:
    """One window: command -1..1 and its pulse, direction of approach, reference speed [m/s]."""

    command: float
    pulse_us: float
    direction: int
    speed: float


@dataclass(frozen=True, slots=True)
class Plan:
    """What the procedure will do, to be shown before anything moves.

    time s, length and width of the free floor m, speed m/s at most, path m.
    """

    steps: tuple[Step, ...]
    time: float
    length: float
    width: float
    speed: float
    path: float
    tools: tuple[str, ...] = ()

    def __str__(self) -> str:
        return (f"drives {self.path:.0f} m of slow arcs in {self.time:.0f} s at up to "
                f"{self.speed:.2f} m/s, from full right to full left and back; needs a free "
                f"floor of {self.length:.1f} m x {self.width:.1f} m; start in the middle")


def count_us(oscillator_hz: float, frequency: float) -> float:
    """Width of one PCA9685 count [us] at ``frequency`` [Hz]; prescale as the driver rounds it."""
    prescale = int(25e6 / 4096.0 / frequency + 0.5)
    return prescale * 1e6 / oscillator_hz


def make_steps(*, center_us: float, span_us: float, direction: int, count: float,
               levels: int = LEVELS, speeds: tuple[float, float] = SPEEDS) -> tuple[Step, ...]:
    """From full right to full left slowly, and back faster.

    Every pulse is a whole number of counts, so that no dithering moves the
    servo to and fro inside its backlash.
    """
    spots = []
    for i in range(levels):
        wanted = -1.0 + 2.0 * i / (levels - 1)
        ticks = round((center_us + direction * span_us * wanted) / count)
        pulse = ticks * count
        spots.append(((pulse - center_us) / (direction * span_us), pulse))
    steps: list[Step] = []
    at = 0.0
    for rising, speed in ((True, speeds[0]), (False, speeds[1])):
        for command, pulse in spots if rising else spots[::-1]:
            way = (command > at) - (command < at) or (steps[-1].direction if steps else 0)
            steps.append(Step(command, pulse, way, speed))
            at = command
    return tuple(steps)


def make_plan(steps: tuple[Step, ...], wheelbase: float) -> Plan:
    """Time and floor: the path is integrated with a typical steering map."""
    curve = make_steering(PAPER.steering)
    x = y = yaw = path = 0.0
    xs, ys = [0.0], [0.0]
    for step in steps:
        omega = step.speed * math.tan(curve(step.command)) / wheelbase
        for _ in range(round((SETTLE + MEASURE) / 0.05)):
            x += step.speed * math.cos(yaw) * 0.05
            y += step.speed * math.sin(yaw) * 0.05
            yaw += omega * 0.05
            path += step.speed * 0.05
            xs.append(x)
            ys.append(y)
    time = STANDSTILL + START + len(steps) * (SETTLE + MEASURE) + 1.0
    reach = 2.0 * MARGIN
    return Plan(steps, time, max(xs) - min(xs) + reach, max(ys) - min(ys) + reach,
                max(s.speed for s in steps), path)
