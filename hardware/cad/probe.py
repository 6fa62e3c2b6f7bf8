"""Measures on finished meshes: walls, overhangs, round holes. numpy and trimesh only.

What the tests find here is a property of the committed file, not of the program that wrote it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

Array = NDArray[np.float64]
LEDGE = 2.5  # mm that print freely beyond the last support of a bridge


def exits(mesh: trimesh.Trimesh, origins: Array, directions: Array) -> tuple[Array, NDArray[Any]]:
    """Distance [mm] to the first triangle and its index, for rays of shape (n, 3); inf, -1: none.

    Moeller and Trumbore, all rays against all triangles, in blocks.
    """
    a, b, c = (mesh.triangles[:, i] for i in range(3))
    e1, e2 = b - a, c - a
    best, face = np.full(len(origins), np.inf), np.full(len(origins), -1)
    for start in range(0, len(origins), 64):
        o = origins[start:start + 64, None]
        d = directions[start:start + 64, None]
        h = np.cross(d, e2[None])
        det = np.einsum("ijk,jk->ij", h, e1)
        with np.errstate(all="ignore"):  # rays parallel to a triangle
            s = o - a[None]
            u = np.einsum("ijk,ijk->ij", s, h) / det
            q = np.cross(s, e1[None])
            v = np.einsum("ijk,ijk->ij", q, np.broadcast_to(d, q.shape)) / det
            t = np.einsum("ijk,jk->ij", q, e2) / det
            hit = (np.abs(det) > 1e-12) & (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9)
        t = np.where(hit & (t > 1e-4), t, np.inf)
        nearest = t.argmin(axis=1)
        best[start:start + 64] = t[np.arange(len(t)), nearest]
        face[start:start + 64] = nearest
    face[np.isinf(best)] = -1
    return best, face


def walls(mesh: trimesh.Trimesh, samples: int = 300, seed: int = 1) -> Array:
    """Thickness [mm] of the material below points spread over the surface.

    Only where the far side faces away (within 30 deg): a wedge has no wall thickness.
    """
    points, index = trimesh.sample.sample_surface(mesh, samples, seed=seed)
    # Small faces matter as much as large ones: one more point in the middle of some of each size.
    order = np.argsort(mesh.area_faces)
    extra = order[np.linspace(0, len(order) - 1, min(len(order), samples // 2)).astype(int)]
    points = np.concatenate([points, mesh.triangles_center[extra]])
    index = np.concatenate([index, extra])
    inward = -mesh.face_normals[index]
    distance, far = exits(mesh, points + 1e-5 * inward, inward)
    facing = np.einsum("ij,ij->i", mesh.face_normals[far], inward)
    return distance[(far >= 0) & (facing > math.cos(math.radians(30)))]


def spans(mesh: trimesh.Trimesh, overhang: float) -> list[tuple[float, float]]:
    """(longest free span, area) of every ceiling that needs a bridge, [mm], [mm2].

    A ceiling is a connected group of faces that lean outwards by more than `overhang` degrees
    from the vertical and do not lie on the bed. It is held where a face goes down from its edge;
    a span that is held on one side only counts as infinite.
    """
    down = mesh.face_normals[:, 2] < -math.sin(math.radians(overhang)) - 1e-6
    down &= mesh.triangles_center[:, 2] > 0.05
    if not down.any():
        return []
    pairs = mesh.face_adjacency
    inside = down[pairs].all(axis=1)
    groups = trimesh.graph.connected_components(pairs[inside], nodes=np.flatnonzero(down))
    return [(_span(mesh, set(map(int, g))), float(mesh.area_faces[g].sum())) for g in groups]


def _span(mesh: trimesh.Trimesh, group: set[int]) -> float:
    """Shortest of the spans along x and y that is held at both ends."""
    held = []
    for pair, edge in zip(mesh.face_adjacency, mesh.face_adjacency_edges, strict=True):
        one, other = int(pair[0]), int(pair[1])
        if (one in group) == (other in group):
            continue
        neighbour = other if one in group else one
        ends = mesh.vertices[edge]
        third = mesh.triangles[neighbour].mean(axis=0)[2]
        if third < ends[:, 2].mean() - 1e-3:
            held.append(ends.mean(axis=0))
    if not held:
        return math.inf
    points = mesh.triangles[sorted(group)].reshape(-1, 3)
    low, high, held_at = points.min(axis=0), points.max(axis=0), np.array(held)
    first, last = held_at.min(axis=0), held_at.max(axis=0)
    found = [high[k] - low[k] for k in (0, 1)
             if first[k] < low[k] + LEDGE and last[k] > high[k] - LEDGE
             and last[k] - first[k] > 0.6 * (high[k] - low[k])]
    return float(min(found)) if found else math.inf


def hole_error(mesh: trimesh.Trimesh, hole: dict[str, Any]) -> float:
    """How far the mesh is from this round or oblong hole, mm; inf if there is none.

    The vertices of a bore lie exactly on its circle: they are looked for all around, and none
    may lie inside.
    """
    axis = np.array(hole["axis"], dtype=float)
    offset = mesh.vertices - np.array(hole["at"], dtype=float)
    along = offset @ axis
    near = offset[np.abs(along) < hole["length"] / 2 + 0.02]
    flat = near - np.outer(near @ axis, axis)
    if hole.get("slot"):
        way = np.array(hole["slot_axis"], dtype=float)
        position = np.clip(flat @ way, -hole["slot"] / 2, hole["slot"] / 2)
        flat = flat - np.outer(position, way)
    radius = np.linalg.norm(flat, axis=1)
    wall = np.abs(radius - hole["diameter"] / 2) < 0.3
    inside = radius < hole["diameter"] / 2 - 0.3
    if wall.sum() < 12 or inside.any():
        return math.inf
    across = np.cross(axis, [0.31, 0.52, 0.79])
    across /= np.linalg.norm(across)
    ring = flat[wall]
    angle = np.sort(np.arctan2(ring @ np.cross(axis, across), ring @ across))
    gaps = np.diff(np.append(angle, angle[0] + 2 * math.pi))
    if gaps.max() > math.radians(60):
        return math.inf
    return float(np.abs(radius[wall] - hole["diameter"] / 2).max())
