"""Counters of an actuator: frames, writes, retries, errors and refused commands."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class ActuatorCounters:
    """Counts since the actuator was created.

    expired: commands that ran out; overridden: commands of a source that had lower priority than
    another one; reinits: times that a lost PCA9685 was set up again.
    """

    frames: int = 0
    writes: int = 0
    retries: int = 0
    bus_errors: int = 0
    read_backs: int = 0
    reinits: int = 0
    expired: int = 0
    bad_commands: int = 0
    overridden: int = 0
