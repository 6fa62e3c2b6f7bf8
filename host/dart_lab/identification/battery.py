"""Voltage of the battery in recordings: the one at which a motor holds, and where it is missing.

``battery_fade`` is a law of the voltage in a model that states ``motor_voltage``, and a law of the
time in one that does not. Its k is never used in the other law.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dart_hal.recording.dart import Recording
from dart_hal.vehicle.parameters import Vehicle
from dart_lab.report.numbers import shorten_list

FADE = "battery_fade"


def find_mean_voltage(recordings: Sequence[Recording]) -> float | None:
    """Return the mean voltage [V] while the motor has a throttle, to 0.01 V.

    This is the voltage at which parameters of a motor hold that are fitted to these recordings.
    None unless each of them has a measured voltage.
    """
    parts = []
    for r in recordings:
        if r.battery is None:
            return None
        m = r.messages
        # At rest the battery recovers to a voltage that the motor does not have while it drives.
        driven = m.arrival[m.throttle != 0.0]
        parts.append(r.battery.interpolate(driven if len(driven) else m.arrival))
    return round(float(np.concatenate(parts).mean()), 2) if parts else None


def set_motor_voltage(p: Vehicle, recordings: Sequence[Recording]) -> Vehicle:
    """Return the vehicle with the voltage that decides the law of a new ``battery_fade``.

    It is that of the model, else the mean of the recordings, and None where a recording has none.
    A vehicle that has the effect already keeps its law.
    """
    if _has_fade(p):
        return p
    mean = find_mean_voltage(recordings)
    return replace(p, motor_voltage=mean if mean is None else p.motor_voltage or mean)


def state_fade_law(p: Vehicle, recordings: Sequence[Recording]) -> list[str]:
    """Return a note if the ``battery_fade`` of a model does not fit these recordings."""
    if not _has_fade(p):
        return []
    # The voltage enters recording by recording, so that one without it does not affect the others.
    without = [r.name for r in recordings if r.battery is None]
    if p.motor_voltage is None:
        return [] if len(without) == len(recordings) else [
            f"{FADE} of {p.name} follows the time, though the voltage of the battery is measured: "
            "the model states no motor_voltage; remove the effect from the model and diagnose "
            "again, then it follows the voltage"]
    return [f"{shorten_list(without)}: {FADE} of {p.name} follows the voltage of the battery, "
            "which is not measured there throughout, so the effect is left out: the motor is that "
            f"of {p.motor_voltage:g} V"] if without else []


def describe_fade_law(p: Vehicle) -> str:
    """Return what the k of a ``battery_fade`` of a vehicle is."""
    law = ("in 100 s of driving" if p.motor_voltage is None
           else f"by 10 % less voltage than {p.motor_voltage:g} V")
    return f"{FADE}: k is the change of the motor force {law}"


def _has_fade(p: Vehicle) -> bool:
    return any(a.name == FADE for a in p.effects)
