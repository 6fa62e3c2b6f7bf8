"""Poses as parsed from the bytes of a source, and their conversion by the options of the source."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isfinite, pi, radians

from dart_hal.core.errors import UsageError
from dart_hal.core.types import MAX_COORDINATE, POSE_STD, POSE_YAW_STD, ExternalPose, pose_cov


@dataclass(frozen=True, slots=True)
class PoseReading:
    """A pose as received: t by the source's clock, x, y, yaw, one sigma of each; its units."""

    body: str
    frame: str
    t: float
    x: float
    y: float
    yaw: float
    std: float = POSE_STD
    yaw_std: float = POSE_YAW_STD

    def to_external(self, arrival: float) -> ExternalPose:
        """Convert to an external pose with this arrival [s]. Raises ValueError if it is invalid."""
        if not (0.0 < self.std <= MAX_COORDINATE and 0.0 < self.yaw_std <= MAX_COORDINATE):
            raise ValueError(f"one sigma that is not above 0, or above {MAX_COORDINATE:g}")
        return ExternalPose(self.t, arrival, self.x, self.y, self.yaw,
                            pose_cov(self.std, self.yaw_std), self.frame)


@dataclass(frozen=True, slots=True)
class Convention:
    """Units and axes of a source.

    metres, angle [rad], seconds: one unit of length, angle and time; left: its frame is left-handed
    (y and yaw change sign); y_up: its y axis points up (poses in space only); turn [rad]: from the
    body's x axis to the car's nose; body: "" = any body.
    """

    metres: float = 1.0
    angle: float = 1.0
    seconds: float = 1.0
    left: bool = False
    turn: float = 0.0
    body: str = ""
    y_up: bool = False

    def read(self, r: PoseReading) -> PoseReading:
        """Convert a pose to s, m and rad, right-handed, with the yaw of the car's nose."""
        sign = -1.0 if self.left else 1.0
        return replace(r, t=r.t * self.seconds, x=r.x * self.metres, y=sign * r.y * self.metres,
                       yaw=sign * r.yaw * self.angle + self.turn, std=r.std * self.metres,
                       yaw_std=r.yaw_std * self.angle)


PLANE_OPTIONS = ("units", "angle", "time", "hand", "turn", "body")
# Options of sources that send a position in space and a quaternion, with times in s.
SPACE_OPTIONS = ("units", "hand", "up", "turn", "body")
_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
_ANGLES = {"rad": 1.0, "deg": pi / 180.0}
_TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def convention(options: Mapping[str, str]) -> Convention:
    """Return the convention of the options of a URL.

    They are ``units``, ``angle``, ``time``, ``hand``, ``up``, ``turn`` (deg) and ``body``.
    Raises UsageError for a value that is not allowed.
    """
    def one_of(name: str, known: Mapping[str, float]) -> float:
        value = options.get(name, next(iter(known)))
        if value not in known:
            raise UsageError(f"{name}={value!r} of a source of poses", found=value,
                             expected=" or ".join(known))
        return known[value]

    try:
        turn = radians(float(options.get("turn", "0")))
    except ValueError:
        turn = float("nan")
    if not isfinite(turn):
        raise UsageError(f"turn={options['turn']!r} of a source of poses", found=options["turn"],
                         expected="degrees, for example 90")
    return Convention(one_of("units", _UNITS), one_of("angle", _ANGLES), one_of("time", _TIMES),
                      one_of("hand", {"right": 0.0, "left": 1.0}) > 0.5, turn,
                      options.get("body", ""), one_of("up", {"z": 0.0, "y": 1.0}) > 0.5)
