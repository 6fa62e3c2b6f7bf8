"""Rehearsal of a plan with a simple model of the car, for its time and floor.

The model has no imperfections: it shows the path of a drive, and is no data to identify from.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from dart_hal.core.config import CarFiles
from dart_hal.core.types import NEUTRAL_APPLIED, Applied, Health, Pose, State
from dart_hal.vehicle.bicycle import make_acceleration
from dart_hal.vehicle.load import vehicle_of

from .plans import ExperimentPlan
from .runner import ExperimentDrive, insert_figures, run_plan

SUB_STEPS = 5
# [s] No experiment takes longer.
MAX_DRIVE_TIME = 600.0
_HEALTHY = Health(frozenset(), 0.005, 0.0, 0, 0, 5.0, 1e-4, "linear", (0, 3, 0, 0))


class PaperCar:
    """A car of the file's model (else the paper's) without any imperfection; 100 Hz."""

    mode = "ARMED"
    causes: tuple[str, ...] = ()

    def __init__(self, files: CarFiles) -> None:
        self.files = files
        vehicle = vehicle_of(files.model)
        self._rates = make_acceleration(vehicle)
        self._l_r = vehicle.body.l_r
        self._per_edge = files.metres_per_edge.value
        self._applied: Applied = NEUTRAL_APPLIED
        self._t = self._rolled = 0.0
        self._x = self._y = self._yaw = self._vx = self._vy = self._om = 0.0

    def states(self, *, duration: float = MAX_DRIVE_TIME, timeout: float = 0.5) -> Iterator[State]:
        while self._t < min(duration, MAX_DRIVE_TIME):
            for _ in range(SUB_STEPS):
                self._step(0.01 / SUB_STEPS)
            yield self._state()

    def drive(self, *, steering: float = 0.0, throttle: float = 0.0, valid_for: float = 0.2,
              source: str = "user") -> Applied:
        self._applied = replace(NEUTRAL_APPLIED, steering=steering, throttle=throttle)
        return self._applied

    def stop(self) -> Applied:
        self._applied = NEUTRAL_APPLIED
        return NEUTRAL_APPLIED

    def _step(self, dt: float) -> None:
        a = self._applied
        ax, ay, turn = self._rates(self._vx, self._vy, self._om, a.throttle, a.steering)
        self._vx += ax * dt
        self._vy += ay * dt
        self._om += turn * dt
        self._yaw += self._om * dt
        c, s = math.cos(self._yaw), math.sin(self._yaw)
        self._x += (self._vx * c - self._vy * s) * dt
        self._y += (self._vx * s + self._vy * c) * dt
        self._rolled += self._vx * dt
        self._t += dt

    def _state(self) -> State:
        pose = Pose(self._x - self._l_r * math.cos(self._yaw),
                    self._y - self._l_r * math.sin(self._yaw), self._yaw)
        ticks = int(self._rolled / self._per_edge)
        return State(self._t, round(self._t * 100), self._vx, 0.01, self._om, 0.0, 0.0, ticks,
                     pose, self._applied, _HEALTHY)


def rehearse_plan(plan: ExperimentPlan, files: CarFiles) -> tuple[ExperimentPlan, ExperimentDrive]:
    """Drive the plan with the file's model; return (plan with time, path and top speed, drive)."""
    drive = run_plan(PaperCar(files), plan)
    return insert_figures(plan, drive), drive
