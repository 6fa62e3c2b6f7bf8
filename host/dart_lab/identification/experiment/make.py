"""An experiment by its name: its plan, and its drive on an open Car."""

from __future__ import annotations

from collections.abc import Sequence

from dart_hal.car import Car
from dart_hal.core.config import CarFiles
from dart_hal.core.errors import UsageError

from .circles import plan_circles
from .floor import Floor
from .plans import EXPERIMENTS, PROBES, ExperimentPlan
from .probes import plan_probe
from .runner import ExperimentDrive, Progress, run_plan
from .steering import plan_steering, run_steering
from .straight import plan_straight


def make_plan(name: str, files: CarFiles, floor: Floor, speed: float | None) -> ExperimentPlan:
    """Plan and rehearse experiment ``name`` for ``floor``, speed [m/s] at most.

    Raises UsageError for another name, ExperimentFailed if the floor is too small or the speed
    too high for it.
    """
    if name in ("friction", "motor"):
        return plan_straight(name, files, floor, speed)
    if name == "steering":
        return plan_steering(files, floor, speed)
    if name in ("delay", "tyres"):
        return plan_circles(name, files, floor, speed)
    if name in PROBES:
        return plan_probe(name, files, floor, speed)
    raise UsageError(f"no experiment {name!r}", expected=", ".join((*EXPERIMENTS, *PROBES)))


def conduct(car: Car, plan: ExperimentPlan, progress: Progress = lambda share, text: None, *,
            waive: Sequence[str] = ()) -> ExperimentDrive:
    """Arm the car and drive the plan; the car is stopped at the end and after any error.

    The steering sweep needs pulses, so it is driven in raw mode, which waives clock and
    calibration. Raises NotArmed, ExperimentFailed, CalibrationFailed, LinkLost.
    """
    try:
        if plan.sweep is not None:
            with car.raw():
                return run_steering(car, plan, progress)
        car.arm(waive=waive)
        return run_plan(car, plan, progress)
    finally:
        car.stop()
