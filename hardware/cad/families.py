"""All parts, family by family."""

from __future__ import annotations

import camera
import coupon
import holders
import lidar
import mounts
import plates
import rings
import sensors
from geometry import Part
from parameters import Parameters

FAMILIES = (plates, rings, sensors, holders, camera, lidar, mounts, coupon)


def all_parts(p: Parameters) -> list[Part]:
    """Every part of the car that is made, not bought; each as one valid solid on z = 0."""
    found = [part for family in FAMILIES for part in family.parts(p)]
    for part in found:
        solids = part.solid.solids()
        low = part.solid.bounding_box().min.Z
        if len(solids) != 1 or not solids[0].is_valid or abs(low) > 1e-6:
            raise RuntimeError(f"{part.name}: {len(solids)} solids, lowest point z = {low:.3f}; "
                               "expected one valid solid on z = 0")
    return found
