"""The ESC's pin of a simulated car while a procedure drives it, and Ctrl-C in the middle."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from dart_hal.car import Car
from dart_hal.car.driver import Driver
from dart_hal.core.types import State
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.truth import world_of
from dart_lab.sim.world import World

ESC = 1
PULLS = 12.0
"""us from the nominal neutral: two counts, and what a hidden car's neutral is off."""
FRAMES = 0.06
"""s: the frame that is out, and two more."""


class Watched:
    """One car and the pulses of its ESC pin: (end [s], width [us])."""

    def __init__(self, url: str, cars: Path, alter: Callable[[World], None] = lambda world: None
                 ) -> None:
        self.backend = open_backend(url)
        self.world = world_of(self.backend)
        self.pulses: list[tuple[float, float]] = []
        self.world.watchers.append(lambda channel, pulse: channel == ESC and self.pulses.append(
            (pulse[1], (pulse[1] - pulse[0]) * 1e6)))
        alter(self.world)  # before the car is opened
        self.car = Car.over(self.backend, cars=cars)

    def run(self, procedure: Callable[..., Any], *given: Any, **options: Any) -> Any:
        """What the procedure gives; the car is watched for another 0.5 s, also if it raises."""
        try:
            return procedure(self.car, *given, **options)
        finally:
            assert self.car.mode != "RAW"
            for _ in self.car.states(duration=0.5):
                pass

    def pulled_after(self, t: float) -> float:
        """s after t for which the pin carried a throttle."""
        return max((end for end, width in self.pulses if abs(width - 1500.0) > PULLS),
                   default=0.0) - t

    def press(self, when: Callable[[State], bool], procedure: Callable[..., Any], *given: Any,
              **options: Any) -> float:
        """Ctrl-C at the first State of a raw output that is so; the world's time [s] then."""
        pressed: list[float] = []

        def press(state: State) -> None:
            if self.car.mode == "RAW" and when(state):
                pressed.append(self.world.t)
                raise KeyboardInterrupt

        self.car.on_state(press)
        with pytest.raises(KeyboardInterrupt):
            procedure(self.car, *given, **options)
        self.car._engine.listeners.remove(press)
        for _ in self.car.states(duration=0.5):
            pass
        return pressed[0]


def without_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    """Negative control: an exit without a stop of the driver keeps the last pulse."""
    monkeypatch.setattr(Driver, "stop", lambda self, now, event=None: self.applied)
