"""Measurements of ``calibrate esc`` and ``throttle`` in the form that the speed loop uses."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import replace

from dart_hal.control.drivetrain import DEFAULT_BRAKE, Correction, InverseDrive
from dart_hal.core.config import CarFiles
from dart_hal.core.config.calibration import ThrottleCalibration
from dart_hal.core.types import INTERVAL_90
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.load import vehicle_of
from dart_hal.vehicle.parameters import Vehicle

# Time at neutral [s]: ESCs require about 0.1 s, and commands act up to 0.06 s later.
DEFAULT_REVERSE_REST = 0.16
# Part of it that is the delay of the commands [s].
COMMAND_DELAY = 0.06


def throttle_calibration(files: CarFiles) -> ThrottleCalibration:
    """Return the throttle calibration of the car, an empty one if there is none."""
    return files.calibration.throttle if files.calibration else ThrottleCalibration()


def vehicle_for(files: CarFiles) -> Vehicle:
    """Return the identified model of the car, or the paper's with the dead band of this ESC."""
    vehicle = vehicle_of(files.model)
    band = throttle_calibration(files).deadband_forward_us
    if files.model is not None or band is None:
        return vehicle
    onset = -band.value / files.config.throttle.span_us
    return replace(vehicle, motor=replace(vehicle.duty_motor, g=onset))


def make_inverse_drive(files: CarFiles) -> InverseDrive:
    """Return the inverse of the drive train, corrected by the pulses measured at constant speeds.
    """
    vehicle = apply_parameter_effects(vehicle_for(files))
    measured = throttle_calibration(files).brake
    return InverseDrive(vehicle, make_correction(files, InverseDrive(vehicle).throttle),
                        measured.value if measured else DEFAULT_BRAKE)


def max_effective_throttle(files: CarFiles) -> float:
    """Return the throttle beyond which the ESC output is saturated."""
    end = throttle_calibration(files).saturation_us
    return min(end.value / files.config.throttle.span_us, 1.0) if end else 1.0


def min_brake(files: CarFiles) -> float:
    """Return what the brake adds to the deceleration [m/s2] at least, within [limits] min_throttle.

    The lower end of the measured 90 % interval, or DEFAULT_BRAKE.
    """
    measured = throttle_calibration(files).brake
    full = (max(measured.value - INTERVAL_90 * measured.std, 0.0) if measured
            else DEFAULT_BRAKE)
    return full * -max(files.config.limits.min_throttle, -max_effective_throttle(files))


def rest_before_reverse(files: CarFiles) -> float:
    """Return the time at neutral between brake and reverse [s]; 0 if the ESC reverses at once."""
    measured = throttle_calibration(files)
    if measured.reverse == "at_once":
        return 0.0
    rest = measured.reverse_rest
    return rest.value + INTERVAL_90 * rest.std + COMMAND_DELAY if rest else DEFAULT_REVERSE_REST


def make_correction(files: CarFiles, model: Callable[[float], float]) -> Correction | None:
    """Return the measured throttle minus the ``model``'s throttle of a speed; None without a table.

    Linear between the measured speeds, constant beyond them: the model keeps its shape.
    """
    table = throttle_calibration(files).drive
    span = files.config.throttle.span_us
    if table is None:
        return None
    speeds = table.speed
    offsets = [(pulse - files.neutral_us) / span - model(v)
               for v, pulse in zip(speeds, table.pulse_us, strict=True)]

    def correct(speed: float) -> float:
        if not speeds[0] < speed < speeds[-1]:
            return offsets[0] if speed <= speeds[0] else offsets[-1]
        k = bisect_right(speeds, speed)
        share = (speed - speeds[k - 1]) / (speeds[k] - speeds[k - 1])
        return offsets[k - 1] + share * (offsets[k] - offsets[k - 1])

    return correct
