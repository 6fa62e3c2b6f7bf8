"""Motion of the centre of mass on a grid of 0.01 s, with the commands that were held.

This is the one preprocessing that every open-loop comparison of models uses.
"""

from __future__ import annotations

from dataclasses import dataclass

from dart_hal.errors import RecordingError
from dart_hal.types import BoolArray, FloatArray

from .marker import marker_grid
from .model import Recording, Reference, freeze, freeze_flags
from .reference import reference_for

L_R = 0.0945  # m, rear axle to centre of mass of the paper's code


@dataclass(frozen=True, slots=True)
class Grid:
    """Motion of the centre of mass on a grid of 0.01 s, (n,) each, read-only.

    t s from the first mocap row; x, y m, yaw rad unwrapped; v_x, v_y m/s in
    body axes, omega rad/s; throttle (gated), steering, encoder [m/s]: last
    message that had arrived (NaN: no such sensor); bad: do not use.
    """

    t: FloatArray
    x: FloatArray
    y: FloatArray
    yaw: FloatArray
    v_x: FloatArray
    v_y: FloatArray
    omega: FloatArray
    throttle: FloatArray
    steering: FloatArray
    encoder: FloatArray
    bad: BoolArray
    reference: Reference

    def __len__(self) -> int:
        return len(self.t)


def grid(recording: Recording, reference: Reference | None = None, l_r: float = L_R) -> Grid:
    """Motion of the centre of mass; ``reference`` None takes the table by date.

    l_r [m]: rear axle to centre of mass. Errors: RecordingError as for
    ``marker_grid``, and when no reference point is known for the date.
    """
    m = marker_grid(recording)
    ref = reference if reference is not None else reference_for(recording)
    if ref is None:
        when = recording.when
        raise RecordingError(
            f"{recording.name}: where the markers sat is not known for this date",
            found=f"date {when:%Y-%m-%d}" if when else "no date in the mocap clock",
            expected="a date of 2024, or schema C", read=str(recording.path),
            remedy="--reference LX,THETA,LY (m, rad, m), or fit it from driving to both sides")
    yaw = m.yaw + ref.theta
    x, y, v_x, v_y = map(freeze, ref.centre(l_r, (m.x, m.y, yaw), (m.dx, m.dy, m.omega)))
    return Grid(
        t=freeze(m.t), x=x, y=y, yaw=freeze(yaw), v_x=v_x, v_y=v_y, omega=freeze(m.omega),
        throttle=freeze(m.throttle), steering=freeze(m.steering), encoder=freeze(m.encoder),
        bad=freeze_flags(m.bad), reference=ref)
