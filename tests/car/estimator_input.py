"""The frames of one simulated drive, fed again into the estimators with samples changed."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

from dart_hal.car import Car
from dart_hal.car.telemetry import Telemetry
from dart_hal.core.types import State
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.truth import world_of

ACCEL_X = 6
ACCEL_Y = 7
GYRO_Z = 11
"""Places of the words in a STATE frame."""
WAIVE = ["CALIBRATION_MISSING", "PWM_CLOCK_UNCALIBRATED"]

Change = Callable[[int, list[int]], None]
"""(number of the frame, its words): changes them in place."""


def flip(word: int, bit: int, every: int, run: int = 1, phase: int = 0) -> Change:
    """Flip a bit of a word in `run` of `every` frames in a row."""
    def change(k: int, values: list[int]) -> None:
        if (k + phase) % every < run:
            raw = (values[word] & 0xFFFF) ^ (1 << bit)
            values[word] = raw - 0x10000 if raw & 0x8000 else raw
    return change


class RecordedFrames:
    """What came from a simulated Nano: `calls` to the telemetry, true yaw and the States."""

    def __init__(self, folder: Path, url: str, command: Callable[[Car, float], object],
                 seconds: float) -> None:
        backend = open_backend(url)
        self.calls: list[tuple[tuple[int, ...], tuple[object, ...]]] = []
        self.states: list[State] = []
        with Car.over(backend, cars=folder, raise_on_trip=False) as car:
            telemetry = car._engine.telemetry
            read = telemetry.read

            def note(frame, *arguments):
                self.calls.append((tuple(frame.values()), arguments))
                return read(frame, *arguments)

            telemetry.read = note
            for _ in car.states(duration=2.5):
                pass
            car.arm(waive=WAIVE)
            begin = car.now
            self.first = len(self.calls)
            for state in car.states(duration=seconds):
                command(car, state.t - begin)
                self.states.append(state)
            world = world_of(backend)
            self.true_yaw = [world.truth(state.t).yaw for state in self.states]
            self.files = car.files
            self.byte_time = telemetry.clock.byte_time
            self.looks = telemetry._frames.has_gyro_look

    def estimate(self, change: Change | None = None, first: int | None = None) -> list[State]:
        """States of the drive from all frames; `change` acts from frame `first` on."""
        telemetry = Telemetry(self.files, self.byte_time)
        telemetry._frames.has_gyro_look = self.looks
        begin = self.first if first is None else first
        states = []
        for k, (frame, arguments) in enumerate(self.calls):
            values = list(frame)
            if change is not None and k >= begin:
                change(k, values)
            states.append(telemetry.read(SimpleNamespace(values=lambda v=values: v), *arguments))
        return states[-len(self.states):]

    def yaw_error(self, states: list[State]) -> float:
        """Error [rad] of the yaw that was turned through from the begin of the drive to its end."""
        turned = states[-1].pose.yaw - states[0].pose.yaw
        return turned - (self.true_yaw[-1] - self.true_yaw[0])


def yaw_sigma(states: list[State]) -> float:
    return math.sqrt(states[-1].pose.cov[2, 2])
