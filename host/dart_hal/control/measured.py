"""What ``calibrate esc`` and ``throttle`` measured, as the speed loop needs it."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import replace

from dart_hal.control.drivetrain import Correction, Inverse
from dart_hal.core.config import CarFiles
from dart_hal.core.config.calibration import ThrottleCalibration
from dart_hal.core.types import NINETY
from dart_hal.vehicle.compose import settled
from dart_hal.vehicle.load import vehicle_of
from dart_hal.vehicle.parameters import Vehicle

# s at neutral: ESCs ask for about 0.1 s, and what is commanded acts up to 0.06 s later.
REST_S = 0.16
# s of it that are no ESC's.
ACTS = 0.06


def measured_in(files: CarFiles) -> ThrottleCalibration:
    """The car's throttle calibration, an empty one if there is none."""
    return files.calibration.throttle if files.calibration else ThrottleCalibration()


def vehicle_for(files: CarFiles) -> Vehicle:
    """The car's identified model; without one the paper's with this ESC's dead band."""
    vehicle = vehicle_of(files.model)
    band = measured_in(files).deadband_forward_us
    if files.model is not None or band is None:
        return vehicle
    onset = -band.value / files.config.throttle.span_us
    return replace(vehicle, motor=replace(vehicle.motor, g=onset))


def inverse_of(files: CarFiles) -> Inverse:
    """The car's drive train turned round, with the pulses that were measured to hold a speed."""
    vehicle = settled(vehicle_for(files))
    return Inverse(vehicle, correction(files, Inverse(vehicle).throttle))


def end_of_throttle(files: CarFiles) -> float:
    """Throttle beyond which the ESC gives no more."""
    end = measured_in(files).saturation_us
    return min(end.value / files.config.throttle.span_us, 1.0) if end else 1.0


def rest_before_reverse(files: CarFiles) -> float:
    """s at neutral between brake and reverse; 0 for an ESC that reverses at once."""
    measured = measured_in(files)
    if measured.reverse == "at_once":
        return 0.0
    rest = measured.reverse_rest
    return rest.value + NINETY * rest.std + ACTS if rest else REST_S


def correction(files: CarFiles, model: Callable[[float], float]) -> Correction | None:
    """What the measured pulses are beside the ``model``'s throttle of a speed; None: no table.

    Straight lines between the measured speeds, level beyond them: the model keeps its shape.
    """
    table = measured_in(files).drive
    span = files.config.throttle.span_us
    if table is None:
        return None
    at = table.speed
    more = [(pulse - files.neutral_us) / span - model(v)
            for v, pulse in zip(at, table.pulse_us, strict=True)]

    def correct(speed: float) -> float:
        if not at[0] < speed < at[-1]:
            return more[0] if speed <= at[0] else more[-1]
        k = bisect_right(at, speed)
        share = (speed - at[k - 1]) / (at[k] - at[k - 1])
        return more[k - 1] + share * (more[k] - more[k - 1])

    return correct
