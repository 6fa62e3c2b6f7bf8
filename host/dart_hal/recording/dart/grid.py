"""Motion of the centre of mass on a grid of 0.01 s, with the commands (zero-order hold).

All open-loop comparisons of models use this preprocessing.
"""

from __future__ import annotations

from dataclasses import dataclass

from dart_hal.core.errors import RecordingError
from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.vehicle.scale import REFERENCE_SCALE, Scale

from .marker import VELOCITY_POINTS, marker_grid
from .model import Recording, Reference, freeze, freeze_flags
from .reference import NEEDED, OPTION, fit_reference, reference_for

UNKNOWN_FRAME = "the marker frame on this car is not known"
# Rear axle to centre of mass of DART in the code of the paper [m].
L_R = 0.0945


@dataclass(frozen=True, slots=True)
class Grid:
    """Motion of the centre of mass on a grid of 0.01 s, (n,) each, read-only.

    t s from the first mocap row; x, y m, yaw rad unwrapped; v_x, v_y m/s in
    body axes, omega rad/s; throttle (gated), steering, encoder [m/s]: last
    message that had arrived (NaN: no such sensor); bad: do not use; scale: of
    the car, see ``Recording.scale``; voltage [V] of the battery, None where it is not measured;
    points: samples from which each velocity was computed, see ``savgol_derivative``.
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
    scale: Scale = REFERENCE_SCALE
    voltage: FloatArray | None = None
    points: int = VELOCITY_POINTS

    def __len__(self) -> int:
        return len(self.t)


def grid(recording: Recording, reference: Reference | None = None, l_r: float | None = None, *,
         turning: bool = False) -> Grid:
    """Compute the motion of the centre of mass.

    reference: marker frame; None: the known one, else one that is fitted to the recording. turning:
    as for ``marker_grid``.

    l_r [m]: rear axle to centre of mass; None: that of DART for a published recording, else 0,
    which is the motion of the rear axle (v_x and omega are the same). Errors: RecordingError as for
    ``marker_grid``, and if the marker frame is neither known nor identified by the driving.
    """
    m = marker_grid(recording, turning=turning)
    ref = reference or reference_for(recording)
    if ref is None and not recording.framed:
        ref = fit_reference([recording])
    if ref is None:
        raise RecordingError(
            f"{recording.name}: {UNKNOWN_FRAME}",
            found="driving that does not identify it, and no --reference",
            expected=NEEDED, read=str(recording.path),
            likely="a recording of turns to one side, or of straight driving",
            remedy=f"{OPTION}; or add a recording of the same day with turns to both sides")
    if l_r is None:
        l_r = L_R if recording.published else 0.0
    yaw = m.yaw + ref.theta
    x, y, v_x, v_y = map(freeze, ref.centre(l_r, (m.x, m.y, yaw), (m.dx, m.dy, m.omega)))
    return Grid(
        t=freeze(m.t), x=x, y=y, yaw=freeze(yaw), v_x=v_x, v_y=v_y, omega=freeze(m.omega),
        throttle=freeze(m.throttle), steering=freeze(m.steering), encoder=freeze(m.encoder),
        bad=freeze_flags(m.bad), reference=ref, scale=recording.scale, points=m.points,
        voltage=None if recording.battery is None else freeze(recording.battery.interpolate(m.t)))
