"""Parts of the servo that a model may lack: its top speed, and the play of the linkage.

Every servo has a top speed and every linkage has play, and a car whose steering was not calibrated
has a model without both. A fit without them puts a delay, a lag and a wrong steering map in their
place, and the friction of the bends into motor and friction. ``identify --joint`` and the refit of
``diagnose`` therefore fit both together with all other parameters. Only the logged pulses of runs
show them: other recordings do not have the times of the commands.
"""

from __future__ import annotations

from collections.abc import Mapping

from dart_hal.vehicle.effects import apply
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.identification.fit import FittedParameter
from dart_lab.report.numbers import with_error

# First sizes in a fit, which cannot start at 0, where a change does nothing: time from straight
# ahead to full lock [s], and play at the road wheels [rad], both of an ordinary servo.
FIRST_SIZES = {"steering_rate_limit": 0.1, "steering_backlash": 0.02}

PART_LABELS = {"steering_rate_limit": "s from straight ahead to full lock",
               "steering_backlash": "rad of play at the road wheels"}


def list_missing_servo_parts(vehicle: Vehicle) -> tuple[str, ...]:
    """List the effects of FIRST_SIZES that a vehicle does not have."""
    has = {applied.name for applied in vehicle.effects}
    return tuple(name for name in FIRST_SIZES if name not in has)


def add_servo_parts(vehicle: Vehicle) -> Vehicle:
    """Return the vehicle with the parts that it lacks, at their first sizes."""
    for name in list_missing_servo_parts(vehicle):
        vehicle = apply(vehicle, name, k=FIRST_SIZES[name])
    return vehicle


def describe_servo_parts(base: Vehicle, fitted: Mapping[str, FittedParameter]) -> str:
    """State the parts of the servo that a fit has added to the base; "" without any."""
    parts = [f"{with_error(fitted[f'{name}.k'].value, fitted[f'{name}.k'].std)} "
             f"{PART_LABELS[name]}" for name in list_missing_servo_parts(base)
             if f"{name}.k" in fitted]
    return f"servo: {', '.join(parts)}" if parts else ""
