"""Overlaps between bodies of the assembly and what stands in the plane of the lidar."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
import trimesh
from numpy.typing import NDArray

Bodies = dict[str, list[trimesh.Trimesh]]
TOUCH = 1.0  # mm3: faces that lie on each other give rounding, not overlap


def boxes_meet(a: trimesh.Trimesh, b: trimesh.Trimesh) -> bool:
    low = np.maximum(a.bounds[0], b.bounds[0])
    high = np.minimum(a.bounds[1], b.bounds[1])
    return bool(np.all(high - low > 1e-3))


def shared(a: trimesh.Trimesh, b: trimesh.Trimesh) -> float:
    """Volume that both bodies fill, mm3."""
    if not boxes_meet(a, b):
        return 0.0
    with np.errstate(all="ignore"):  # bodies that only touch give an empty mesh
        common = trimesh.boolean.intersection([a, b], engine="manifold")
        return abs(float(common.volume)) if len(common.faces) else 0.0


MATES = {("jumpers", "nano")}
"""Plugged into each other: pins of one in the sockets of the other."""


def overlaps(bodies: Bodies) -> dict[str, float]:
    """Shared volume [mm3] of every pair "a | b" that has any and is no plug, sorted by name."""
    found = {}
    for a, b in combinations(sorted(bodies), 2):
        if (a, b) in MATES:
            continue
        volume = sum(shared(x, y) for x in bodies[a] for y in bodies[b])
        if volume > 1e-3:
            found[f"{a} | {b}"] = round(volume, 3)
    return found


def section(mesh: trimesh.Trimesh, z: float) -> NDArray[np.float64]:
    """Segments of the cut at height z, shape (n, 2, 2), mm."""
    lines = trimesh.intersections.mesh_plane(mesh, [0, 0, 1], [0, 0, z + 1e-4])
    return np.asarray(lines, dtype=float).reshape(-1, 2, 3)[:, :, :2]


def nearest(segments: NDArray[np.float64], origin: tuple[float, float],
            angle: float) -> float:
    """Distance [mm] from origin along the angle [rad] to the first segment, inf if free."""
    if not len(segments):
        return math.inf
    d = np.array([math.cos(angle), math.sin(angle)])
    a = segments[:, 0] - origin
    e = segments[:, 1] - segments[:, 0]
    cross = d[0] * e[:, 1] - d[1] * e[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (a[:, 0] * e[:, 1] - a[:, 1] * e[:, 0]) / cross
        s = (a[:, 0] * d[1] - a[:, 1] * d[0]) / cross
    ok = (np.abs(cross) > 1e-12) & (t > 0) & (s >= 0) & (s <= 1)
    return float(t[ok].min()) if ok.any() else math.inf


def lidar_view(bodies: Bodies, axis: tuple[float, float], z: float,
               reach: float = 400.0) -> dict[str, object]:
    """Who stands in the scan plane, degree by degree, and the free sector about straight ahead.

    Angles in degrees, 0 ahead, positive to the left.
    """
    cuts = {name: np.concatenate([section(m, z) for m in meshes])
            for name, meshes in bodies.items() if name != "lidar"}
    seen: dict[int, str] = {}
    for degree in range(-180, 180):
        near = {name: nearest(lines, axis, math.radians(degree + 0.25))
                for name, lines in cuts.items()}
        name = min(near, key=lambda n: near[n])
        if near[name] < reach:
            seen[degree] = name
    left = next((d for d in range(180) if d in seen), 180)
    right = next((-d for d in range(180) if -d in seen), -180)
    blockers = {name: sum(1 for n in seen.values() if n == name) for name in
                sorted(set(seen.values()))}
    return {"scan_z_mm": z, "free_left_deg": left, "free_right_deg": right,
            "blocked_deg": blockers}
