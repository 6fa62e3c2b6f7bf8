"""Where the marker frame sat on the car, and the same found from driving.

L_x, L_y [m] from the rear axle, theta [rad] added to the measured yaw; the
markers were mounted anew for each recording campaign.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timezone

import numpy as np

from .marker import marker_grid
from .model import Recording, Reference

FEB_24 = Reference(0.0900, -0.0164, 0.0, "February 2024")
JUL_24 = Reference(0.0862, 0.0270, 0.0, "July 2024")
SEP_24 = Reference(0.1150, 0.0100, -0.010, "September 2024")
Y_2025 = Reference(0.0930, 0.0100, 0.0, "2025, already at the centre of mass")
MIN_SPEED, MAX_LATERAL = 0.3, 2.0  # m/s, m/s2
TURNING, MIN_SAMPLES = 0.3, 200  # rad/s; 2 s to each side
UNTIL = ((datetime(2024, 7, 1, tzinfo=timezone.utc), FEB_24),
         (datetime(2024, 8, 16, tzinfo=timezone.utc), JUL_24),
         (datetime(2025, 1, 1, tzinfo=timezone.utc), SEP_24))


def reference_for(recording: Recording) -> Reference | None:
    """What the recording says itself, else the table by the UTC date; None when neither does."""
    if recording.marker is not None:
        return recording.marker
    if recording.schema == "C":
        return Y_2025
    when = recording.when
    if when is None or when.year < 2024:
        return None
    return next((ref for limit, ref in UNTIL if when < limit), None)


def fit_reference(recordings: Sequence[Recording]) -> Reference | None:
    """L_x and theta by least squares from turns to both sides; None without both.

    v_lat = L_x omega + tan(theta) v_x + K v_x^2 omega over |v_x omega| < 2 m/s2
    and v_x > 0.3 m/s, v_lat with the yaw as measured. Pool the recordings of
    one mounting on one floor; one constant circle is collinear.
    """

    rows, lateral = [], []
    for recording in recordings:
        g = marker_grid(recording)
        v = np.cos(g.yaw) * g.dx + np.sin(g.yaw) * g.dy
        v_lat = -np.sin(g.yaw) * g.dx + np.cos(g.yaw) * g.dy
        use = (~g.bad) & (v > MIN_SPEED) & (np.abs(v * g.omega) < MAX_LATERAL)
        rows.append(np.column_stack([g.omega, v, v * v * g.omega])[use])
        lateral.append(v_lat[use])
    design = np.concatenate(rows)
    omega = design[:, 0]
    if min((omega > TURNING).sum(), (omega < -TURNING).sum()) < MIN_SAMPLES:
        return None
    solution = np.linalg.lstsq(design, np.concatenate(lateral), rcond=None)[0]
    return Reference(float(solution[0]), float(np.arctan(solution[1])), 0.0,
                     "fitted to these recordings")
