"""Counts of what an actuator has written, repeated and refused."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class ActuatorCounters:
    """What happened since the actuator was made."""

    frames: int = 0
    writes: int = 0
    retries: int = 0
    bus_errors: int = 0
    read_backs: int = 0
    reinits: int = 0
    expired: int = 0
    bad_commands: int = 0
    overridden: int = 0
